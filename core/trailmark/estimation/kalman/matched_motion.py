"""Motions between poses that are matched to one map: their errors cancel, and must not add up.

The error of a match is in the motion that ends with it and, with the other sign, in the next one. Motions that are
weighed as if they erred independently leave a part of it behind whenever their weights change, so that the belief walks
off a map on which every match is right. So it is remembered where the matches have led base, as seen from the belief,
and the next motion is told from there on.

The belief then follows the matches wherever they lead, and the map itself may walk off: by a share of the way and a yaw
rate that last. So far as the matches can draw the belief, this is in the covariance of its step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from trailmark.estimation.kalman.agreement import Tolerance
from trailmark.estimation.kalman.motions import MotionStep
from trailmark.estimation.kalman.weighing import information_of
from trailmark.estimation.kalman.windows import WINDOW_S
from trailmark.estimation.symmetric import Sym3, add, diagonal, inverse, scaled
from trailmark.geometry import Pose2, wrap_angle

__all__ = ["NO_OFFSETS", "Offset", "offsets_after", "with_lasting_error", "with_offsets"]

#: Base where the matches have led it, as seen from where the belief has: (x, y, theta).
Offset = tuple[float, float, float]
NO_OFFSETS: Mapping[str, Offset] = MappingProxyType({})

#: Beyond so many standard deviations of a motion an offset is no error of a match: the rest is forgotten.
_SIGMAS = 4.0
#: For how long a map walks off the same way: as the nearer tests of motions look back [s].
_LASTS_S = 2.0 * WINDOW_S
#: What is known of an offset before it is measured, one sigma: 3 m and 60 degrees; where nothing is told, it fades.
_KNOWN = diagonal(1.0 / 3.0**2, 1.0 / 3.0**2, 1.0 / math.radians(60.0) ** 2)


def with_offsets(
    stated: Sequence[tuple[str, MotionStep]], steps: Sequence[MotionStep], offsets: Mapping[str, Offset]
) -> Sequence[MotionStep]:
    """Return steps that begin where the matches before them had led base.

    Parameters
    ----------
    stated : sequence of (str, MotionStep)
        As they were told, by localizer.
    steps : sequence of MotionStep
        The same in this order, without the errors that they have in common; others may follow.
    offsets : mapping of str to Offset
        By localizer.
    """
    if not offsets:
        return steps
    found = list(steps)
    for index, ((source, told), step) in enumerate(zip(stated, steps)):  # others may follow
        offset = offsets.get(source)
        if offset is not None and told.matched_share:
            x, y, turn = (told.matched_share * number for number in offset)
            moved = Pose2(x, y, turn) @ Pose2(step.x, step.y, step.turn)
            found[index] = MotionStep(moved.x, moved.y, moved.theta, step.covariance, step.information, step.twist)
    return found


def with_lasting_error(
    fused: MotionStep,
    stated: Sequence[tuple[str, MotionStep]],
    offsets: Mapping[str, Offset],
    dt_s: float,
    tolerance: Tolerance,
) -> MotionStep:
    """Return the step of the belief with what a map that walks off adds to its covariance.

    In each direction a map draws the belief by no more than the weight of its match, times the largest offset.

    Parameters
    ----------
    fused : MotionStep
        The step of the belief.
    stated : sequence of (str, MotionStep)
        As they were told, by localizer.
    offsets : mapping of str to Offset
        With which they were weighed, by localizer.
    dt_s : float
        Length of the step [s].
    tolerance : Tolerance
        By how much a map walks off, one standard deviation.
    """
    covariance = fused.covariance
    matched = [step for source, step in stated if step.matched_share and source in offsets]
    if not matched or covariance is None:
        return fused
    way_m = math.hypot(fused.x, fused.y)
    ahead = (fused.x / way_m, fused.y / way_m, 0.0) if way_m else (1.0, 0.0, 0.0)
    told = [scaled(information_of(step), step.matched_share) for step in matched]
    drawn_m = _SIGMAS * _along(covariance, ahead) * math.sqrt(max(_along(one, ahead) for one in told))
    drawn_rad = _SIGMAS * covariance[5] * math.sqrt(max(one[5] for one in told))
    error_m = min(tolerance.scale * way_m, drawn_m)
    error_rad = min(math.hypot(tolerance.scale * fused.turn, tolerance.yaw_radps * dt_s), drawn_rad)
    lasting, (x, y, _) = max(1.0, 2.0 * _LASTS_S / dt_s), ahead
    along_m2, turn_rad2 = lasting * error_m**2, lasting * error_rad**2
    added = (along_m2 * x * x, along_m2 * x * y, 0.0, along_m2 * y * y, 0.0, turn_rad2)
    return replace(fused, covariance=add(covariance, added))


def offsets_after(
    stated: Sequence[tuple[str, MotionStep]], fused: MotionStep, offsets: Mapping[str, Offset]
) -> Mapping[str, Offset]:
    """Return where the matches have led base after a step, as seen from the belief.

    A localizer that says nothing of the step, or is not believed, begins anew.

    Parameters
    ----------
    stated : sequence of (str, MotionStep)
        As they were told, by localizer.
    fused : MotionStep
        The step of the belief.
    offsets : mapping of str to Offset
        Before it, by localizer.
    """
    if len(stated) < 2:
        return NO_OFFSETS
    found: dict[str, Offset] = {}
    for source, step in stated:
        if step.matched_share:
            before = Pose2(*offsets.get(source, (0.0, 0.0, 0.0)))
            matched = before @ Pose2(step.x, step.y, step.turn)
            away = Pose2(fused.x, fused.y, fused.turn).between(matched)
            information = scaled(information_of(step), step.matched_share)  # of the whole motion
            found[source] = _explained((away.x, away.y, wrap_angle(away.theta)), information)
    return found or NO_OFFSETS


def _explained(away: Offset, information: Sym3) -> Offset:
    """Return the part of an offset that the errors of a match explain."""
    moment = _product(information, away)
    spread = inverse(add(information, _KNOWN))
    if spread is None:
        return 0.0, 0.0, 0.0
    x, y, turn = _product(spread, moment)
    told = _product(information, (x, y, turn))
    sigmas = math.sqrt(max(x * told[0] + y * told[1] + turn * told[2], 0.0))
    share = min(1.0, _SIGMAS / sigmas) if sigmas else 1.0
    return share * x, share * y, share * turn


def _along(a: Sym3, direction: Offset) -> float:
    x, y, turn = _product(a, direction)
    return max(x * direction[0] + y * direction[1] + turn * direction[2], 0.0)


def _product(a: Sym3, vector: Offset) -> Offset:
    xx, xy, xt, yy, yt, tt = a
    x, y, turn = vector
    return xx * x + xy * y + xt * turn, xy * x + yy * y + yt * turn, xt * x + yt * y + tt * turn
