"""Which taught window belongs to the present one: by index, time or distance (Eqs. 10 to 13)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.estimates import Belief
from trailmark_divs.eye import DifferenceWindow
from trailmark_divs.options import Correspond
from trailmark_divs.windows import Windows

__all__ = ["ByDistance", "ByIndex", "ByTime", "Correspondence", "Match", "direction", "nearest", "present_station"]


@dataclass(frozen=True, slots=True)
class Match:
    """A taught window, and what is known of the place along the path by matching it.

    Attributes
    ----------
    row : int
        Index of the taught window.
    sigma_station_m : float or None
        Standard deviation of its station as the robot's; None when the station was assumed, not measured [m].
    confidence : float
        Probability that the row is right, for a measured one.
    """

    row: int
    sigma_station_m: float | None = None
    confidence: float = 1.0


class Correspondence(ABC):
    """Finds the taught window that belongs to a replayed one."""

    @abstractmethod
    def match(self, window: DifferenceWindow, belief: Belief) -> Match | None:
        """Return the match; None where nothing was taught."""

    def reset(self, window: DifferenceWindow, row: int) -> None:  # noqa: B027  (what takes its place from the belief has no origin)
        """Set the origin anew: `window` belongs to `row`."""


def direction(belief: Belief) -> int:
    """Return 1 when driving forwards or standing, -1 when driving backwards."""
    return -1 if belief.twist.forward_mps < 0.0 else 1


def present_station(window: DifferenceWindow, belief: Belief) -> float | None:
    """Return the station of a window's middle by the belief, None while the place on the path is unknown [m]."""
    if belief.on_path is None:
        return None
    return belief.on_path.station_m - direction(belief) * (belief.travelled_m - window.travelled_m)


def nearest(labels: npt.NDArray[np.float64], value: float, tolerance: float) -> int | None:
    """Return the index of the nearest of increasing labels, Eq. (10); None when it is farther than `tolerance`."""
    if not len(labels):
        return None
    after = int(np.searchsorted(labels, value))
    candidates = [row for row in (after - 1, after) if 0 <= row < len(labels)]
    row = min(candidates, key=lambda candidate: abs(float(labels[candidate]) - value))
    return row if abs(float(labels[row]) - value) <= tolerance else None


class _ByLabel(Correspondence):
    """Correspondence by a number that both steps carry.

    Parameters
    ----------
    labels : (M,) float64
        Of the taught windows, increasing.
    window : int
        Pictures in a window: half of that is how far a match may lie beyond an end or in a gap.
    """

    def __init__(self, labels: npt.NDArray[np.float64], window: int) -> None:
        self._labels = labels
        step = float(np.median(np.diff(labels))) if len(labels) > 1 else 0.0
        self._tolerance = step * max(1.0, window / 2.0)
        self._origin = 0.0

    @abstractmethod
    def _label(self, window: DifferenceWindow, belief: Belief) -> float | None: ...

    def match(self, window: DifferenceWindow, belief: Belief) -> Match | None:
        label = self._label(window, belief)
        row = None if label is None else nearest(self._labels, label + self._origin, self._tolerance)
        return None if row is None else Match(row)


class ByDistance(_ByLabel):
    """By the way along the path, Eq. (13). The belief knows it; a fix of the station resets its origin.

    Parameters
    ----------
    windows : Windows
        Differences of the taught path.
    window : int
        How many of them are compared at a time.
    """

    def __init__(self, windows: Windows, window: int) -> None:
        super().__init__(windows.stations_m, window)

    def _label(self, window: DifferenceWindow, belief: Belief) -> float | None:
        return present_station(window, belief)


class ByTime(_ByLabel):
    """By the time since the start, Eq. (12): both steps at the same speed.

    Parameters
    ----------
    windows : Windows
        Differences of the taught path.
    window : int
        How many of them are compared at a time.
    start_s : float
        Stamp at which the replay starts [s].
    """

    def __init__(self, windows: Windows, window: int, start_s: float) -> None:
        super().__init__(windows.elapsed_s, window)
        self._start_s = start_s

    def _label(self, window: DifferenceWindow, belief: Belief) -> float | None:
        return window.stamp_s - self._start_s

    def reset(self, window: DifferenceWindow, row: int) -> None:
        self._origin = float(self._labels[row]) - (window.stamp_s - self._start_s)


class ByIndex(_ByLabel):
    """By the number of pictures since the start, Eq. (11): the same speed and the same sampling.

    Parameters
    ----------
    windows : Windows
        Differences of the taught path.
    window : int
        How many of them are compared at a time.
    """

    def __init__(self, windows: Windows, window: int) -> None:
        super().__init__(windows.ordinals.astype(np.float64), window)

    def _label(self, window: DifferenceWindow, belief: Belief) -> float | None:
        return float(window.ordinal)

    def reset(self, window: DifferenceWindow, row: int) -> None:
        self._origin = float(self._labels[row]) - window.ordinal


def make_correspondence(by: Correspond, windows: Windows, window: int, start_s: float) -> Correspondence:
    """Return one of the paper's three correspondences; `start_s` is the stamp of the first picture.

    Parameters
    ----------
    by : Correspond
        ``distance``, ``time`` or ``index``: Eqs. (13), (12), (11).
    windows : Windows
        Differences of the taught path.
    window : int
        How many of them are compared at a time.
    start_s : float
        Stamp of the first picture [s].

    Returns
    -------
    Correspondence
        The correspondence.
    """
    if by == "time":
        return ByTime(windows, window, start_s)
    return ByIndex(windows, window) if by == "index" else ByDistance(windows, window)
