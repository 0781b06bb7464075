"""Corrections that lie to one side: before it is clear that a motion is wrong, the belief is less certain.

The innovations of a consistent filter are white. Where absolute estimates correct the belief to one side by more than
chance does in one belief of a hundred, something drifts: a motion whose scale is wrong, a gyro, a clock. The tests of
`fault_detection` wait until that is sure, and ask who is wrong; until then the belief may be off by as much as absolute
estimates lay beside it in the mean. Nothing is concluded of what was not seen: after the last absolute estimate the
belief grows by its motion alone.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator
from operator import itemgetter

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.diagnosis import FaultDiagnosis
from trailmark.estimation.kalman.gate import NOTHING_BESIDE, threshold
from trailmark.estimation.kalman.innovation import Innovation, least_squares
from trailmark.estimation.kalman.state import FilterState
from trailmark.geometry import wrap_angle

__all__ = ["InnovationSums", "covariance_of_one_sided_corrections", "longest_one_sided_since"]

# Three directions since up to five anchors are tested: about one belief in a hundred of a consistent filter is taken
# for one that is not.
_PROBABILITY = 0.99 ** (1.0 / 15.0)
# Where it is contradicted already, less is asked: a question that begins too early costs time alone.
_OF_CONTRADICTED = 0.997
# A window whose last absolute estimate lies farther back than so much of it says nothing of now.
_STALE_SHARE = 0.5
# A variance below this says that nothing was corrected [m^2, rad^2].
_UNCORRECTED = 1e-12


class InnovationSums:
    """Innovations since an anchor, added up: each belief looks at those of seconds, and one or two of them are new."""

    def __init__(self) -> None:
        self._anchor: FilterState | None = None
        self._seen: list[Innovation] = []
        self._sums: list[tuple[Floats, float, float]] = []  # gains, largest way and turn, until each of them
        self._corrections: Floats | None = None
        self._answers: dict[FilterState, bool] = {}  # by anchor, for these corrections
        self._squares: dict[FilterState, Floats] = {}

    def until_now(self, state: FilterState, anchor: FilterState) -> tuple[Floats, float, float]:
        """Return the sum of the gains in the pose, (3, 3), and the largest way and turn of ``H^-1 y`` [m, rad].

        Parameters
        ----------
        state : FilterState
            With innovations.
        anchor : FilterState
            Since when they count; one at least is younger.
        """
        innovations, seen, sums = state.diagnosis.innovations, self._seen, self._sums
        first = bisect_right(innovations, anchor.stamp_s, key=itemgetter(0))
        n_known = min(len(innovations) - first, len(seen)) if anchor is self._anchor else 0
        while n_known and seen[n_known - 1] is not innovations[first + n_known - 1][1]:
            n_known -= 1  # what came late redid them: of one that is the same all before it are
        del seen[n_known:], sums[n_known:]
        self._anchor = anchor
        for _, innovation in innovations[first + n_known :]:
            way_m, turn_rad, gain = innovation.size_in_pose()
            if sums:
                gains, largest_m, largest_rad = sums[-1]
                gain, way_m, turn_rad = gains + gain, max(largest_m, way_m), max(largest_rad, turn_rad)
            seen.append(innovation)
            sums.append((gain, way_m, turn_rad))
        return sums[-1]

    def answers_for(self, state: FilterState) -> dict[FilterState, bool]:
        """Return since which anchors corrections lie to one side, so far as that was asked since the last of them."""
        if self._corrections is not state.diagnosis.corrections:
            self._corrections, self._answers, self._squares = state.diagnosis.corrections, {}, {}
        return self._answers

    def squared_mean(self, state: FilterState, anchor: FilterState) -> Floats:
        """Return the square of the mean innovation since an anchor, (3, 3), for which `answers_for` was asked."""
        known = self._squares.get(anchor)
        if known is None:
            moved = state.diagnosis.corrections - anchor.diagnosis.corrections
            moved[2] = wrap_angle(float(moved[2]))
            mean = _mean_innovation(self.until_now(state, anchor), moved)
            known = self._squares[anchor] = mean[:, np.newaxis] * mean
        return known


def covariance_of_one_sided_corrections(state: FilterState, sums: InnovationSums | None = None) -> Floats:
    """Return the square of the mean innovation, (3, 3), where corrections lie to one side; zeros where they do not.

    Parameters
    ----------
    state : FilterState
        With the anchors since which corrections are added up.
    sums : InnovationSums, optional
        Of the last question, which spares most of the work.
    """
    sums = InnovationSums() if sums is None else sums
    anchor = next(_one_sided_since(state, _PROBABILITY, sums.answers_for(state)), None)
    if anchor is None:
        return NOTHING_BESIDE
    return sums.squared_mean(state, anchor)


def longest_one_sided_since(state: FilterState) -> FilterState | None:
    """Return the oldest anchor since which corrections lie to one side; None if there is none.

    A belief that is corrected to one side has been wrong from then on: who caused it is to be asked from there.

    Parameters
    ----------
    state : FilterState
        With the anchors since which corrections are added up.
    """
    return min(_one_sided_since(state, _OF_CONTRADICTED, {}), key=lambda one: one.stamp_s, default=None)


def _one_sided_since(state: FilterState, probability: float, answers: dict[FilterState, bool]) -> Iterator[FilterState]:
    """Yield the anchors since which corrections lie to one side, the newest first; `answers` are those known."""
    diagnosis = state.diagnosis
    if state.gaussian is None or not diagnosis.innovations or diagnosis.rivals:
        return
    last_s = diagnosis.innovations[-1][0]
    for anchor in (*diagnosis.anchors[:1], *reversed(diagnosis.far_anchors)):
        if last_s <= anchor.stamp_s or state.stamp_s - last_s > _STALE_SHARE * (state.stamp_s - anchor.stamp_s):
            continue  # an absolute estimate at the very instant of an anchor is none since then
        if anchor not in answers:
            answers[anchor] = _lies_to_one_side(diagnosis, anchor.diagnosis, threshold(probability, 1))
        if answers[anchor]:
            yield anchor


def _lies_to_one_side(now: FaultDiagnosis, then: FaultDiagnosis, limit: float) -> bool:
    """Return whether the corrections between two instants are beyond a limit, in squares of standard deviations."""
    x, y, turn = (now.corrections - then.corrections).tolist()
    xx, yy, tt = (now.correction_covariance.diagonal() - then.correction_covariance.diagonal()).tolist()
    turn = wrap_angle(turn)
    is_beyond = (
        x * x > limit * max(xx, _UNCORRECTED)
        or y * y > limit * max(yy, _UNCORRECTED)
        or turn * turn > limit * max(tt, _UNCORRECTED)
    )
    return bool(is_beyond)


def _mean_innovation(sums: tuple[Floats, float, float], moved: Floats) -> Floats:
    """Return the mean of innovations in the pose, (3,), each weighted by its gain.

    With gains ``K H`` in the pose and corrections ``K v`` it is ``(sum K H)^-1 sum K v``, and in way and turn no more
    than the largest ``H^-1 v``.
    """
    gains, largest_m, largest_rad = sums
    x, y, turn = least_squares(gains, moved)
    shorter = min(1.0, largest_m / max(math.hypot(x, y), _UNCORRECTED))
    return np.array([shorter * x, shorter * y, math.copysign(min(abs(turn), largest_rad), turn)])
