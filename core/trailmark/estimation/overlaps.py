"""Motions of one localizer that have time in common: what a motion is uncertain by that is cut in two."""

from __future__ import annotations

import math

from trailmark.estimation.symmetric import Sym3, diagonal
from trailmark.geometry import Twist2

__all__ = ["LONG_OVERLAP", "OVERLAPS", "TOLD_ALREADY", "TOLD_S", "unevenness"]

#: Which share of a motion may have been told before without a word: stamps are not exact.
LONG_OVERLAP = 0.05
#: What is said of a localizer whose motions have time in common, for so long [s].
OVERLAPS = "its motions overlap: what two of them cover counts once"
TOLD_S = 2.0
#: Why a motion was not used that lies within others.
TOLD_ALREADY = "it has told of all of this time already"
# By which share a velocity changes within a motion, where those before and after are the same.
_USUAL_CHANGE = 0.1


def unevenness(before_s: float, after_s: float, *, twist: Twist2, next_twist: Twist2, drift: Sym3) -> Sym3:
    """Return how uncertain the parts of a motion are that is cut in two as if it were even.

    If the velocities of its parts differ by ``v``, either part is off by ``v`` times the harmonic sum of their lengths.
    They differ as the velocities of two motions in a row do, by a tenth of the velocity, but no more than drift says.

    Parameters
    ----------
    before_s, after_s : float
        Lengths of the parts [s].
    twist, next_twist : Twist2
        Mean velocities of the motion, and of the next one.
    drift : Sym3
        Covariance of a step of 1 s that nobody measured.
    """
    square_s2 = (before_s * after_s / (before_s + after_s)) ** 2
    change_mps = math.hypot(next_twist.forward_mps - twist.forward_mps, next_twist.left_mps - twist.left_mps)
    speed_mps = math.hypot(twist.forward_mps, twist.left_mps)
    change_radps = next_twist.yaw_radps - twist.yaw_radps
    way = min(change_mps**2 + (_USUAL_CHANGE * speed_mps) ** 2, drift[0]) * square_s2
    turn = min(change_radps**2 + (_USUAL_CHANGE * twist.yaw_radps) ** 2, drift[5]) * square_s2
    return diagonal(way, way, turn)
