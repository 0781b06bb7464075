"""Certainty without precedent: a localizer does not know a thousand times more from one estimate to the next."""

from __future__ import annotations

import math

from trailmark.estimation.symmetric import NOTHING, Sym3, inverse, scaled

__all__ = ["CertaintyRecord"]

# A standard deviation that is smaller than the smallest before by this factor is believed as small as that one, which
# follows at this rate [1/s]: a camera that comes near to what it sees is soon believed.
_AT_ONCE, _RATE = 3.0, 0.02
_MUCH = _AT_ONCE * _AT_ONCE
# The first estimates set the record [s].
_LEARNS_S = 1.0


class CertaintyRecord:
    """The greatest certainty that one kind of estimate of one localizer has stated so far.

    Estimates of whole poses only: the certainty of a part depends on which part was seen. A motion is also compared by
    its length: one that is slower, or turns on the spot, may be as much more certain as it is shorter. One without a
    length is no precedent, and needs none.
    """

    __slots__ = ("_most", "_most_relative", "_since_s", "_stamp_s", "n_in_a_row")

    def __init__(self) -> None:
        self._most = self._most_relative = (0.0, 0.0)
        self._since_s = self._stamp_s = -math.inf
        self.n_in_a_row = 0

    def restart_clock(self, stamp_s: float) -> None:
        """Go on as if the newest estimate had this stamp, the first of a clock that was set."""
        if self._stamp_s > -math.inf:
            self._since_s += stamp_s - self._stamp_s
            self._stamp_s = stamp_s

    def believed(self, information: Sym3, stamp_s: float, lengths: tuple[float, float] = (1.0, 1.0)) -> Sym3:
        """Return the information, reduced if it is without precedent.

        Parameters
        ----------
        information : Sym3
            As it is stated.
        stamp_s : float
            What it is about [s].
        lengths : (float, float)
            Of a motion, beside which the certainty of its way and of its turn is without precedent, too; 0 at rest [m].
        """
        if inverse(information) is None:
            return information
        xx, _, _, yy, _, tt = information
        stated = max(xx, yy), tt
        relative = stated[0] * lengths[0] * lengths[0], tt * lengths[1] * lengths[1]
        if self._since_s == -math.inf:
            self._since_s = stamp_s
        is_learning = stamp_s - self._since_s <= _LEARNS_S
        dt_s = max(0.0, stamp_s - self._stamp_s) if self._stamp_s > -math.inf else 0.0
        self._stamp_s = max(self._stamp_s, stamp_s)
        share = 1.0
        most, most_relative = self._most, self._most_relative
        for k in (0, 1):
            now = stated[k]
            if now > _MUCH * most[k] > 0.0 and relative[k] > _MUCH * most_relative[k] and now > NOTHING:
                share = min(share, max(most[k] / now, most_relative[k] / relative[k]))
        if is_learning or share == 1.0:
            if (stated[0] > most[0] and lengths[0] > 0.0) or (stated[1] > most[1] and lengths[1] > 0.0):
                self._most = (
                    max(most[0], stated[0]) if lengths[0] > 0.0 else most[0],
                    max(most[1], stated[1]) if lengths[1] > 0.0 else most[1],
                )
            if relative[0] > most_relative[0] or relative[1] > most_relative[1]:
                self._most_relative = max(most_relative[0], relative[0]), max(most_relative[1], relative[1])
            self.n_in_a_row = 0
            return information
        growth = math.exp(2.0 * _RATE * min(dt_s, 1.0))
        self._most = min(self._most[0] * growth, stated[0]), min(self._most[1] * growth, stated[1])
        self._most_relative = (
            min(self._most_relative[0] * growth, relative[0]),
            min(self._most_relative[1] * growth, relative[1]),
        )
        self.n_in_a_row += 1
        return scaled(information, share)
