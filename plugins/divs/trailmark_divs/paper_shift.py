"""Shift as the reference implementation finds it: circular windowed correlation and hill climbing (Sec. III).

Sign, here and everywhere: positive when what the replay sees lies further right than in the teach picture,
which is when the robot stands left of the path or is turned to the left. Unit: columns.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trailmark.kernels import kernel

__all__ = ["PaperShift", "hill_climb", "winc"]


@kernel
def _centre_and_scale(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Subtract the mean and divide by the largest magnitude; constant values become zeros."""
    centred = values - values.mean()
    largest = np.abs(centred).max()
    return np.asarray(centred / largest if largest > 0.0 else centred)


@kernel
def winc(taught: npt.NDArray[np.float64], seen: npt.NDArray[np.float64], window: int) -> npt.NDArray[np.float64]:
    """Windowed correlation of two change vectors, Eq. (8), as the reference computes it.

    Each window of the teach vector, and the whole replay vector, are centred and divided by their largest
    magnitude (no Pearson normalisation), correlated circularly, and added up at the place of the window.

    Parameters
    ----------
    taught, seen : (d,) float64
        Change vectors of the teach and the replay step.
    window : int
        Length of a window, e.

    Returns
    -------
    (2 d,) float64
        Response to each shift; index d is no shift.
    """
    d = len(taught)
    replay = _centre_and_scale(seen)
    response = np.zeros(2 * d, dtype=np.float64)
    for start in range(d - window + 1):
        piece = _centre_and_scale(taught[start : start + window])
        for lag in range(d):
            total = 0.0
            for m in range(window):
                total += replay[(lag + m) % d] * piece[m]
            response[d - start + lag] += total
    return response


@kernel
def hill_climb(response: npt.NDArray[np.float64], index: int) -> int:
    """Return where the reference climbs to from the last index (Fig. 1).

    Uphill to the left and to the right, across plateaus; of the two summits the one with the larger height
    above the lowest response per column of distance, the right one of equals.
    """
    lowest = response.min()
    summits = np.array([index, index])
    scores = np.zeros(2)
    for side in range(2):
        step = 1 if side else -1
        best = response[index] - lowest
        place = index + step
        while 0 <= place < len(response) and response[place] - lowest >= best:
            best = response[place] - lowest
            summits[side] = place
            place += step
        distance = abs(summits[side] - index)
        scores[side] = best / distance if distance > 0 else best
    return int(summits[1] if scores[1] >= scores[0] else summits[0])


class PaperShift:
    """Shift from pair to pair of change vectors: the global maximum first, hill climbing from then on.

    Parameters
    ----------
    window : int
        As `winc` takes it.
    """

    def __init__(self, window: int) -> None:
        self._window = window
        self._index: int | None = None

    def restart(self) -> None:
        """Forget the last shift: the next one is a global maximum again."""
        self._index = None

    def update(self, taught: npt.NDArray[np.float64], seen: npt.NDArray[np.float64]) -> float:
        """Return the shift [columns]; see `winc` for the arguments."""
        response = winc(taught, seen, self._window)
        if self._index is None:
            self._index = int(np.argmax(response))
        else:
            self._index = hill_climb(response, self._index)
        return float(self._index - len(taught))
