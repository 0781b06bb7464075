"""What a ray meets, and on which pixel a point lands."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.errors import ShapeError
from trailmark.frames import Pinhole
from trailmark.geometry import Pose2, Pose3
from trailmark_sim.render.bake import Lighting
from trailmark_sim.render.cast import cast_tiles
from trailmark_sim.render.lenses import Catadioptric, Fisheye, Lens, PinholeLens
from trailmark_sim.render.rays import ray_table
from trailmark_sim.render.records import RayHits
from trailmark_sim.render.scene import Scene, SceneBuilder, Surface
from trailmark_sim.render.shapes import RECTANGLE, cylinder, ellipsoid, rectangle
from trailmark_sim.render.view import SceneView
from trailmark_sim.render.viewpoints import Viewpoints

LENSES = {
    "pinhole": PinholeLens(160, 120, Pinhole(130.0, 128.0, 79.5, 59.5)),
    "distorted": PinholeLens(160, 120, Pinhole(130.0, 128.0, 81.0, 58.0, (-0.25, 0.08, 1e-3, -2e-3, -0.01))),
    "fisheye": Fisheye(160, 120, 45.0, 79.5, 59.5, (0.02, -0.003)),
    "catadioptric": Catadioptric(160, 120, 30.0, 0.9, 79.5, 59.5, 11.0, 57.0),
}


def _scene(*shapes_of: tuple[str, object], emission: float = 0.0) -> Scene:
    builder = SceneBuilder(Lighting(ambient=(1.0, 1.0, 1.0)))
    for _, shape in shapes_of:
        builder.add(shape, Surface(emission=emission))  # type: ignore[arg-type]
    return builder.build()


def _room() -> Scene:
    builder = SceneBuilder(Lighting(ambient=(1.0, 1.0, 1.0)))
    plain = Surface()
    builder.rectangle((-2, -3, 0), (6, 0, 0), (0, 5, 0), plain)
    builder.rectangle((-2, 2, 2.5), (6, 0, 0), (0, -5, 0), plain)
    builder.rectangle((4, -3, 0), (-6, 0, 0), (0, 0, 2.5), plain)
    builder.rectangle((-2, 2, 0), (6, 0, 0), (0, 0, 2.5), plain)
    builder.rectangle((-2, -3, 0), (0, 5, 0), (0, 0, 2.5), plain)
    builder.rectangle((4, 2, 0), (0, -5, 0), (0, 0, 2.5), plain)
    return builder.build()


def _slab_ranges(rays: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Return the ranges to the walls of the room from inside, by the slab method."""
    low, high = np.array([-2.0, -3.0, 0.0]), np.array([4.0, 2.0, 2.5])
    with np.errstate(divide="ignore"):
        return np.asarray(np.maximum((low - eye) / rays, (high - eye) / rays).min(axis=-1))


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
def test_every_pixel_looks_where_its_point_lands(lens: Lens) -> None:
    rays, shows = lens.directions()
    v, u = np.nonzero(shows)

    landed = lens.project(rays[shows] * 3.7)

    np.testing.assert_allclose(landed, np.stack([u, v], axis=1), atol=1e-3)  # 0.001 px
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1.0, atol=1e-12)


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
def test_a_bright_ball_is_seen_where_it_projects(lens: Lens) -> None:
    pose = Pose3(0.3, -0.2, 1.1, 0.02, -0.03, 0.4)
    table = ray_table(*lens.directions())
    target = np.array([1.6, 0.35, -0.55])  # in sensor axes: seen by all lenses
    point_map = pose.transform(target)
    scene = _scene(("ball", ellipsoid(point_map.tolist(), (0.08, 0.08, 0.08))), emission=1.0)

    light = SceneView(scene, table, pose).radiance()[..., 1]

    v, u = np.nonzero(light > 0)
    seen = np.array([u.mean(), v.mean()])
    np.testing.assert_allclose(seen, lens.project(target[None])[0], atol=0.6)


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
def test_the_edge_of_a_wall_lies_on_its_pixel(lens: Lens) -> None:
    """The hit of each ray is computed back onto the picture: it lands within 0.05 px of its own pixel."""
    pose = Pose3(0.3, -0.2, 1.1, 0.02, -0.03, 0.4)
    directions, shows = lens.directions()
    table = ray_table(directions, shows)

    view = SceneView(_room(), table, pose)

    ranges = table.picture(view.ranges_m, np.nan)[shows].astype(float)
    landed = lens.project(directions[shows] * ranges[:, None])
    v, u = np.nonzero(shows)
    assert np.abs(landed - np.stack([u, v], axis=1)).max() < 0.05
    expected = _slab_ranges(directions[shows] @ pose.rotation().T, np.array([pose.x, pose.y, pose.z]))
    np.testing.assert_allclose(ranges, expected, atol=2e-4)  # 0.2 mm


