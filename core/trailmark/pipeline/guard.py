"""The guard: stops the robot when nothing has said for too long where it is."""

from __future__ import annotations

import math

from trailmark.commands import Stop
from trailmark.config import StopWhen
from trailmark.estimates import Belief

__all__ = ["Guard"]

# Differences of stamps and sums of steps: at the limit is not beyond it.
_SLACK = 1e-9


class Guard:
    """Says `Stop` while the belief is older than ``stop_when`` allows, whatever the controller says.

    Before the first absolute estimate the way counts from the start, and before the first motion the time does:
    a robot that starts without a fix may drive the same way to find one.

    Parameters
    ----------
    stop_when : StopWhen
        The limits.
    give_up_s : float
        A robot that was stopped for so long will not find itself any more: the run ends [s].
    """

    def __init__(self, stop_when: StopWhen, give_up_s: float = 10.0) -> None:
        self._stop_when = stop_when
        self._give_up_s = give_up_s
        self._start: Belief | None = None
        self._stopped_s: float | None = None

    @property
    def is_on(self) -> bool:
        """Whether there is a limit."""
        return self._stop_when.fix_age_m is not None or self._stop_when.motion_age_s is not None

    def check(self, belief: Belief) -> Stop | None:
        """Return why the robot has to stop; None while all is well."""
        if self._start is None:
            self._start = belief
        reason = self._too_old(belief, self._start)
        if reason is None:
            self._stopped_s = None
            return None
        self._stopped_s = belief.stamp_s if self._stopped_s is None else self._stopped_s
        return Stop(reason)

    def has_given_up(self, now_s: float) -> bool:
        """Return whether the robot has been stopped for too long."""
        return self._stopped_s is not None and now_s - self._stopped_s > self._give_up_s

    def _too_old(self, belief: Belief, start: Belief) -> str | None:
        fix_limit_m, motion_limit_s = self._stop_when.fix_age_m, self._stop_when.motion_age_s
        if fix_limit_m is not None:
            way_m = belief.fix_age_m if math.isfinite(belief.fix_age_m) else belief.travelled_m - start.travelled_m
            if way_m > fix_limit_m + _SLACK:
                return f"no absolute estimate for {way_m:.2f} m (stop_when.fix_age_m: {fix_limit_m:g})"
        if motion_limit_s is not None:
            age_s = belief.motion_age_s if math.isfinite(belief.motion_age_s) else belief.stamp_s - start.stamp_s
            if age_s > motion_limit_s + _SLACK:
                return f"no motion for {age_s:.2f} s (stop_when.motion_age_s: {motion_limit_s:g})"
        return None
