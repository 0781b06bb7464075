"""With one motion nothing decides between it and the fixes: neither is accused."""

from __future__ import annotations

import numpy as np

from trailmark.estimates import Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.geometry import Pose2
from trailmark.interfaces import Session


def test_fixes_whose_errors_last_do_not_accuse_the_only_motion() -> None:
    """Each landmark's fixes are off by the same 0.1 m for 5 s, as those of a surveyed map are."""
    rng = np.random.default_rng(3)
    kalman = Kalman(KalmanConfig())
    kalman.start(Session(start_pose=Pose2()))
    for index in range(1, 1201):
        stamp_s, travelled_m = 0.05 * index, 0.02 * index
        step = Pose2(0.02 + rng.normal() * 1e-3)
        kalman.apply("wheels", Motion(stamp_s - 0.05, stamp_s, step, information_from_sigmas(2e-3, 1e-3, 4e-3)))
        if index % 5 == 0:
            off_m = 0.1 * (-1) ** (index // 100)
            fix = Pose2(travelled_m + off_m + rng.normal() * 0.02, rng.normal() * 0.02)
            kalman.apply("landmarks", Fix(stamp_s, fix, information_from_sigmas(0.03, 0.03, 0.05)))

    belief = kalman.belief(60.0)

    assert "wheels" not in belief.health
    assert abs(belief.pose_map_base.x - 24.0) < 0.15
