"""Faults of time: frames that are lost, late, or the same again."""

from __future__ import annotations

import numpy as np

__all__ = ["FrameLoss"]


class FrameLoss:
    """Decides which frames are lost: each by itself, or in runs.

    Runs are a chain of two states, left with the chances that give share and length.

    Parameters
    ----------
    share : float
        Of the frames that are lost.
    in_a_row : float or None
        How many are lost at a time, on average; None: each by itself.
    """

    def __init__(self, share: float, in_a_row: float | None) -> None:
        self._share, self._in_a_row = share, in_a_row
        self._was_lost = False

    def loses(self, rng: np.random.Generator) -> bool:
        """Return whether the next frame is lost; one number is drawn in any case."""
        share, run = self._share, self._in_a_row
        chance = rng.random()  # even for a share of 0: the noise of a frame does not depend on what is dropped
        if run is None or not share:
            return bool(chance < share)
        self._was_lost = bool(chance >= 1.0 / run if self._was_lost else chance < share / (run * (1.0 - share)))
        return self._was_lost
