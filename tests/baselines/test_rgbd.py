"""ORB + depth + RANSAC-Kabsch."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from trailmark.errors import ConfigError, ShapeError
from trailmark.estimates import Belief, Fix, Lost, Motion
from trailmark.frames import RGBD, DepthCamera, Frame, Image, Pinhole, SensorInfo
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Session
from trailmark_baselines.rgbd.config import OrbRgbdConfig
from trailmark_baselines.rgbd.localizer import OrbRgbd
from trailmark_baselines.rgbd.rigid import ransac_rigid

LENS = Pinhole(525.0, 525.0, 319.5, 239.5)
WALL_M = 2.0


def _localizer(calibration: object = DepthCamera(LENS)) -> OrbRgbd:
    localizer = OrbRgbd(OrbRgbdConfig(camera="kinect"))
    info = SensorInfo("kinect", "rgbd", calibration=calibration)  # type: ignore[arg-type]
    localizer.start(Session(sensors={"kinect": info}, rng=np.random.default_rng(7)))
    return localizer


def _wall(left_px: float = 0.0) -> RGBD:
    """A textured wall with a step, shifted to the left in the picture."""
    rng = np.random.default_rng(5)
    texture = cv2.resize(rng.integers(0, 256, (60, 80), np.uint8), (640, 480), interpolation=cv2.INTER_NEAREST)
    shifted = cv2.warpAffine(texture, np.array([[1.0, 0.0, -left_px], [0.0, 1.0, 0.0]]), (640, 480))
    return RGBD(cv2.cvtColor(shifted, cv2.COLOR_GRAY2BGR), np.full((480, 640), WALL_M, np.float32))


def _observe(localizer: OrbRgbd, stamp_s: float, payload: RGBD) -> list[object]:
    return list(localizer.observe(Frame("kinect", stamp_s, payload), Belief(stamp_s)))


def test_a_rigid_motion_is_found_among_wrong_pairs() -> None:
    rng = np.random.default_rng(7)
    points_b = rng.uniform(-1.0, 1.0, (60, 3))
    true = Pose3(0.2, -0.1, 0.05, 0.1, -0.2, 0.3)
    points_a = true.transform(points_b)
    points_a[:25] = rng.uniform(-1.0, 1.0, (25, 3))

    found = ransac_rigid(points_a, points_b, np.full(60, 0.01), rng, 200)

    assert found is not None
    np.testing.assert_allclose(found[0], true.rotation(), atol=1e-9)
    assert found[2][25:].all()


def test_two_pairs_are_too_few() -> None:
    points: npt.NDArray[np.float64] = np.zeros((2, 3))

    assert ransac_rigid(points, points, np.ones(2), np.random.default_rng(7), 10) is None


def test_a_wall_that_slides_left_is_a_robot_that_goes_right() -> None:
    localizer = _localizer()

    assert _observe(localizer, 0.0, _wall()) == []
    (motion,) = _observe(localizer, 0.1, _wall(left_px=21.0))

    assert isinstance(motion, Motion)
    assert motion.since_s == 0.0
    # Of a flat wall ORB's rounding leaves turn and shift hard to tell apart: what is seen in the middle is sharp.
    seen = motion.pose_since_now @ np.array([WALL_M, 0.0])
    assert seen[1] == pytest.approx(-21.0 / 525.0 * WALL_M, abs=0.005)


def test_a_blank_picture_is_lost() -> None:
    localizer = _localizer()
    _observe(localizer, 0.0, _wall())

    (lost,) = _observe(localizer, 0.1, RGBD(np.zeros((480, 640, 3), np.uint8), _wall().depth_m))

    assert isinstance(lost, Lost)
    assert lost.reason == "0 pairs agree, 12 are needed"
    assert localizer.counters() == {"lost": 1}


@pytest.mark.parametrize("calibration", [None, DepthCamera(LENS, LENS), DepthCamera(LENS, depth_kind="range")])
def test_depth_that_is_not_registered_is_refused(calibration: object) -> None:
    with pytest.raises(ConfigError, match=r"needs a calibrated colour camera with depth \(z\) registered to it"):
        _localizer(calibration)


def test_other_payloads_and_sizes_are_refused() -> None:
    localizer = _localizer()

    with pytest.raises(ShapeError, match="takes rgbd, but 'kinect' gave Image"):
        localizer.observe(Frame("kinect", 0.0, Image(np.zeros((4, 4), np.uint8))), Belief(0.0))
    with pytest.raises(ConfigError, match="of the size of colour"):
        _observe(localizer, 0.0, RGBD(_wall().bgr, _wall().depth_m[::2, ::2]))


@pytest.mark.slow
@pytest.mark.data
def test_a_real_hand_held_recording_is_tracked(data_folder: Path) -> None:
    import trailmark
    from trailmark.evaluation import evaluate
    from trailmark.geometry import Trajectory

    source = trailmark.create("source", "tum_rgbd", path=data_folder / "rgbd" / "fr1_rpy_0_5s")
    source.start(Session(name="kinect"))
    localizer = OrbRgbd(OrbRgbdConfig(camera="kinect"))
    localizer.start(Session(sensors=source.sensors, rng=np.random.default_rng(0)))
    pose, poses = Pose2(), []
    for frame in source.frames():
        for answer in localizer.observe(frame, Belief(frame.stamp_s)):
            assert not isinstance(answer, Fix)
            if isinstance(answer, Motion):
                pose = pose @ answer.pose_since_now
                poses.append((frame.stamp_s, pose))
    evaluation = evaluate(Trajectory.from_poses(poses), source.ground_truth())

    assert len(poses) == 149
    assert evaluation.absolute.position.rmse < 0.08
    assert math.isfinite(evaluation.absolute.heading.rmse)


def test_a_picture_without_anything_is_skipped_and_nothing_of_the_way_lost() -> None:
    localizer = _localizer()
    blank = RGBD(np.zeros((480, 640, 3), np.uint8), np.full((480, 640), np.nan, np.float32))

    _observe(localizer, 0.0, _wall())
    (lost,) = _observe(localizer, 0.1, blank)
    (motion,) = _observe(localizer, 0.2, _wall(left_px=21.0))

    assert isinstance(lost, Lost)
    assert isinstance(motion, Motion)
    assert motion.since_s == 0.0
    assert motion.pose_since_now.y == pytest.approx(-21.0 / 525.0 * WALL_M, abs=5e-3)


def test_where_nothing_is_known_again_it_begins_anew() -> None:
    localizer = _localizer()
    blank = RGBD(np.zeros((480, 640, 3), np.uint8), np.full((480, 640), np.nan, np.float32))
    _observe(localizer, 0.0, _wall())

    for i in range(1, 7):
        (lost,) = _observe(localizer, 0.1 * i, blank)
        assert isinstance(lost, Lost)

    assert localizer.counters() == {"lost": 6}
