"""Landmarks move with the keyframe that they were remembered at."""

from __future__ import annotations

import math

import numpy as np

from trailmark.geometry import Pose2, Pose3
from trailmark.paths import Keyframe
from trailmark_kinect_landmarks.config import KinectLandmarksConfig
from trailmark_kinect_landmarks.localizer import KinectLandmarks


def test_landmarks_lie_to_their_keyframe_as_before() -> None:
    before, after = Pose2(1.0, 2.0, 0.3), Pose2(1.5, 1.0, 0.9)
    rng = np.random.default_rng(1)
    points, spread = rng.normal(0.0, 3.0, (4, 3)), rng.normal(0.0, 1.0, (4, 3, 3))
    arrays = {
        "points": points,
        "cov": spread @ np.swapaxes(spread, 1, 2),
        "anchor_cov": np.tile(np.diag([1.0, 4.0, 0.1]), (4, 1, 1)),
        "anchor": np.tile([before.x, before.y, before.theta, 7.0, 0.2], (4, 1)),
        "kind": np.arange(4),
    }
    moved = KinectLandmarks(KinectLandmarksConfig.model_construct()).moved(Keyframe(3.0, 4.0, before, arrays), after)

    assert moved.pose_map_base == after
    seen, seen_before = (
        Pose3.from_planar(pose.inverse()).matrix()[:3] @ np.column_stack([rows, np.ones(4)]).T
        for pose, rows in ((after, moved.arrays["points"]), (before, points))
    )
    np.testing.assert_allclose(seen, seen_before, atol=1e-12)
    np.testing.assert_allclose(moved.arrays["anchor"][0], [after.x, after.y, after.theta, 7.0, 0.2], atol=1e-12)
    np.testing.assert_allclose(np.linalg.eigvalsh(moved.arrays["cov"]), np.linalg.eigvalsh(arrays["cov"]), atol=1e-9)
    cos, sin = math.cos(0.6), math.sin(0.6)
    np.testing.assert_allclose(moved.arrays["anchor_cov"][0][:2, :2] @ [cos, sin], [cos, sin], atol=1e-9)
    np.testing.assert_array_equal(moved.arrays["kind"], np.arange(4))
