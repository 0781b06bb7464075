"""What is wrong with the camera, the laser or the map: a clear answer or `Lost`, never a confident wrong place."""

from __future__ import annotations

import dataclasses
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from trailmark.estimates import Belief, Estimate, Fix, Lost
from trailmark.frames import Omni, SensorInfo
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Session
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_omni_surf.localizer import OmniSurf

PLACES = [Pose2(-1.0 + 0.02 * k, 0.4 - 0.01 * k, 0.3 + 0.05 * k) for k in range(40)]
CONFIG = OmniSurfConfig.model_validate({"camera": "omni"})


@pytest.fixture(scope="module")
def room(omni: Any) -> Any:
    return omni.room()


@pytest.fixture(scope="module")
def taught(omni: Any, room: Any) -> Any:
    return omni.taught(room, CONFIG)


def answers(omni: Any, room: Any, taught: Any, sensor: SensorInfo, change: Any = None) -> list[Estimate]:
    """Drive through the room with a camera that is described as `sensor`; `change` spoils the pictures."""
    localizer = OmniSurf(CONFIG)
    localizer.start(Session("omni", "replay", {"omni": sensor}, map=taught))
    said: list[Estimate] = []
    for k, pose in enumerate(PLACES):
        image = room.render(pose)
        image = image if change is None else np.ascontiguousarray(change(image))
        said += localizer.observe(omni.frame(image, k / 15), Belief(k / 15, pose_odom_base=pose))
    return said


def wrong_and_sure(said: list[Estimate]) -> list[float]:
    """Return the errors of those that are more than 0.5 m off with NEES > 16."""
    wrong = []
    for answer, pose in zip(said, PLACES):
        if isinstance(answer, Fix):
            off = answer.pose_map_base.array() - pose.array()
            off[2] = wrap_angle(off[2])
            if math.hypot(off[0], off[1]) > 0.5 and off @ answer.information @ off > 16.0:
                wrong.append(math.hypot(off[0], off[1]))
    return wrong


def with_calibration(room: Any, **changes: Any) -> SensorInfo:
    sensor: SensorInfo = room.sensor(knows_centre=True)
    assert isinstance(sensor.calibration, Omni)
    return dataclasses.replace(sensor, calibration=dataclasses.replace(sensor.calibration, **changes))


def test_all_is_well_with_a_good_camera(omni: Any, room: Any, taught: Any) -> None:
    said = answers(omni, room, taught, room.sensor())

    assert sum(isinstance(answer, Fix) for answer in said) >= 38
    assert not wrong_and_sure(said)


def test_a_picture_that_is_not_circular_is_lost_with_the_reason(omni: Any, room: Any, taught: Any) -> None:
    said = answers(omni, room, taught, room.sensor(), lambda image: cv2.resize(image, None, fx=1.25, fy=1.0))

    assert all(isinstance(answer, Lost) and "no image circle" in answer.reason for answer in said)


@pytest.mark.parametrize(("du", "dv"), [(20.0, 0.0), (0.0, -20.0)])
def test_a_centre_named_20_px_off_is_lost_with_both_centres(
    omni: Any, room: Any, taught: Any, du: float, dv: float
) -> None:
    sensor = with_calibration(room, centre_u=room.centre[0] + du, centre_v=room.centre[1] + dv)

    said = answers(omni, room, taught, sensor)

    assert all(isinstance(answer, Lost) and "puts the image centre at" in answer.reason for answer in said)


def test_a_camera_shifted_by_20_px_is_found_where_no_centre_is_named(omni: Any, room: Any, taught: Any) -> None:
    said = answers(omni, room, taught, room.sensor(), lambda image: np.roll(image, (-10, 20), axis=(0, 1)))

    assert sum(isinstance(answer, Fix) for answer in said) >= 38
    assert not wrong_and_sure(said)


@pytest.mark.parametrize("turned_deg", [30.0, 180.0])
def test_a_rotated_mirror_turns_the_heading_and_leaves_the_place(
    omni: Any, room: Any, taught: Any, turned_deg: float
) -> None:
    said = answers(omni, room, taught, with_calibration(room, forward_deg=turned_deg))

    fixes = [(answer, pose) for answer, pose in zip(said, PLACES) if isinstance(answer, Fix)]
    assert len(fixes) >= 38
    assert all(answer.pose_map_base.distance_to(pose) < 0.2 for answer, pose in fixes)
    turns = [abs(wrap_angle(answer.pose_map_base.theta - pose.theta)) for answer, pose in fixes]
    np.testing.assert_allclose(np.degrees(turns), turned_deg, atol=3.0)


def test_a_mirror_believed_the_wrong_way_round_is_lost(omni: Any, room: Any, taught: Any) -> None:
    said = answers(omni, room, taught, with_calibration(room, turns="clockwise"))

    assert all(isinstance(answer, Lost) for answer in said)


def test_a_map_from_elsewhere_is_lost(omni: Any, room: Any) -> None:
    elsewhere = omni.taught(omni.room(seed=41), CONFIG)

    said = answers(omni, room, elsewhere, room.sensor())

    assert all(isinstance(answer, Lost) for answer in said)


def test_a_missing_laser_is_refused_in_one_line(tmp_path: Path) -> None:
    config = tmp_path / "market.yaml"
    config.write_text(
        "sources: {robot: {plugin: sim, world: supermarket, sensors: [wheels], route: wall, duration_s: 0.1}}\n"
        "localizers: {wheels: {plugin: odometry}, laser: {plugin: laser_icp, laser: laser}}\n",
        encoding="utf-8",
    )
    command = [sys.executable, "-m", "trailmark.cli", "run", str(config), "--out", str(tmp_path / "out")]

    found = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)

    assert found.returncode == 2
    assert "laser" in found.stderr
    assert "Traceback" not in found.stderr
