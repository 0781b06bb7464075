"""A motion that is better than any absolute estimate: its scale shows in what a filter has to correct over seconds."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.variance_components import FALLS, GROWS, MOST, Key
from trailmark.geometry import wrap_angle

__all__ = ["Corrected", "LeadingMotion"]

#: Corrections are looked at over so long, so many times; by how many standard deviations of chance their mean square is
#: too much; and the most that one counts.
_CORRECTED_S, _CORRECTIONS, _TOO_MUCH, _MOST_CORRECTED = 4.0, 12, 3.5, 16.0
#: Corrections by absolute estimates, added up, and their covariance.
Corrected = tuple[Floats, Floats]


class LeadingMotion:
    """The scale of the motion that states the greatest certainty, as the corrections by absolute estimates tell it.

    Where a motion is much better than a single absolute estimate, no difference of two shows its error; but that
    everything is corrected the same way for seconds does, as the corrections of a consistent filter are white.

    Attributes
    ----------
    logs : dict of (str, bool) to float
        Log of the scale by localizer, not below zero.
    """

    def __init__(self) -> None:
        self.logs: dict[Key, float] = {}
        self._leader: Key | None = None
        self._since: tuple[float, Floats, Floats] | None = None
        self._squares: deque[float] = deque(maxlen=_CORRECTIONS)

    def observe(self, stamp_s: float, key: Key, corrections: Floats, covariance: Floats) -> None:
        """Look at what was corrected since the last look, if that is long ago; `key` is who leads.

        What was corrected while another led says nothing of this one.
        """
        if key != self._leader:
            self._leader, self._since = key, None
            self._squares.clear()
        since = self._since
        if since is not None and stamp_s < since[0] + _CORRECTED_S:
            return
        self._since = stamp_s, corrections, covariance
        if since is None or stamp_s > since[0] + 2.0 * _CORRECTED_S:
            return
        moved, spread = corrections - since[1], covariance - since[2]
        moved[2] = wrap_angle(float(moved[2]))
        roots = np.sqrt(np.maximum(np.diagonal(spread), 1e-30))
        values, vectors = np.linalg.eigh(spread / np.outer(roots, roots))
        if values[0] < 1e-6:
            return
        square = float((((moved / roots) @ vectors) ** 2 / values).sum())
        self._squares.append(min(square, _MOST_CORRECTED))
        if len(self._squares) < _CORRECTIONS // 2:
            return
        ratio = sum(self._squares) / (3 * len(self._squares))
        if ratio > 1.0 + _TOO_MUCH * math.sqrt(2.0 / (3 * len(self._squares))):
            self.logs[key] = min(self.logs.get(key, 0.0) + _CORRECTED_S * math.log(GROWS) / 4.0, math.log(MOST))
        elif ratio < 1.0 and key in self.logs:
            self.logs[key] = max(self.logs[key] + _CORRECTED_S * math.log(FALLS), 0.0)
