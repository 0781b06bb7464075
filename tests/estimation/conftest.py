"""What the tests of the estimators share: both of them started, drives, and beliefs that must know a pose."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.estimates import Applied, Belief, Motion, information_from_sigmas
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.paths import Path

GOOD = information_from_sigmas(1e-3, 1e-3, 1e-3)
ORIGIN = Pose2()
ONE_FRAME = Pose2(0.0037, 0.0, 0.01)  # of the ground-camera paper's vehicle at 70 Hz

#: Which filter `kalman` starts: a test that uses the fixture `kind` runs with either.
_FILTER = {"kind": "ekf"}

# The mean over sigma points of a way whose heading is uncertain is shorter than the way at the mean heading, rightly
# so. Figures worked out by hand to many digits are those of the extended filter.
EKF_ONLY = pytest.mark.parametrize("kind", ["ekf"], indirect=True)


@pytest.fixture(params=["ekf", "ukf"])
def kind(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Run a test with both filters."""
    monkeypatch.setitem(_FILTER, "kind", request.param)
    return str(request.param)


def kalman(start_pose: Pose2 | None = ORIGIN, path: Path | None = None, **config: object) -> Kalman:
    """Return a Kalman estimator that has started."""
    estimator = Kalman(KalmanConfig.model_validate({"filter": _FILTER["kind"], **config}))
    estimator.start(Session(start_pose=start_pose, path=path))
    return estimator


def dead_reckoning(start_pose: Pose2 | None = ORIGIN, path: Path | None = None, **config: float) -> DeadReckoning:
    """Return a dead reckoning that has started."""
    estimator = DeadReckoning(DeadReckoningConfig(**config))
    estimator.start(Session(start_pose=start_pose, path=path))
    return estimator


def motion(since_s: float, stamp_s: float, x: float, y: float = 0.0, theta: float = 0.0) -> Motion:
    """Return a well measured motion."""
    return Motion(since_s, stamp_s, Pose2(x, y, theta), GOOD)


def drive(estimator: DeadReckoning, n: int, step: Pose2 = ONE_FRAME, rate_hz: float = 70.0) -> None:
    """Tell a number of equal steps."""
    for i in range(n):
        assert estimator.apply("vo", Motion(i / rate_hz, (i + 1) / rate_hz, step, GOOD)) == Applied("accepted")


def pose_of(belief: Belief) -> Pose2:
    """Return the pose of a belief that must know one, and is finite."""
    assert belief.pose_map_base is not None
    assert belief.covariance is not None
    assert np.isfinite(belief.covariance).all()
    return belief.pose_map_base
