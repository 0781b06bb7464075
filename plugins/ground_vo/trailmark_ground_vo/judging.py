"""Whether what the search found is a match: by its error, and by what the error has been."""

from __future__ import annotations

import math
from collections import deque
from statistics import median

from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.viewpoint import GroupMatch

__all__ = ["MatchJudge", "MatchPair"]

#: Matches of the lower and of the upper group.
MatchPair = tuple[GroupMatch, GroupMatch]

#: Pictures whose error says what is usual.
_USUAL_FRAMES = 50

#: Error on a smoothed picture per noise of the picture that may be noise: twice what was measured on eight floors.
_NOISE_FACTOR = 0.8

#: An error so many times what it has been is no surprise.
_USUAL_FACTOR = 1.5

#: Errors below this say nothing: light that changes by two percent does as much [grey levels].
_QUIET_LEVELS = 3.0


class MatchJudge:
    """Separates matches from places that look a little alike.

    Parameters
    ----------
    config : GroundVOConfig
        The limits: `max_error_ratio`, `max_error_share`, `max_error_growth`.
    max_shift_px : int
        Largest shift that is searched for: what is faster has no match [px].
    """

    def __init__(self, config: GroundVOConfig, max_shift_px: int) -> None:
        self._config = config
        self._fast = f"too fast: max_shift_px is {max_shift_px}"
        self._usual: deque[float] = deque(maxlen=_USUAL_FRAMES)

    def forget(self) -> None:
        """Forget how large the error has been: other pixels are compared from now on."""
        self._usual.clear()

    def accept(self, matches: MatchPair) -> None:
        """Remember the error of matches that were believed."""
        self._usual.append(mean_error(matches))

    def reason_lost(self, matches: MatchPair, noise: float | None) -> str:
        """Return why the matches are not to be believed; empty when they are.

        Parameters
        ----------
        matches : (GroupMatch, GroupMatch)
            Of the lower and of the upper group.
        noise : float or None
            Noise of the picture, where the search looks at a smoothed one [grey levels].
        """
        error, mean = mean_error(matches), (matches[0].mean_error + matches[1].mean_error) / 2
        if error > self._largest_error(mean, noise) or mean == 0.0:
            return f"no match: error {error:.1f} of {mean:.1f} grey levels (blank, covered, blurred or {self._fast})"
        usual = max(_QUIET_LEVELS, median(self._usual)) if self._usual else math.inf
        if error > self._config.max_error_growth * usual:
            return f"bad match: error {error:.1f} grey levels, usually {usual:.1f} (covered, blurred or {self._fast})"
        return ""

    def _largest_error(self, mean: float, noise: float | None) -> float:
        """Return the largest error of a match: what noise explains, and a share of what any place would give."""
        most = self._config.max_error_ratio * mean
        if noise is None:
            return most
        usual = _USUAL_FACTOR * median(self._usual) if self._usual else 0.0
        return min(most, max(self._config.max_error_share * mean + _NOISE_FACTOR * noise, usual))


def mean_error(matches: MatchPair) -> float:
    """Return the mean of both groups' least errors per pixel [grey levels]."""
    return (matches[0].error + matches[1].error) / 2
