"""Light, textures and film."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from trailmark.errors import ShapeError
from trailmark.frames import Pinhole
from trailmark.geometry import Pose3
from trailmark_sim.render.atlas import build_atlas
from trailmark_sim.render.bake import Lamp, Lighting
from trailmark_sim.render.develop import Film, Sensitometry, auto_exposure
from trailmark_sim.render.lenses import Catadioptric, Fisheye, Lens, PinholeLens
from trailmark_sim.render.rays import ray_table
from trailmark_sim.render.scene import Scene, SceneBuilder, Surface
from trailmark_sim.render.shapes import ellipsoid, rectangle
from trailmark_sim.render.view import SceneView
from trailmark_sim.render.viewpoints import Viewpoints

LENS = PinholeLens(64, 48, Pinhole(60.0, 60.0, 31.5, 23.5))


def _wall(builder: SceneBuilder, surface: Surface, x: float = 2.0) -> None:
    builder.rectangle((x, 4.0, -4.0), (0.0, -8.0, 0.0), (0.0, 0.0, 8.0), surface)


def test_a_mip_map_keeps_the_light_of_its_picture() -> None:
    image = np.zeros((8, 8, 3), np.uint8)
    image[::2] = 200

    atlas = build_atlas([image])

    smallest = int(atlas.texels[-1]) & 0xFF
    assert smallest == pytest.approx(200 / np.sqrt(2.0), abs=1.0)  # half of the light, not of the grey


def test_a_texture_with_odd_sides_is_refused() -> None:
    with pytest.raises(ShapeError, match="powers of two"):
        build_atlas([np.zeros((5, 8, 3), np.uint8)])


def test_a_plain_wall_in_plain_light_has_the_light_of_its_tint() -> None:
    builder = SceneBuilder(Lighting(ambient=(1.0, 1.0, 1.0), reach_m=0.5))
    _wall(builder, Surface(tint=(0.5, 0.25, 0.125)))

    light = SceneView(builder.build(), ray_table(*LENS.directions()), Pose3()).radiance()

    np.testing.assert_allclose(light.reshape(-1, 3), np.tile([0.425, 0.2125, 0.10625], (64 * 48, 1)), rtol=1e-5)


def test_a_lamp_gives_light_that_falls_with_the_square_and_the_angle() -> None:
    lamp = Lamp((0.0, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.01), (1.0, 0.0, 0.0), (3.0, 3.0, 3.0))
    builder = SceneBuilder(Lighting((lamp,), ambient=(0.0, 0.0, 0.0), texel_m=0.125))
    _wall(builder, Surface())

    light = SceneView(builder.build(), ray_table(*LENS.directions()), Pose3()).radiance()[..., 0]

    assert light[23:25, 31:33].mean() == pytest.approx(3.0 / 4.0, rel=0.01)
    u = 20.5 / 60.0  # tangent of the angle at column 52
    assert light[23:25, 52].mean() == pytest.approx(0.75 / (1 + u * u) ** 2, rel=0.02)


def test_what_stands_before_a_lamp_casts_a_shadow() -> None:
    lamp = Lamp((0.0, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.01), (1.0, 0.0, 0.0), (3.0, 3.0, 3.0))
    builder = SceneBuilder(Lighting((lamp,), ambient=(0.0, 0.0, 0.0), texel_m=0.125))
    _wall(builder, Surface())
    builder.ellipsoid((1.0, 0.0, 0.0), (0.2, 0.2, 0.2), Surface())
    table = ray_table(*LENS.directions())

    beside = SceneView(builder.build(), table, Pose3(1.3, 0.0, 0.0)).radiance()[24, 32, 0]

    assert beside == pytest.approx(0.0, abs=1e-3)


def test_a_texture_is_seen_upright_and_unmirrored() -> None:
    image = np.zeros((64, 64, 3), np.uint8)
    image[:32, :32, 0] = 255  # red: upper left
    image[32:, 32:, 2] = 255  # blue: lower right
    builder = SceneBuilder(Lighting(ambient=(1.0, 1.0, 1.0)))
    _wall(builder, Surface(builder.texture(image)))

    light = SceneView(builder.build(), ray_table(*LENS.directions()), Pose3()).radiance()

    assert light[8, 8].argmax() == 0
    assert light[40, 56].argmax() == 2
    assert light[8, 56].max() == pytest.approx(0.0, abs=1e-6)


def test_a_far_texture_is_grey_and_not_glittering() -> None:
    image = np.zeros((512, 512, 3), np.uint8)
    image[::2, ::2] = 255
    image[1::2, 1::2] = 255
    builder = SceneBuilder(Lighting(ambient=(1.0, 1.0, 1.0)))
    _wall(builder, Surface(builder.texture(image), (8.0, 8.0)))

    light = SceneView(builder.build(), ray_table(*LENS.directions()), Pose3(-10.0)).radiance()[20:28, 28:36, 0]

    assert light.std() < 0.01 * light.mean()


def test_developing_without_noise_and_blur_follows_the_tone_curve() -> None:
    film = Film(Sensitometry(1.0, vignette=0.0, read_noise=0.0, shot_noise=0.0, blur_px=0.0), (4, 8), 0, "cam")

    picture = film.develop(np.full((4, 8, 3), [0.25, 0.5, 1.5], np.float32), 0, 1.0, 1)

    assert tuple(picture[0, 0, ::-1][:2]) == (128, 180)  # 255 sqrt(light)
    assert picture[0, 0, 0] >= 250


def test_noise_differs_from_picture_to_picture_and_not_when_repeated() -> None:
    film = Film(Sensitometry(1.0, vignette=0.0), (48, 64), 3, "cam")
    light = np.full((48, 64, 3), 0.3, np.float32)

    first, again, second = (film.develop(light, k, 1.0, 1) for k in (0, 0, 1))

    np.testing.assert_array_equal(first, again)
    difference = first.astype(float) - second
    assert 0.5 < difference.std() < 6.0
    assert abs(np.corrcoef(first[..., 0].ravel(), second[..., 0].ravel())[0, 1]) < 0.1


def test_automatic_exposure_is_not_misled_by_a_window() -> None:
    light = np.full((40, 40, 3), 0.1, np.float32)
    plain = auto_exposure(light, 0.25)
    light[:8, :8] = 50.0

    with_window = auto_exposure(light, 0.25)

    assert plain == pytest.approx(2.5)
    assert with_window > 0.8 * plain


def test_light_is_baked_the_same_with_one_and_two_threads() -> None:
    lamp = Lamp((0.0, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 0.5), (1.0, 0.0, 0.0), (3.0, 2.0, 1.0))
    builder = SceneBuilder(Lighting((lamp,)))
    _wall(builder, Surface())
    builder.ellipsoid((1.0, 0.0, 0.0), (0.2, 0.2, 0.2), Surface())

    np.testing.assert_array_equal(builder.build(1).light, builder.build(2).light)


LENSES = {
    "distorted": PinholeLens(160, 120, Pinhole(130.0, 128.0, 81.3, 58.2, (-0.25, 0.08, 1e-3, -2e-3, -0.01))),
    "fisheye": Fisheye(160, 120, 45.0, 79.2, 59.5, (0.02, -0.003)),
    "catadioptric": Catadioptric(160, 120, 30.0, 0.9, 79.8, 59.5, 11.0, 57.0),
}


def _half_white() -> Scene:
    """Return a wall at x = 2 that is white left of y = 0."""
    image = np.full((512, 512, 3), 30, np.uint8)
    image[:, :256] = 255
    builder = SceneBuilder(Lighting(ambient=(1.0, 1.0, 1.0)))
    _wall(builder, Surface(builder.texture(image)))
    return builder.build()


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
def test_every_painted_edge_is_rendered_within_a_twentieth_of_a_pixel(lens: Lens) -> None:
    """In light, not in its root: a picture's tone curve moves edges towards the dark, in cameras too."""
    directions, shows = lens.directions()
    table, scene = ray_table(directions, shows), _half_white()

    errors = []
    for yaw in np.linspace(0.0, 0.06, 15):
        pose = Pose3(yaw=float(yaw))
        light = SceneView(scene, table, pose).radiance()[..., 1].astype(float)
        errors += _edge_errors(light, directions @ pose.rotation().T, shows)

    assert len(errors) > 300
    assert abs(np.mean(errors)) < 0.003
    assert np.max(np.abs(errors)) < 0.05


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
def test_every_row_may_be_seen_at_a_heading_of_its_own(lens: Lens) -> None:
    """A camera that turns while it reads: every edge where its own row's heading puts it."""
    directions, shows = lens.directions()
    table, scene = ray_table(directions, shows, by_row=True), _half_white()
    rows = np.arange(lens.height) / lens.height - 0.5

    errors = []
    for yaw in np.linspace(0.0, 0.06, 15):
        rotations = np.stack([Pose3(yaw=yaw + 0.1 * row).rotation() for row in rows])
        light = (
            SceneView(scene, table, Viewpoints(rotations, np.zeros((lens.height, 3)))).radiance()[..., 1].astype(float)
        )
        errors += _edge_errors(light, np.einsum("vij,vuj->vui", rotations, directions), shows)

    assert len(errors) > 300
    assert abs(np.mean(errors)) < 0.003
    assert np.max(np.abs(errors)) < 0.05


