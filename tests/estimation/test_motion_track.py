"""What one localizer tells of motion, after what lies before a horizon has been forgotten."""

from __future__ import annotations

import numpy as np

from trailmark.estimates import Motion
from trailmark.estimation.kalman.motions import Motions, StatedMotion
from trailmark.estimation.symmetric import diagonal, inverse
from trailmark.geometry import Pose2

_INFORMATION = diagonal(1e4, 1e4, 1e4)


def _straight(since_s: float, stamp_s: float) -> StatedMotion:
    """Return a motion at 1 m/s."""
    motion = Motion(since_s, stamp_s, Pose2(stamp_s - since_s), np.eye(3) * 1e4)
    return StatedMotion(motion, _INFORMATION)


def test_a_motion_is_taken_after_all_that_counts_was_forgotten() -> None:
    """Of two motions that end at one instant, within rounding, only one counts; the other may outlive it."""
    motions, end_s = Motions(diagonal(0.04, 0.04, 0.1)), 0.1 + 0.2  # 0.30000000000000004
    motions.add("wheels", _straight(0.2, 0.3))
    motions.add("wheels", _straight(0.25, end_s))
    motions.forget(end_s)

    assert motions.add("wheels", _straight(5.0, 5.1))

    ((source, step),) = motions.steps(5.0, 5.1)
    assert source == "wheels"
    assert abs(step.x - 0.1) < 1e-9
    assert motions.steps(1.0, 2.0) == []


def test_what_is_asked_of_a_part_again_is_computed_once() -> None:
    """Each hypothesis, and each time that the past is redone, asks for the same."""
    motion = _straight(0.0, 0.2)
    part = motion.between(0.0, 0.1)

    assert part.inverse_covariance() is motion.between(0.0, 0.1).inverse_covariance()
    assert part.variances() is part.variances()
    assert part.covariance is not None
    assert part.inverse_covariance() == inverse(part.covariance)
    assert part.variances() == (max(part.covariance[0], part.covariance[3]), part.covariance[5])
