"""Why a localizer is not believed, in words."""

from __future__ import annotations

import math

from trailmark.estimation.kalman.agreement import is_still, motion_since
from trailmark.estimation.kalman.diagnosis import MotionSum
from trailmark.estimation.kalman.state import FilterState

__all__ = ["reason_against_fixes", "reason_against_motion"]


def reason_against_motion(state: FilterState, anchor: FilterState, source: str, believed: frozenset[str]) -> str:
    """Return what a motion said since an anchor, and what those that are believed said."""
    dt_s = state.stamp_s - anchor.stamp_s
    motion = motion_since(state, anchor, source)
    said = "nothing" if motion is None else _in_words(motion)
    others = [f"{other} {_in_words(m)}" for other in sorted(believed) if (m := motion_since(state, anchor, other))]
    if motion is not None and is_still(motion):
        said = f"no motion ({said})"
    against = " and ".join(others) if others else "absolute estimates contradict it"
    return f"its motion is not believed: {said} in {dt_s:.1f} s, {against}"


def reason_against_fixes(motions: frozenset[str], fixes: frozenset[str], *, is_outvoted: bool) -> str:
    """Return why absolute estimates are not believed beside some motions, or the absolute estimates of others."""
    against = f"those of {' and '.join(sorted(fixes))}" if fixes else f"the motion of {' and '.join(sorted(motions))}"
    reason = f"its absolute estimates are not believed: they have jumped, or drift, against {against}"
    return reason if is_outvoted else f"{reason}, and nothing decides who is right: the belief covers both"


def _in_words(motion: MotionSum) -> str:
    words = []
    if motion.position_m2 < math.inf:
        words.append(f"{math.hypot(motion.x, motion.y):.3f} m")
    if motion.turn_rad2 < math.inf:
        words.append(f"{math.degrees(motion.turn):.1f} deg")
    return ", ".join(words)