def _edge_errors(
    light: npt.NDArray[np.float64], rays: npt.NDArray[np.float64], shows: npt.NDArray[np.bool_]
) -> list[float]:
    """Return how far from the edge at y = 0 each row changes from light to dark, at right angles to the edge [px]."""
    reach, errors = 5, []
    for v, u in zip(*np.nonzero(np.diff(np.sign(rays[..., 1]), axis=1)), strict=True):
        around = slice(max(0, u - reach), u + reach + 2)
        if rays[v, u, 0] < 0.8 or not shows[v, around].all() or len(light[v, around]) < 2 * reach + 2:
            continue  # not on the wall, or at its rim
        slopes = rays[v, u + 1, 1] - rays[v, u, 1], rays[min(v + 1, len(rays) - 1), u, 1] - rays[v, u, 1]
        across = abs(slopes[0]) / np.hypot(*slopes)
        if across < 0.3:
            continue  # the edge lies nearly along the row
        true = u + rays[v, u, 1] / (rays[v, u, 1] - rays[v, u + 1, 1])
        bright = (light[v, around] - light[v, around].min()) / np.ptp(light[v, around])
        is_left = bright[0] > 0.5
        found = around.start - 0.5 + bright.sum() if is_left else around.stop - 0.5 - bright.sum()
        errors.append(float(found - true) * across)
    return errors


