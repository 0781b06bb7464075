"""Sequences in the ASL layout: a synthetic one, and what is wrong with others."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trailmark.errors import SourceError
from trailmark.frames import Frame, Image, Imu, Pinhole
from trailmark.interfaces import Session
from trailmark_datasets.config import EurocConfig
from trailmark_datasets.euroc import Euroc

BEGIN_NS = 1_403_636_579_763_555_584
STEP_NS = 50_000_000
#: The optical axes in a body whose x points up and whose z points forward, turned a little, as on the drone.
R_BODY_CAMERA = (
    np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    @ Rotation.from_euler("z", 1.0, degrees=True).as_matrix()
)
T_BODY_CAMERA = np.block([[R_BODY_CAMERA, np.array([[0.05], [-0.02], [0.1]])], [np.zeros((1, 3)), np.ones((1, 1))]])

CAMERA = """%YAML:1.0
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: {matrix}
rate_hz: 20
resolution: [12, 8]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375] # fu, fv, cu, cv
distortion_model: {lens}
distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]
"""


def stamp_ns(i: int) -> int:
    return BEGIN_NS + i * STEP_NS


@pytest.fixture
def sequence(tmp_path: Path, write_picture: Callable[..., Any]) -> Path:
    """Four pictures of a camera that moves 0.1 m ahead a picture and turns left by 2 deg; an IMU four times as fast."""
    mav = tmp_path / "V1_01" / "mav0"
    for i in range(4):
        write_picture(mav / f"cam0/data/{stamp_ns(i)}.png", i)
    pictures = "".join(f"{stamp_ns(i)},{stamp_ns(i)}.png\n" for i in range(4))
    (mav / "cam0/data.csv").write_text("#timestamp [ns],filename\n" + pictures)
    (mav / "cam0/sensor.yaml").write_text(
        CAMERA.format(matrix=T_BODY_CAMERA.ravel().round(9).tolist(), lens="radial-tangential")
    )
    (mav / "imu0").mkdir()
    readings = "".join(f"{BEGIN_NS + i * STEP_NS // 4},0.1,0.2,{0.01 * i},9.8,0,0\n" for i in range(14))
    (mav / "imu0/data.csv").write_text("#timestamp,w_x,w_y,w_z,a_x,a_y,a_z\n" + readings)
    (mav / "imu0/sensor.yaml").write_text(f"sensor_type: imu\nT_BS: {{data: {np.eye(4).ravel().tolist()}}}\n")
    (mav / "state_groundtruth_estimate0").mkdir()
    rows = [truth_row(i) for i in range(-1, 8)]
    (mav / "state_groundtruth_estimate0/data.csv").write_text("#timestamp,p,q,v,b\n" + "".join(rows))
    return mav.parent


def truth_row(half: int) -> str:
    """Return the line of the body's true pose at every half picture, in a world whose z points up."""
    turn = math.radians(1.0 * half)
    ahead = np.array([math.cos(turn), math.sin(turn), 0.0])
    R_world_camera = np.column_stack([[ahead[1], -ahead[0], 0.0], [0.0, 0.0, -1.0], ahead])
    T_world_camera = np.eye(4)
    T_world_camera[:3, :3], T_world_camera[:3, 3] = R_world_camera, [0.05 * half, 0.0, 1.5]
    T_world_body = T_world_camera @ np.linalg.inv(T_BODY_CAMERA)
    x, y, z, w = Rotation.from_matrix(T_world_body[:3, :3]).as_quat()
    numbers = [*T_world_body[:3, 3], w, x, y, z, *np.zeros(9)]
    return f"{BEGIN_NS + half * STEP_NS // 2}," + ",".join(f"{n:.9f}" for n in numbers) + "\n"


def euroc(path: Path, **keys: Any) -> Euroc:
    return Euroc(EurocConfig.model_validate({"path": path, **keys}))


def test_pictures_and_inertial_readings_come_in_order(sequence: Path, play: Callable[..., list[Frame]]) -> None:
    source = euroc(sequence)

    frames = play(source)

    stamps_s = [frame.stamp_s for frame in frames]
    assert stamps_s == sorted(stamps_s)
    pictures = [frame for frame in frames if frame.sensor == "front"]
    assert [int(f.payload.pixels.flat[0]) for f in pictures if isinstance(f.payload, Image)] == [0, 1, 2, 3]
    assert pictures[0].stamp_s == pytest.approx(1403636579.763556, abs=1e-6)
    readings = [frame.payload for frame in frames if frame.sensor == "imu0"]
    assert len(readings) == 14
    assert isinstance(readings[3], Imu)
    np.testing.assert_allclose(readings[3].angular_velocity_radps, [0.1, 0.2, 0.03])
    np.testing.assert_allclose(readings[3].linear_acceleration_mps2, [9.8, 0.0, 0.0])


