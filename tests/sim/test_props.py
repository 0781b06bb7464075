"""Boxes that are carried, and light that is turned down."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.frames import RGBD
from trailmark.geometry import Pose2, Pose3
from trailmark_sim.props import Prop, Props, rises, walks_off
from trailmark_sim.render.scene import Surface
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds import build_world
from trailmark_sim.worlds.base import WorldOptions

START = Pose2(1.0, 2.6)


def _look(stamp_s: float, sensor: str = "rgbd", **extra: object) -> RGBD:
    world = build_world("lab", WorldOptions(sensors=(sensor,), extra={"registered": True, "exposure": 1.0} | extra))
    return world.sensors[0].render(0, stamp_s, VehicleState(START))  # type: ignore[return-value]


def test_the_faces_of_a_box_look_outwards() -> None:
    prop = Prop((0.4, 0.3, 0.2), lambda _: Pose3(1.0, 2.0, 3.0, 0.1, 0.2, 0.3), lambda _: (Surface(), Surface()))
    middle = np.array([1.0, 2.0, 3.0])

    for shape in prop.faces(0.0):
        outwards = shape.centre - middle
        np.testing.assert_allclose(np.cross(shape.frame[0], outwards), 0.0, atol=1e-12)
        assert shape.frame[0] @ outwards > 0.0


def test_a_box_stands_until_it_is_carried() -> None:
    carried = walks_off(Pose3(1.0, 2.0), from_s=3.0, direction_rad=math.pi / 2, speed_mps=0.5, way_m=1.0)
    lifted = rises(Pose3(z=1.0), from_s=1.0, way_m=0.8)

    assert [round(carried(stamp_s).y, 6) for stamp_s in (0.0, 3.0, 4.0, 9.0)] == [2.0, 2.0, 2.5, 3.0]
    assert [round(lifted(stamp_s).z, 6) for stamp_s in (0.0, 1.5, 5.0)] == [0.2, 0.7, 1.0]


def test_nobody_and_nothing_moves_nowhere() -> None:
    assert len(Props([]).at(0.0).frames) == 0


@pytest.mark.parametrize("crate", ["walks_off", "covered"])
def test_the_crate_is_no_longer_seen_where_it_stood(crate: str) -> None:
    before, after = (_look(stamp_s, crate=crate, crate_s=2.0, noise=0, depth_noise=0) for stamp_s in (1.0, 6.0))

    crate_before, crate_after = (seen.depth_m[300:340, 80:140] for seen in (before, after))
    assert np.nanmedian(crate_before) == pytest.approx(3.5 - 0.25 - 1.2, abs=0.01)
    miss_m = np.nanmedian(crate_after) - np.nanmedian(crate_before)
    assert miss_m > 0.5 if crate == "walks_off" else -0.15 < miss_m < -0.05
    np.testing.assert_array_equal(before.bgr[:200, 300:], after.bgr[:200, 300:])


def test_lamps_are_turned_down_for_camera_and_light_sensor() -> None:
    bright, dim = (_look(stamp_s, dims_s=2.0, dims_to=0.2).bgr.mean() for stamp_s in (1.0, 2.0))
    before, after = (_look(stamp_s, "light", dims_s=2.0, dims_to=0.2).value for stamp_s in (1.0, 2.0))  # type: ignore[attr-defined]

    assert dim < 0.6 * bright  # the tone curve is a square root
    assert after == pytest.approx(0.2 * before, rel=0.15)