@pytest.mark.parametrize("lens", [*LENSES.values()], ids=[*LENSES])
@pytest.mark.parametrize("by_row", [False, True], ids=["tiles", "rows"])
def test_no_ray_misses_a_shape_that_is_left_out_for_its_tile(lens: Lens, by_row: bool) -> None:
    rng = np.random.default_rng(5)
    builder = SceneBuilder(Lighting(ambient=(1.0, 1.0, 1.0)))
    for x, y, z in rng.uniform((-5, -5, 0), (5, 5, 2.5), (40, 3)).tolist():
        turn, *sizes = rng.uniform((0.0, 0.02, 0.02, 0.02), (6.3, 4.0, 2.0, 0.4)).tolist()
        along = np.array([math.cos(turn), math.sin(turn), 0.0])
        builder.rectangle((x, y, z), along * sizes[0], np.cross(along, (0.3, 0.2, -1.0)) * sizes[1], Surface())
        builder.add(cylinder(y, x, 0.0, sizes[2], z, turn), Surface())
        builder.add(ellipsoid((-x, y, z), sizes[1:] + sizes[2:], turn), Surface())
    scene, table = builder.build(), ray_table(*lens.directions(), by_row=by_row)
    n_rows = lens.height if by_row else 1
    for x, y, heading in rng.uniform((-4, -4, -3), (4, 4, 3), (4, 3)).tolist():
        poses = [Pose3(x + 0.002 * row, y, 1.1, 0.02, 0.001 * row, heading) for row in range(n_rows)]
        points = [Viewpoints.of(pose) for pose in poses]
        view = SceneView(
            scene,
            table,
            Viewpoints(np.concatenate([p.rotations for p in points]), np.concatenate([p.eyes for p in points])),
        )
        everywhere = np.zeros_like(view.shapes.bounds)
        everywhere[:, 3] = 1e6
        everywhere[:, 3, len(view.shapes.order) :] = -1e9
        every = RayHits(np.empty_like(view.met.ranges_m), np.empty_like(view.met.shapes))

        cast_tiles(0, table.n_tiles, table, view.shapes._replace(bounds=everywhere), every)

        # Of rectangles seen from behind at one row and from before at another, bounds alone know.
        faces = view.shapes.eyes[table.instants[:, None], np.maximum(every.shapes, 0), 0] > 0.0
        known = faces | (scene.kinds[np.maximum(every.shapes, 0)] != RECTANGLE)
        assert known.mean() > 0.9
        np.testing.assert_array_equal(view.met.shapes[known], every.shapes[known])
        np.testing.assert_array_equal(view.met.ranges_m[known], every.ranges_m[known])


def test_an_upright_cylinder_is_met_at_its_side_and_its_top() -> None:
    scene = _scene(("barrel", cylinder(3.0, 0.0, 0.0, 0.5, 1.0)))
    level, down = np.array([1.0, 0.0, 0.0]), np.array([3.0, 0.0, -1.0]) / math.sqrt(10.0)
    table = ray_table(np.stack([level, down])[None])

    side = SceneView(scene, table, Pose3(z=0.5)).ranges_m.ravel()[0]
    top = SceneView(scene, table, Pose3(z=2.0)).ranges_m.ravel()[1]

    assert side == pytest.approx(2.5, abs=1e-5)
    assert top == pytest.approx(math.sqrt(10.0), abs=1e-5)


def test_a_turned_ellipsoid_is_met_on_its_long_axis() -> None:
    scene = _scene(("egg", ellipsoid((0.0, 4.0, 1.0), (1.0, 0.2, 0.3), math.pi / 2)))
    table = ray_table(np.array([[[0.0, 1.0, 0.0]]]))

    view = SceneView(scene, table, Pose3(z=1.0))

    assert view.ranges_m.ravel()[0] == pytest.approx(3.0, abs=1e-5)
    assert view.facing()[0].ravel()[0] == pytest.approx(1.0, abs=1e-5)


