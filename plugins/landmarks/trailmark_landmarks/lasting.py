"""What sightings are off by without averaging out: a wall before a beacon, a landmark or a map in another place."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from trailmark.arrays import Floats
from trailmark_landmarks.consensus import Consensus
from trailmark_landmarks.sightings import Sightings

__all__ = ["LastingErrors"]

#: Means are of about the last so many looks, and an error lasts that is the same in so many.
_N_LOOKS, _ENOUGH_LOOKS = 30, 12
#: So many standard errors from nothing, a mean is no chance.
_SURE = 3.0
_SURE_SHARED = 2.0
#: Looks at a landmark that are farther apart than this are of another place [s].
_LASTS_S = 5.0
#: An error that is this share of the noise or more is worth a word.
_WORTH_SAYING = 2.0
#: A number that pulls the pose to itself further than this says nothing of its own error.
_LEAST_SPARE = 0.1
_MOST_OFF = 2.0  # gates
#: A common scale: less than this no survey and no radio promises, and so many fits tell it.
_LEAST_SCALE, _ENOUGH_FITS, _SLOWEST_FIT = 0.02, 20, 1.0 / 100.0


@dataclass(slots=True)
class _Mean:
    """Of one landmark's errors of one kind, and what chance makes of it."""

    n: int = 0
    mean: float = 0.0
    square: float = 0.0
    believed: float = 0.0
    last_s: float = -math.inf
    rate_hz: float = 1.0

    def add(self, error: float, believed: float, stamp_s: float) -> None:
        since_s = stamp_s - self.last_s
        if not 0.0 < since_s <= _LASTS_S:
            self.n = 0
        self.n += 1
        gain = max(1.0 / _N_LOOKS, 1.0 / self.n)
        self.mean += gain * (error - self.mean)
        self.square += gain * (error * error - self.square)
        self.believed += gain * (believed - self.believed)
        if self.n > 1:
            self.rate_hz += max(gain, 0.5 / self.n) * (1.0 / since_s - self.rate_hz)
        self.last_s = stamp_s

    @property
    def lasting(self) -> float:
        """Square of what lasts, chance and what is not known of the pose taken off."""
        if self.n < _ENOUGH_LOOKS:
            return 0.0
        return max(0.0, self.mean**2 - _SURE**2 * self.chance)

    @property
    def chance(self) -> float:
        """Variance of the mean, if nothing lasts: neighbouring looks are alike, as if every third counted."""
        return 3.0 * max(self.square - self.mean**2, 0.0) / min(self.n, _N_LOOKS) + self.believed


@dataclass(slots=True)
class _Scale:
    """Line through range errors over the ranges expected: its slope is a scale that all have in common."""

    n: int = 0
    sums: Floats = field(default_factory=lambda: np.zeros(6))

    def add(self, expected_m: Floats, errors_m: Floats) -> None:
        self.n += 1
        gain = max(_SLOWEST_FIT, 1.0 / self.n)
        x, y = expected_m, errors_m
        new = np.array([np.ones_like(x), x, y, x * x, x * y, y * y]).mean(axis=1)
        self.sums += gain * (new - self.sums)

    @property
    def slope(self) -> float:
        """The scale less one; 0 where it is no more than chance and each landmark's own error make."""
        if self.n < _ENOUGH_FITS:
            return 0.0
        _, x, y, xx, xy, yy = self.sums.tolist()
        spread, slope = xx - x * x, 0.0
        if spread > 0.0:
            slope = (xy - x * y) / spread
        left = max(yy - y * y - slope * slope * spread, 0.0)
        is_sure = abs(slope) > _SURE * math.sqrt(left / max(spread, 1e-9) / _ENOUGH_FITS)
        # a scale passes through nothing at no range: an offset of all ranges is none
        is_scale = abs(y - slope * x) < 0.5 * abs(slope) * x
        return slope if is_sure and is_scale and abs(slope) > _LEAST_SCALE else 0.0


