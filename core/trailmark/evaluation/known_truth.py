"""Which estimates of a run can be judged: those about times at which the truth is known."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.evaluation.association import INTERVALS, SAME_INSTANT_S, poses_at, usual_interval_s
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.geometry import Trajectory

__all__ = ["where_truth_is_known"]


def where_truth_is_known(
    estimates: EstimateTable, truth: Trajectory, max_difference_s: float | None = None
) -> EstimateTable:
    """Return the estimates about times at which the truth is known: of a motion, both its begin and its end.

    Parameters
    ----------
    estimates : EstimateTable
        Of a run.
    truth : Trajectory
        Where base really was, by the same clock.
    max_difference_s : float, optional
        How far the nearest true pose may be away; default: 1.5 of its usual intervals, as everywhere [s].
    """
    usual_s = INTERVALS * usual_interval_s(truth.stamps_s)
    nearest_s = usual_s if max_difference_s is None else max_difference_s
    # Beside a long gap, too, nothing is interpolated: the straight line over it is wrong from its first step on, and
    # a few such errors decide a root mean square.
    longest_s = 2.0 * max(nearest_s, usual_s)
    is_known = _is_known(truth, estimates.stamp_s, nearest_s, longest_s)
    is_motion = estimates.kind == "motion"
    is_known[is_motion] &= _is_known(truth, estimates.since_s[is_motion], nearest_s, longest_s)
    return estimates.where(is_known)


def _is_known(truth: Trajectory, stamps_s: Floats, nearest_s: float, longest_s: float) -> Bools:
    """Return at which stamps (M,) the truth has a pose near enough, and none is missing between its neighbours."""
    is_near = np.isfinite(poses_at(truth, stamps_s, nearest_s)[:, 0])
    if len(truth) < 2:
        return is_near
    after = np.clip(np.searchsorted(truth.stamps_s, stamps_s), 1, len(truth) - 1)
    before_s, after_s = truth.stamps_s[after - 1], truth.stamps_s[after]
    is_at_pose = np.minimum(np.abs(stamps_s - before_s), np.abs(stamps_s - after_s)) <= SAME_INSTANT_S
    return np.asarray(is_near & (is_at_pose | (after_s - before_s <= longest_s + SAME_INSTANT_S)))
