"""A belief that has followed absolute estimates whose clock turns out to be off: it is off by what they were."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from trailmark.estimation.kalman.rival_filters import with_pose_doubted
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman.windows import without_windows

__all__ = ["beside_another_clock"]

# A robot has moved and turned like this of late, if not just now [m/s, rad/s].
_USUAL_MPS, _USUAL_RADPS = 0.1, 0.3


def beside_another_clock(state: FilterState, shifted_s: float) -> FilterState:
    """Return a state as uncertain as it is off if it has followed poses whose stamps were off, and without questions.

    Poses that were late have drawn the belief behind by the way of that time, and turned it by its turn. What is told
    from now on contradicts that, and nobody lies. Nor does a motion that was accused for what it differed from them by:
    who lies indeed is found again.

    Parameters
    ----------
    state : FilterState
        Before the first pose whose stamp is corrected otherwise.
    shifted_s : float
        By how much otherwise [s].
    """
    twist = state.odometry.twist
    off_m = shifted_s * math.hypot(twist.forward_mps, twist.left_mps, _USUAL_MPS)
    off_rad = shifted_s * math.hypot(twist.yaw_radps, _USUAL_RADPS)
    doubted = with_pose_doubted(state, np.diag([off_m**2, off_m**2, off_rad**2]))
    diagnosis = without_windows(doubted.diagnosis)._replace(faults={}, alternatives=(), accused=frozenset(), trials={})
    return replace(doubted, diagnosis=diagnosis)
