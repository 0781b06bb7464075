"""Frame selection: which pictures make the stream (Eqs. 1, 2 and 14)."""

from __future__ import annotations

import math

from trailmark_divs.options import Select

__all__ = ["FrameSelector"]

_ROUNDING = 1e-6  # stamps since 1970 are good to 0.2 us: a step reached but for rounding is reached


class FrameSelector:
    """Picks the pictures of a stream.

    Eq. (14), read as "the first t' such that q k <= d(t') - d(t)": the k-th picture belongs to the k-th step of
    a grid that starts with the first one, so that a late picture does not delay all that follow.

    Parameters
    ----------
    by : {"distance", "time", "every"}
        What the step is measured in.
    step : float
        Way or time between pictures, q [m or s].
    """

    def __init__(self, by: Select, step: float) -> None:
        self._by = by
        self._step = step
        self._first: float | None = None
        self._next = 0.0

    def is_due(self, stamp_s: float, travelled_m: float) -> bool:
        """Return whether the picture of this instant and way belongs to the stream."""
        if self._by == "every":
            return True
        passed = travelled_m if self._by == "distance" else stamp_s
        if self._first is None:
            self._first = passed
        steps = (passed - self._first) / self._step
        if steps < self._next - _ROUNDING:
            return False
        self._next = math.floor(steps + _ROUNDING) + 1.0
        return True
