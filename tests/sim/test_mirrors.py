"""Flat mirrors: where things are seen in them, how bright, and what a laser makes of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.arrays import Float32s
from trailmark.frames import Pinhole, Scan
from trailmark.geometry import Pose2, Pose3
from trailmark_sim.render.bake import Lighting
from trailmark_sim.render.lenses import PinholeLens
from trailmark_sim.render.rays import ray_table
from trailmark_sim.render.scene import SceneBuilder, Surface
from trailmark_sim.render.view import SceneView
from trailmark_sim.render.viewpoints import Moment
from trailmark_sim.sensors.laser import LaserRig, LaserSensor
from trailmark_sim.stage import Stage
from trailmark_sim.vehicles import VehicleState

LENS = PinholeLens(160, 120, Pinhole(120.0, 120.0, 79.5, 59.5))
DARK = Surface(tint=(0.0, 0.0, 0.0))
#: Mirrors half of the light that meets it squarely.
GLASS = Surface(tint=(0.0, 0.0, 0.0), mirror=0.5)
NOBODY = Moment(np.empty((0, 3, 3)), np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 4), np.float32))


def builder_of(mirror: Surface = GLASS) -> SceneBuilder:
    """Return a scene of a polished floor; nothing else gives light than what shines of itself."""
    builder = SceneBuilder(Lighting(ambient=(0.0, 0.0, 0.0)))
    builder.rectangle((-20.0, -20.0, 0.0), (40.0, 0.0, 0.0), (0.0, 40.0, 0.0), mirror)
    return builder


def add_lamp(builder: SceneBuilder, x: float, y: float, z: float) -> None:
    """Add a lamp of 0.2 m that looks back along x."""
    shining = Surface(emission=1.0, blocks_light=False)
    builder.rectangle((x, y + 0.1, z - 0.1), (0.0, -0.2, 0.0), (0.0, 0.0, 0.2), shining)


def picture_of(builder: SceneBuilder, camera_m: float = 1.0) -> Float32s:
    """Return what a camera at a height sees that looks along x, (H, W)."""
    return SceneView(builder.build(), ray_table(*LENS.directions()), Pose3(z=camera_m)).radiance()[..., 0]


def middle_of(light: Float32s) -> tuple[float, float]:
    v, u = np.nonzero(light > 0.5 * light.max())
    return float(u.mean()), float(v.mean())


def test_a_lamp_is_seen_in_the_floor_as_far_below_as_it_is_above() -> None:
    builder = builder_of()
    add_lamp(builder, 5.0, 0.5, 1.4)

    light = picture_of(builder)

    above, below = light.copy(), light.copy()
    above[60:], below[:60] = 0.0, 0.0
    assert middle_of(above) == pytest.approx((79.5 - 120.0 * 0.5 / 5.0, 59.5 - 120.0 * 0.4 / 5.0), abs=0.6)
    assert middle_of(below) == pytest.approx((79.5 - 120.0 * 0.5 / 5.0, 59.5 + 120.0 * 2.4 / 5.0), abs=0.6)


def test_more_is_mirrored_at_a_slant() -> None:
    builder = builder_of()
    add_lamp(builder, 5.0, 0.0, 1.4)

    cosine = 2.4 / math.hypot(2.4, 5.0)

    assert picture_of(builder)[60:].max() == pytest.approx(0.5 + 0.5 * (1.0 - cosine) ** 5, rel=0.02)


def test_what_is_mirrored_is_taken_from_the_light_of_the_mirror_itself() -> None:
    builder = SceneBuilder(Lighting(ambient=(0.0, 0.0, 0.0)))
    builder.rectangle((2.0, 4.0, -4.0), (0.0, -8.0, 0.0), (0.0, 0.0, 8.0), Surface(emission=0.8, mirror=0.25))
    builder.rectangle((-2.0, -4.0, -4.0), (0.0, 8.0, 0.0), (0.0, 0.0, 8.0), Surface(emission=0.4, blocks_light=False))

    assert picture_of(builder, 0.0)[60, 80] == pytest.approx(0.75 * 0.8 + 0.25 * 0.4, rel=1e-3)


def test_what_stands_behind_a_mirror_is_not_seen_in_it() -> None:
    builder = SceneBuilder(Lighting(ambient=(0.0, 0.0, 0.0)))
    builder.rectangle((2.0, 1.0, -1.0), (0.0, -2.0, 0.0), (0.0, 0.0, 2.0), GLASS)
    add_lamp(builder, -1.0, 0.0, 0.0)
    before = picture_of(builder, 0.0)
    # A box behind the glass, between it and the eye in the mirror, whose back looks at that eye.
    builder.box((2.5, 0.0, -1.0), (0.9, 2.0, 2.0), Surface(emission=1.0))

    np.testing.assert_array_equal(picture_of(builder, 0.0)[30:90, 50:110], before[30:90, 50:110])


def test_without_polish_there_is_no_mirror() -> None:
    builder = builder_of(DARK)
    add_lamp(builder, 5.0, 0.0, 1.4)

    assert builder.build().mirrors == ()
    assert picture_of(builder)[60:].max() == 0.0


def test_what_is_round_cannot_be_a_mirror() -> None:
    builder = builder_of()
    builder.cylinder(3.0, 0.0, 0.0, 0.2, 1.0, GLASS)

    with pytest.raises(ValueError, match="only rectangles"):
        builder.build()


def test_sides_of_one_plane_are_one_mirror() -> None:
    builder = builder_of()
    builder.rectangle((2.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), GLASS)
    builder.rectangle((2.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 2.0), GLASS)

    assert [mirror.shapes for mirror in builder.build().mirrors] == [(0,), (1, 2)]


def test_a_laser_sees_the_pane_squarely_and_the_room_in_it_at_a_slant() -> None:
    builder = SceneBuilder(Lighting(ambient=(0.0, 0.0, 0.0)))
    pane = Surface(mirror=0.1)
    builder.rectangle((8.0, 0.0, 0.0), (-8.0, 0.0, 0.0), (0.0, 0.0, 2.0), pane)  # at y = 0, looks along y
    builder.rectangle((8.0, 6.0, 0.0), (0.0, -6.0, 0.0), (0.0, 0.0, 2.0), Surface())  # the end of the room, x = 8
    scene = builder.build()
    rig = LaserRig(noise_m=0.0, noise_share=0.0, dropout=0.0, mounting=Pose3(z=0.3))
    laser = LaserSensor("laser", rig, Stage(lambda: scene, lambda stamp_s, pose: NOBODY), 0)

    scan = laser.render(0, 0.0, VehicleState(Pose2(3.0, 0.4, 0.0)))

    assert isinstance(scan, Scan)
    ranges_m = np.interp(np.radians([-90.0, -30.0, -6.0]), scan.angles(), scan.ranges_m)
    assert ranges_m[0] == pytest.approx(0.4, abs=1e-3)
    assert ranges_m[1] == pytest.approx(0.4 / math.sin(math.radians(30.0)), abs=5e-3)
    # In the pane at 0.4 m / sin(6 deg) = 3.8 m; the end of the room is mirrored 5 m ahead.
    assert ranges_m[2] == pytest.approx(5.0 / math.cos(math.radians(6.0)), abs=5e-3)
