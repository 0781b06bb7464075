"""What the writer of data sets leaves on disk."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from trailmark.frames import RGBD, DepthCamera, Frame, Pinhole, Record, Scan, SensorInfo
from trailmark.geometry import Pose2, Trajectory
from trailmark.recording import DatasetWriter


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
    player = spec.load()(spec.load_config()(path=tmp_path / "set" / "laser.log"))

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
