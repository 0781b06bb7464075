"""What the writer of data sets leaves on disk."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from trailmark.errors import ConfigError, SourceError
from trailmark.frames import RGBD, DepthCamera, Frame, Image, Imu, Odometry, Pinhole, Record, Scan, SensorInfo
from trailmark.geometry import Pose2, Trajectory
from trailmark.pipeline import Pipeline
from trailmark.recording import DatasetWriter, write_png


def test_colour_and_depth_are_written_as_the_tum_benchmark_does(tmp_path: Path) -> None:
    lens = Pinhole(500.0, 501.0, 320.0, 240.0)
    info = SensorInfo("eyes", "rgbd", (8, 6), 30.0, calibration=DepthCamera(lens))
    depth = np.full((6, 8), 2.5, dtype=np.float32)
    depth[0, 0] = np.nan
    writer = DatasetWriter(tmp_path / "set", {"eyes": info})

    writer.write(Frame("eyes", 0.25, RGBD(np.full((6, 8, 3), 9, np.uint8), depth)))
    writer.close(None)

    stored = cv2.imread(str(tmp_path / "set" / "eyes" / "depth" / "000000.png"), cv2.IMREAD_UNCHANGED)
    assert stored is not None
    assert (stored[0, 0], stored[1, 1]) == (0, 12500)
    assert (tmp_path / "set" / "eyes" / "depth.txt").read_text() == "0.25 depth/000000.png\n"
    assert (tmp_path / "set" / "eyes" / "camera.txt").read_text() == "500.0 501.0 320.0 240.0\n5000.0\n"


def test_depth_that_is_too_far_for_a_picture_is_no_wall(tmp_path: Path) -> None:
    info = SensorInfo("eyes", "rgbd", (4, 1), 30.0, calibration=DepthCamera(Pinhole(4.0, 4.0, 2.0, 0.0)))
    depth = np.array([[3.0, 13.106, 13.108, 40.0]], dtype=np.float32)
    writer = DatasetWriter(tmp_path / "set", {"eyes": info})

    writer.write(Frame("eyes", 0.25, RGBD(np.full((1, 4, 3), 9, np.uint8), depth)))
    writer.close(None)

    stored = cv2.imread(str(tmp_path / "set" / "eyes" / "depth" / "000000.png"), cv2.IMREAD_UNCHANGED)
    assert stored is not None
    assert stored.tolist() == [[15000, 65530, 0, 0]]
    assert writer.n_too_far == {"eyes": 2}


def test_a_scan_is_written_as_a_carmen_log_that_plays_again(tmp_path: Path) -> None:
    from trailmark.interfaces import Session
    from trailmark.plugins import load_plugins

    ranges = np.array([1.0, np.nan, 2.5, 3.25])
    info = SensorInfo("laser", "scan", rate_hz=10.0)
    writer = DatasetWriter(tmp_path / "set", {"laser": info})
    for k in range(3):
        writer.write(Frame("laser", 0.1 * k, Scan(ranges + k, -1.0, 0.5, range_max_m=30.0)))
    writer.close(Trajectory.from_poses([(0.1 * k, Pose2()) for k in range(3)]))
    spec = load_plugins().registry.find("source", "carmen_log")
    player = spec.load()(spec.load_config().model_validate({"path": tmp_path / "set" / "laser.log"}))

    player.start(Session(name="laser"))
    frames = list(player.frames())

    scans = [frame.payload for frame in frames if isinstance(frame.payload, Scan)]
    assert len(scans) == 3
    np.testing.assert_allclose(scans[1].ranges_m, ranges + 1)
    np.testing.assert_allclose(scans[1].angles(), [-1.0, -0.5, 0.0, 0.5])


def test_other_readings_are_written_as_arrays(tmp_path: Path) -> None:
    writer = DatasetWriter(tmp_path / "set", {"tags": SensorInfo("tags", "tags")})

    writer.write(Frame("tags", 0.5, Record({"ids": np.array([3, 4])})))
    writer.close(None)

    with np.load(tmp_path / "set" / "tags" / "000000.npz") as stored:
        np.testing.assert_array_equal(stored["ids"], [3, 4])
    assert (tmp_path / "set" / "tags" / "timestamps.txt").read_text() == "0.5 000000.npz\n"


def played(folder: Path) -> dict[str, list[Frame]]:
    """Return the frames of a data set, by sensor, as its own config plays them."""
    frames: dict[str, list[Frame]] = {}
    with Pipeline(folder / "config.yaml") as pipeline:
        for step in pipeline:
            if step.frame is not None:
                frames.setdefault(step.frame.sensor, []).append(step.frame)
    return frames


@pytest.mark.parametrize("picture", [np.full((6, 8), 40000, np.uint16), np.full((6, 8, 3), (1, 2, 3), np.uint8)])
def test_pictures_of_every_form_come_back_as_they_were(tmp_path: Path, picture: np.ndarray) -> None:
    writer = DatasetWriter(tmp_path / "set", {"eye": SensorInfo("eye", "image", (8, 6))})
    writer.write(Frame("eye", 0.1, Image(picture)))
    writer.write(Frame("eye", 0.25, Image(picture + 1)))
    writer.close(None)

    frames = played(tmp_path / "set")["eye"]

    assert [frame.stamp_s for frame in frames] == [0.1, 0.25]
    assert isinstance(frames[1].payload, Image)
    np.testing.assert_array_equal(frames[1].payload.pixels, picture + 1)


def test_distances_come_back_as_distances(tmp_path: Path) -> None:
    writer = DatasetWriter(tmp_path / "set", {"wheel": SensorInfo("wheel", "odometry")})
    for k in range(4):
        writer.write(Frame("wheel", 0.5 * k, Odometry(distance_m=0.25 * k)))
    writer.close(None)

    frames = played(tmp_path / "set")["wheel"]

    assert (tmp_path / "set" / "wheel.csv").read_text().startswith("t,distance\n0.0,0.0\n")
    assert [frame.payload.distance_m for frame in frames if isinstance(frame.payload, Odometry)] == [0, 0.25, 0.5, 0.75]


def test_odometry_that_loses_its_pose_is_refused(tmp_path: Path) -> None:
    writer = DatasetWriter(tmp_path / "set", {"wheel": SensorInfo("wheel", "odometry")})
    writer.write(Frame("wheel", 0.0, Odometry(Pose2())))

    with pytest.raises(SourceError, match=r"'wheel' gives t,distance at 1.0+ s, and t,x,y,theta before"):
        writer.write(Frame("wheel", 1.0, Odometry(distance_m=1.0)))


def test_a_laser_of_unknown_range_keeps_what_is_far(tmp_path: Path) -> None:
    writer = DatasetWriter(tmp_path / "set", {"laser": SensorInfo("laser", "scan")})
    for k in range(2):
        writer.write(Frame("laser", 0.1 * k, Scan(np.array([0.5, 120.0, np.nan]), 0.0, 0.1)))
    writer.close(None)

    scan = played(tmp_path / "set")["laser"][0].payload

    assert isinstance(scan, Scan)
    np.testing.assert_array_equal(scan.ranges_m, [0.5, 120.0, np.nan])


def test_an_imu_without_accelerations_leaves_them_unknown(tmp_path: Path) -> None:
    writer = DatasetWriter(tmp_path / "set", {"gyro": SensorInfo("gyro", "imu")})
    writer.write(Frame("gyro", 0.5, Imu(np.array([0.0, 0.0, 0.25]))))
    writer.close(None)

    assert (tmp_path / "set" / "gyro.csv").read_text() == "t,wx,wy,wz,ax,ay,az\n0.5,0.0,0.0,0.25,nan,nan,nan\n"
    assert writer.playable == ()


def test_what_is_no_picture_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"\(2, 3, 7\) uint8 as PNG"):
        write_png(tmp_path / "a.png", np.zeros((2, 3, 7), np.uint8))
