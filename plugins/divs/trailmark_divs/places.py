"""Finds a robot on the path without a belief: small pictures against all taught ones, while it drives.

Streams need a straight window to compare; a picture needs none, so this works on winding ways, from the start.
"""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Float32s, Floats
from trailmark_divs.correspondence import Match
from trailmark_divs.taught_stream import TaughtStream

__all__ = ["PicturePlaces"]

_TINY_PX = (29, 11)  # of a picture that is compared with all: every fourth pixel
_MOST_SHIFT_PX = 7
_PER_SCORE = 14.0  # log probability of a correlation of 1
_SPREAD_SHARE, _SPREAD_M = 0.15, 0.05  # of the way since the last picture, by which it may be wrong
_LEAK = 0.002  # probability of having been carried elsewhere
_NEAR_M = 0.5
_LEAST_UPDATES = 4
_ROUNDING_M = 1e-6


class PicturePlaces:
    """A probability over the taught small pictures.

    Parameters
    ----------
    recording : TaughtStream
        What was taught.
    spacing_m : float
        Way that is driven between two pictures that are asked: nearer ones say the same twice [m].
    """

    def __init__(self, recording: TaughtStream, spacing_m: float) -> None:
        self._stations_m = recording.stations_m[recording.picture_rows, 1]
        self._rows = recording.picture_rows
        self._spacing_m = spacing_m
        self._reduced = _unit(np.array([_tiny(picture) for picture in recording.pictures]))
        self.restart()

    def __len__(self) -> int:
        return len(self._rows)

    def restart(self) -> None:
        """Forget: the robot may be anywhere on the path."""
        n = len(self._rows)
        self._probability = np.full(n, 1.0 / max(n, 1))
        self._travelled_m: float | None = None
        self._n_updates = 0

    def update(self, small: Float32s, travelled_m: float, direction: int) -> None:
        """Take a picture.

        Parameters
        ----------
        small : (h, w) float32
            Small normalised picture.
        travelled_m : float
            Way driven so far; pictures nearer than the spacing to the last one are not asked [m].
        direction : int
            1 when driving along the path, -1 when driving back.
        """
        if not len(self):
            return
        if self._travelled_m is not None:
            advance_m = travelled_m - self._travelled_m
            if advance_m < self._spacing_m - _ROUNDING_M:
                return
            self._advance(direction * advance_m)
        self._travelled_m = travelled_m
        scores = self._scores(small)
        weights = self._probability * np.exp(_PER_SCORE * (scores - scores.max()))
        self._probability = weights / weights.sum()
        self._n_updates += 1

    def match(self, least_probability: float) -> Match | None:
        """Return the likeliest place as a row of the looks; None while none stands out."""
        if self._n_updates < _LEAST_UPDATES:
            return None
        best = int(np.argmax(self._probability))
        near = np.abs(self._stations_m - self._stations_m[best]) <= _NEAR_M
        mass = self._probability[near]
        confidence = float(mass.sum())
        if confidence < least_probability:
            return None
        mean_m = float(mass @ self._stations_m[near]) / confidence
        variance = float(mass @ (self._stations_m[near] - mean_m) ** 2) / confidence
        return Match(int(self._rows[best]), math.sqrt(variance + self._spacing_m**2), confidence)

    def _advance(self, advance_m: float) -> None:
        sigma_m = _SPREAD_SHARE * abs(advance_m) + _SPREAD_M
        apart_m = self._stations_m[:, None] - (self._stations_m + advance_m)[None, :]
        kernel = np.exp(-0.5 * (apart_m / sigma_m) ** 2)
        moved = kernel @ self._probability
        total = float(moved.sum())
        moved = moved / total if total > 0.0 else np.full(len(moved), 1.0 / len(moved))
        self._probability = (1.0 - _LEAK) * moved + _LEAK / len(moved)

    def _scores(self, small: Float32s) -> Floats:
        """Return the best correlation with every taught picture over horizontal shifts, (K,)."""
        seen = _tiny(small)
        width = seen.shape[1]
        best = np.full(len(self._rows), -1.0)
        for shift in range(-_MOST_SHIFT_PX, _MOST_SHIFT_PX + 1):
            moved = np.zeros_like(seen)
            moved[:, max(0, -shift) : width - max(0, shift)] = seen[:, max(0, shift) : width - max(0, -shift)]
            best = np.maximum(best, self._reduced @ _unit(moved[None])[0])
        return np.asarray(best, dtype=np.float64)


def _tiny(small: Float32s) -> Float32s:
    import cv2

    return np.asarray(cv2.resize(small, _TINY_PX, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _unit(pictures: Float32s) -> Float32s:
    """Return pictures as rows of mean 0 and length 1, (K, h w)."""
    rows = pictures.reshape(len(pictures), math.prod(pictures.shape[1:]))
    rows = rows - rows.mean(axis=1, keepdims=True) if rows.size else rows
    return np.asarray(rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-6), dtype=np.float32)