def test_lens_and_mounting_are_those_of_the_files(sequence: Path, play: Callable[..., list[Frame]]) -> None:
    source = euroc(sequence)

    play(source)

    camera, unit = source.sensors["front"], source.sensors["imu0"]
    assert camera.calibration == Pinhole(458.654, 457.296, 367.215, 248.375, (-0.28, 0.07, 0.0002, 0.00002))
    assert unit.rate_hz == pytest.approx(80.0, abs=1e-3)  # stamps of this epoch resolve 0.2 us
    up_in_base = unit.pose_base_sensor.matrix()[:3, :3] @ [1.0, 0.0, 0.0]  # the body's x axis points up
    np.testing.assert_allclose(up_in_base, [0.0, 0.0, 1.0], atol=0.02)
    T_camera_body = np.linalg.inv(T_BODY_CAMERA)
    right, down, ahead = T_camera_body[:3, 3]  # in optical axes
    np.testing.assert_allclose(unit.pose_base_sensor.matrix()[:3, 3], [ahead, -right, -down], atol=1e-9)


def test_the_truth_is_the_camera_s_way_in_its_plane(sequence: Path, play: Callable[..., list[Frame]]) -> None:
    source = euroc(sequence)
    play(source)

    truth = source.ground_truth()

    assert truth is not None
    expected = [[0.1 * i, 0.0, math.radians(2.0 * i)] for i in range(4)]
    np.testing.assert_allclose(truth.poses, expected, atol=1e-6)


def test_a_mounted_camera_turns_the_plane_with_it(sequence: Path, play: Callable[..., list[Frame]]) -> None:
    source = euroc(sequence, mounting={"yaw_deg": 90.0}, imu=False)  # it looks to the left of the robot
    play(source)

    truth = source.ground_truth()

    assert truth is not None
    assert set(source.sensors) == {"front"}
    np.testing.assert_allclose(truth.poses[1], [0.0, 0.1, math.radians(2.0)], atol=1e-6)


def test_without_truth_and_unit_the_pictures_remain(sequence: Path, play: Callable[..., list[Frame]]) -> None:
    for part in ("imu0", "state_groundtruth_estimate0"):
        (sequence / "mav0" / part).rename(sequence / part)
    source = euroc(sequence / "mav0")

    assert len(play(source)) == 4
    assert source.ground_truth() is None


def test_a_prism_is_no_pose(sequence: Path, play: Callable[..., list[Frame]], caplog: pytest.LogCaptureFixture) -> None:
    (sequence / "mav0/state_groundtruth_estimate0").rename(sequence / "mav0/leica0")
    source = euroc(sequence)
    play(source)

    assert source.ground_truth() is None
    assert "without a heading" in caplog.text


def test_another_lens_is_said_and_not_taken(
    sequence: Path, play: Callable[..., list[Frame]], caplog: pytest.LogCaptureFixture
) -> None:
    about = sequence / "mav0/cam0/sensor.yaml"
    about.write_text(about.read_text().replace("radial-tangential", "equidistant"))
    source = euroc(sequence)

    play(source)

    assert source.sensors["front"].calibration is None
    assert "equidistant is not understood" in caplog.text


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        ("cam0/data.csv", f"{BEGIN_NS},{BEGIN_NS}.png", "yesterday,1.png", r"data.csv:2: .*yesterday"),
        ("cam0/data.csv", f"{BEGIN_NS},{BEGIN_NS}.png", f"{BEGIN_NS}", r"data.csv:2: expected 2 columns, found 1"),
        ("cam0/sensor.yaml", "[458.654,", "[", r"sensor.yaml: intrinsics"),
        ("cam0/sensor.yaml", "[458.654", "[a", r"sensor.yaml: intrinsics is no list of numbers"),
        ("cam0/sensor.yaml", "T_BS:", "T_BS: [", r"sensor.yaml: YAML syntax"),
        ("imu0/sensor.yaml", "[1.0, 0.0", "[2.0, 0.0", r"T_BS turns and stretches"),
        ("imu0/sensor.yaml", "[1.0, 0.0", "[1.0", r"T_BS has 15 numbers"),
        ("imu0/data.csv", ",0.1,0.2,0.0,9.8,0,0", ",0.1,0.2", r"expected 7 columns, found 3"),
    ],
)
def test_a_damaged_file_is_named(sequence: Path, file: str, old: str, new: str, said: str) -> None:
    path = sequence / "mav0" / file
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))

    with pytest.raises(SourceError, match=said):
        euroc(sequence).start(Session())


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r"is missing: a sequence has mav0/cam0/data.csv"):
        euroc(tmp_path).start(Session())


@pytest.mark.parametrize("line", ["x,0,0,0,1,0,0,0", f"{BEGIN_NS},0,0,0,0,0,0,0", f"{BEGIN_NS},0,0,0,1,0"])
def test_a_truth_that_cannot_be_is_named(sequence: Path, play: Callable[..., list[Frame]], line: str) -> None:
    (sequence / "mav0/state_groundtruth_estimate0/data.csv").write_text(line + "\n")
    source = euroc(sequence)
    play(source)

    with pytest.raises(SourceError, match=r"data\.csv:1"):
        source.ground_truth()
