"""From pixels and depth to points in base axes, and back."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.frames import RGBD, DepthCamera, Pinhole, Scalar, Scan, SensorInfo
from trailmark.geometry import Pose3
from trailmark_kinect_landmarks.camera import LandmarkCamera
from trailmark_kinect_landmarks.config import CropConfig, KinectFlowConfig
from trailmark_kinect_landmarks.depth import as_scan

LENS = Pinhole(500.0, 500.0, 320.0, 240.0)
MOUNTING = Pose3(0.1, 0.02, 0.5, 0.0, 0.1, 0.2)
SIZE = (640, 480)


def _camera(calibration: object = DepthCamera(LENS), **options: object) -> LandmarkCamera:
    info = SensorInfo("kinect", "rgbd", pose_base_sensor=MOUNTING, calibration=calibration)  # type: ignore[arg-type]
    return LandmarkCamera(KinectFlowConfig(camera="kinect", **options), info)


def _depth(value_m: float) -> np.ndarray:
    return np.full((480, 640), value_m, np.float32)


@pytest.mark.parametrize("angles", ["pinhole", "linear"])
@pytest.mark.parametrize("kind", ["z", "range"])
def test_a_pixel_comes_back_from_its_point(angles: str, kind: str) -> None:
    camera = _camera(angles=angles, depth_kind=kind)
    uv = np.array([[100.0, 80.0], [320.0, 240.0], [600.0, 400.0]])

    measured = camera.measure(uv, _depth(2.0), 1.0)

    np.testing.assert_allclose(camera.project(measured.points_base, SIZE), uv, atol=1e-6)


def test_z_and_range_of_one_point_agree() -> None:
    uv = np.array([[600.0, 400.0]])
    point = np.array([2.0, -0.56 * 2.0, -0.32 * 2.0])  # x forward, y left, z up

    by_z = _camera(depth_kind="z").measure(uv, _depth(2.0), 1.0)
    by_range = _camera(depth_kind="range").measure(uv, _depth(float(np.linalg.norm(point))), 1.0)

    np.testing.assert_allclose(by_z.points_base[0], MOUNTING.transform(point), atol=1e-6)
    np.testing.assert_allclose(by_range.points_base, by_z.points_base, atol=1e-6)


def test_the_calibration_says_what_depth_measures_unless_the_config_does() -> None:
    of_range = DepthCamera(LENS, depth_kind="range")

    assert _camera(of_range).depth_kind == "range"
    assert _camera(of_range, depth_kind="z").depth_kind == "z"
    assert _camera(LENS).depth_kind == "z"


def test_without_a_calibration_the_capture_angle_makes_the_lens() -> None:
    assert _camera(None, field_of_view_deg=90.0).lens(SIZE).fx == pytest.approx(320.0)


def test_far_landmarks_are_uncertain_along_the_ray() -> None:
    cov = _camera().measure(np.array([[320.0, 240.0]]), _depth(4.0), 1.0).cov_base[0]

    along, across = MOUNTING.rotation()[:, 0], MOUNTING.rotation()[:, 1]
    assert math.sqrt(along @ cov @ along) == pytest.approx(1.425e-3 * 16.0 + 1e-3, rel=1e-3)
    assert math.sqrt(across @ cov @ across) == pytest.approx(4.0 / 500.0, rel=1e-3)


def test_the_paper_s_crop_brings_depth_to_colour() -> None:
    depth_m = _depth(2.0)[::2, ::2].copy()
    depth_m[:, :160] = 1.0
    camera = _camera(None, crop=CropConfig(left=40, right=40, top=30, bottom=30))

    registered = camera.register_depth(RGBD(np.zeros((480, 640, 3), np.uint8), depth_m))

    assert registered.shape == (480, 640)
    assert registered[240, 319] == 1.0
    assert registered[240, 320] == 2.0
    assert np.isnan(registered[240, [39, 600]]).all()
    assert np.isnan(registered[[29, 450], 320]).all()


def test_a_laser_fills_in_for_glass() -> None:
    laser = SensorInfo("laser", "scan", pose_base_sensor=Pose3(0.3, 0.0, 0.5))
    info = SensorInfo("kinect", "rgbd", pose_base_sensor=Pose3(0.1, 0.0, 0.5), calibration=DepthCamera(LENS))
    camera = LandmarkCamera(KinectFlowConfig(camera="kinect", scan="laser"), info, laser)
    wall_m = 2.0  # ahead of the laser, 2.2 m ahead of the camera
    angles = np.radians(np.arange(-90.0, 90.0, 0.5))
    scan = Scan(wall_m / np.maximum(np.cos(angles), 0.1), float(angles[0]), math.radians(0.5), range_max_m=15.0)
    uv = np.array([[320.0, 240.0], [420.0, 240.0], [420.0, 40.0]])  # the last far above the laser's plane

    measured = camera.measure(uv, _depth(np.nan), 1.0, scan)

    assert measured.from_scan.tolist() == [True, True, False]
    np.testing.assert_allclose(measured.points_base[:2], [[2.3, 0.0, 0.5], [2.3, -0.44, 0.5]], atol=0.02)
    assert np.isnan(measured.points_base[2]).any()


def test_a_point_behind_the_camera_has_no_pixel() -> None:
    assert np.isnan(_camera().project(np.array([[-1.0, 0.0, 0.5]]), SIZE)).all()


def test_an_ultrasound_fills_in_straight_ahead_of_it() -> None:
    ultrasound = SensorInfo("sonar", "scalar", pose_base_sensor=Pose3(0.3, 0.0, 0.5))
    info = SensorInfo("kinect", "rgbd", calibration=DepthCamera(LENS), pose_base_sensor=Pose3(0.2, 0.0, 0.5))
    camera = LandmarkCamera(KinectFlowConfig(camera="kinect", scan="sonar"), info, ultrasound)
    uv = np.array([[LENS.cx, LENS.cy], [420.0, LENS.cy]])  # the second beside its beam

    measured = camera.measure(uv, _depth(np.nan), 1.0, as_scan(Scalar(1.7)))
    nothing = camera.measure(uv, _depth(np.nan), 1.0, as_scan(Scalar(0.0)))

    assert measured.from_scan.tolist() == [True, False]
    np.testing.assert_allclose(measured.points_base[0], [2.0, 0.0, 0.5], atol=1e-6)
    assert not nothing.from_scan.any()