def test_a_rectangle_is_seen_from_its_face_only() -> None:
    scene = _scene(("sign", rectangle((2.0, 0.5, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0))))
    table = ray_table(np.array([[[1.0, 0.0, 0.0]]]))

    before = SceneView(scene, table, Pose3(z=0.5))
    behind = SceneView(scene, table, Pose3(x=4.0, z=0.5, yaw=math.pi))

    assert before.ranges_m.ravel()[0] == pytest.approx(2.0, abs=1e-6)
    assert behind.is_nothing.all()


def test_a_part_stands_where_its_pose_says() -> None:
    """A room of its own axes, turned and moved: a ray in it is as long as in the room at the origin."""
    table = ray_table(*LENSES["pinhole"].directions())
    eye, part = Pose3(0.3, -0.2, 1.1, 0.02, -0.03, 0.4), Pose2(4.0, -2.0, 2.1)
    builder = SceneBuilder(Lighting())
    for here in (builder.at_pose(part), builder.at_pose(Pose2(4.0, 0.0)).at_pose(Pose2(0.0, -2.0, 2.1))):
        here.rectangle((2.0, 2.0, 0.0), (0.0, -4.0, 0.0), (0.0, 0.0, 2.5), Surface())
        here.cylinder(1.5, 0.4, 0.0, 0.2, 1.2, Surface())
        here.ellipsoid((1.2, -0.5, 1.0), (0.3, 0.1, 0.2), Surface(), 0.4)

    plain = SceneBuilder(Lighting())
    for _ in range(2):
        plain.rectangle((2.0, 2.0, 0.0), (0.0, -4.0, 0.0), (0.0, 0.0, 2.5), Surface())
        plain.cylinder(1.5, 0.4, 0.0, 0.2, 1.2, Surface())
        plain.ellipsoid((1.2, -0.5, 1.0), (0.3, 0.1, 0.2), Surface(), 0.4)

    placed = SceneView(builder.build(), table, Pose3.from_planar(part) @ eye)
    np.testing.assert_allclose(placed.ranges_m, SceneView(plain.build(), table, eye).ranges_m, rtol=2e-5)


def test_sides_that_are_not_square_are_refused() -> None:
    with pytest.raises(ValueError, match="right angles"):
        rectangle((0, 0, 0), (1, 0, 0), (1, 1, 0))


def test_directions_of_a_wrong_shape_are_refused() -> None:
    with pytest.raises(ShapeError, match="directions"):
        ray_table(np.zeros((4, 3)))
    with pytest.raises(ShapeError, match="mask"):
        ray_table(np.zeros((2, 2, 3)), np.zeros((2, 2), np.bool_))


def test_leaving_shapes_out_early_changes_nothing() -> None:
    """Many shapes: every ray meets what a search over all of them, without cones and order, says."""
    rng = np.random.default_rng(7)
    builder = SceneBuilder(Lighting())
    balls = [(rng.uniform(-4, 4, 3), rng.uniform(0.05, 0.6, 3)) for _ in range(60)]
    for centre, axes in balls:
        builder.ellipsoid(centre.tolist(), axes.tolist(), Surface())
    lens = LENSES["pinhole"]
    directions, _ = lens.directions()
    pose = Pose3(-6.0, 0.4, 0.2, 0.0, 0.1, -0.1)

    table = ray_table(directions)
    ranges = table.picture(SceneView(builder.build(), table, pose).ranges_m, np.nan)

    rays, eye = directions.reshape(-1, 3) @ pose.rotation().T, np.array([pose.x, pose.y, pose.z])
    nearest = np.full(len(rays), np.inf)
    for centre, axes in balls:
        m, q = rays / axes, (eye - centre) / axes
        a, b, c = (m * m).sum(1), m @ q, q @ q - 1.0
        root = b * b - a * c
        t = (-b - np.sqrt(np.maximum(root, 0.0))) / a
        nearest = np.where((root > 0) & (t > 0) & (t < nearest), t, nearest)
    is_near = np.isfinite(nearest) & (ranges.ravel() < 1e8)
    assert (np.isfinite(nearest) != (ranges.ravel() < 1e8)).sum() <= 5  # rays that graze a ball
    np.testing.assert_allclose(np.median(np.abs(ranges.ravel()[is_near] - nearest[is_near])), 0.0, atol=1e-5)
    assert (np.abs(ranges.ravel()[is_near] - nearest[is_near]) > 5e-3).sum() <= 5