def test_movers_of_a_place_look_as_if_built_with_it() -> None:
    """A mover with a texture of its own, added to a place that is there: the same light to the bit."""
    rng = np.random.default_rng(7)
    wall, ball = (rng.integers(0, 255, (16, 16, 3), np.uint8) for _ in range(2))
    lighting = Lighting((Lamp((0.0, 0.0, 2.0), (0.2, 0.0, 0.0), (0.0, 0.2, 0.0)),))

    def place() -> SceneBuilder:
        builder = SceneBuilder(lighting)
        _wall(builder, Surface(builder.texture(wall)))
        return builder

    def add_ball(builder: SceneBuilder) -> None:
        look = Surface(builder.texture(ball), tint=(0.9, 0.8, 0.7))
        builder.add_mover(ellipsoid((1.5, 0.1, 0.0), (0.2, 0.1, 0.3), 0.4), look)
        builder.add_mover(rectangle((1.2, 0.4, 0.0), (0.0, -0.2, 0.0), (0.0, 0.0, 0.2)), Surface(builder.texture(wall)))

    whole = place()
    add_ball(whole)
    scenes = [whole.build(), place().build().with_movers(add_ball), whole.build().with_movers(add_ball)]

    seen = [SceneView(scene, ray_table(*LENS.directions()), Pose3()).radiance() for scene in scenes]
    np.testing.assert_array_equal(seen[0], seen[1])
    np.testing.assert_array_equal(seen[0], seen[2])
    assert place().build().with_movers(lambda builder: None).n_fixed == 1