class LastingErrors:
    """Errors of single landmarks, and a scale of all ranges, that stay the same over many looks."""

    def __init__(self) -> None:
        self._means: dict[tuple[int, bool], _Mean] = {}
        self._scale = _Scale()
        #: What lasts in all of a kind together: a belief that follows several wrong ones spreads their errors.
        self._shared = {False: 0.0, True: 0.0}

    def variances(self, sightings: Sightings, *, alone: bool = False) -> Floats:
        """Return what to add to the variance of each number, (M,) [m^2, rad^2].

        Parameters
        ----------
        sightings : Sightings
            The numbers.
        alone : bool
            Whether each becomes a fix by itself: an estimator takes their errors for independent, so that the looks of
            the time in which they last have to tell no more than one.
        """
        found = np.zeros(len(sightings))
        for index, key in enumerate(zip(sightings.ids.tolist(), sightings.is_bearing.tolist())):
            mean = self._means.get(key)
            if mean is not None:
                lasting = max(mean.lasting, self._shared[key[1]]) if alone else mean.lasting
                found[index] = lasting * (max(1.0, mean.rate_hz * _LASTS_S) if alone else 1.0)
        return found

    def add_fit(self, found: Consensus, sightings: Sightings, stamp_s: float) -> None:
        """Take in what is left over of numbers of which more agree than a pose takes."""
        spare = 1.0 - found.leverages
        clipped = np.clip(found.errors, -_MOST_OFF * sightings.gates, _MOST_OFF * sightings.gates)
        for index in np.flatnonzero(spare > _LEAST_SPARE).tolist():
            self._of(sightings, index).add(float(clipped[index] / spare[index]), 0.0, stamp_s)
        is_range = ~sightings.is_bearing & found.agrees
        if is_range.sum() > 1 and sightings.is_bearing.any():
            self._scale.add((sightings.measured - found.errors)[is_range], found.errors[is_range])

    def add_alone(self, sightings: Sightings, errors: Floats, believed: Floats, stamp_s: float) -> None:
        """Take in how far single sightings miss what the belief expects, whose own variance in them is `believed`."""
        clipped = np.clip(errors, -_MOST_OFF * sightings.gates, _MOST_OFF * sightings.gates)
        for index in range(len(sightings)):
            self._of(sightings, index).add(float(clipped[index]), float(believed[index]), stamp_s)
        for kind in self._shared:
            means = [
                one
                for (_, is_bearing), one in self._means.items()
                if is_bearing == kind and one.n >= _ENOUGH_LOOKS and stamp_s - one.last_s < _LASTS_S
            ]
            if len(means) > 1:
                excess = sum(one.mean**2 - _SURE_SHARED * one.chance for one in means) / len(means)
                self._shared[kind] = max(0.0, excess)

    def of_scale(self, landmarks: Floats) -> float:
        """Return the variance of a place by a scale that ranges and map do not have in common [m^2].

        Nobody knows whether the ranges or the map are wrong, nor which point of the map is where it should be.

        Parameters
        ----------
        landmarks : (N, 2) float64
            All of the map [m].
        """
        slope = self._scale.slope
        return slope * slope * float(landmarks.var(axis=0).sum()) / 2.0

    def in_words(self, range_sigma_m: float, bearing_sigma_rad: float) -> str:
        """Return what is worth a word, in a line; nothing where all is well."""
        slope = self._scale.slope
        if slope:
            more = "longer" if slope > 0.0 else "shorter"
            return f"ranges are {abs(slope):.0%} {more} than the map says: poses are as uncertain as that"
        told = []
        for (landmark, is_bearing), mean in sorted(self._means.items()):
            sigma = bearing_sigma_rad if is_bearing else range_sigma_m
            if math.sqrt(mean.lasting) > _WORTH_SAYING * sigma:
                off = f"{math.degrees(mean.mean):+.1f} deg" if is_bearing else f"{mean.mean:+.2g} m"
                told.append(f"{landmark} ({'bearing' if is_bearing else 'range'} {off})")
        if not told:
            return ""
        return f"landmarks that are lastingly off: {', '.join(told[:3])}{' ...' if told[3:] else ''}"

    def _of(self, sightings: Sightings, index: int) -> _Mean:
        return self._means.setdefault((int(sightings.ids[index]), bool(sightings.is_bearing[index])), _Mean())
