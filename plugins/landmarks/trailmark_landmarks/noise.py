"""The noise of ranges and bearings, learnt from how far they miss what was expected."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Pose2
from trailmark_landmarks.consensus import Consensus
from trailmark_landmarks.sightings import Sightings, lever_of

__all__ = ["NoiseLevel", "SightingNoise"]

#: A squared error beyond so many times its variance counts as this: outliers must not decide what noise is.
_CLIP = 4.0
#: An error beyond so many of its standard deviations is not learnt from, where the belief may be wrong.
_FARTHEST = 10.0
#: Mean of a squared normal number clipped there: P(chi2_3 < 4) + 4 P(chi2_1 > 4).
_MEAN_CLIPPED = 0.9205
_SLOWEST, _EARLIEST = 1.0 / 200.0, 10.0
#: Two sightings of a landmark farther apart say nothing of how long an error lasts [s].
_LASTS_S = 2.0
_MOST_CORRELATED = 0.6
#: A number that pulls the pose to itself further than this leaves nothing over to learn from.
_LEAST_SPARE = 0.05


@dataclass(slots=True)
class NoiseLevel:
    """A variance that follows what is seen: quickly at first, slowly later, within bounds.

    Errors of one landmark that follow each other are seldom independent: a tag is read askew for seconds, a radio's
    echo stays while the robot does. What lasts does not average out, so a single sighting is given less weight, by the
    factor by which an autoregressive error of that correlation shortens a sample, ``(1 + r) / (1 - r)``, at most 4.

    Attributes
    ----------
    variance : float
        Squared standard deviation of one number [m^2 or rad^2].
    lowest, highest : float
        Bounds of it.
    """

    variance: float
    lowest: float
    highest: float
    _n_seen: int = 0
    _power: float = 1.0
    _product: float = 0.0
    _last: dict[int, tuple[float, float]] = field(default_factory=dict)

    @classmethod
    def around(cls, sigma: float) -> NoiseLevel:
        """Return a level that begins at a standard deviation and stays within a fifth and ten times of it."""
        return cls(sigma**2, (sigma / 5.0) ** 2, (sigma * 10.0) ** 2)

    @property
    def sigma(self) -> float:
        """Standard deviation that a single sighting is to be weighed with [m or rad]."""
        correlation = min(max(self._product / self._power, 0.0), _MOST_CORRELATED)
        return math.sqrt(self.variance * (1.0 + correlation) / (1.0 - correlation))

    def learn(self, landmark: int, stamp_s: float, error: float, expected_variance: float) -> None:
        """Take in an error whose variance was expected to be this; the level's own share of that decides how much.

        Parameters
        ----------
        landmark : int
            Whose.
        stamp_s : float
            When [s].
        error : float
            Measured minus expected.
        expected_variance : float
            Of that error: the level's variance, and what the expectation adds or the fit takes away.
        """
        self._n_seen += 1
        gain = max(_SLOWEST, 1.0 / (self._n_seen + _EARLIEST))
        scaled = error / math.sqrt(expected_variance)
        squared = min(scaled * scaled, _CLIP)
        share = min(1.0, self.variance / expected_variance)
        self.variance *= 1.0 + gain * share * (squared / _MEAN_CLIPPED - 1.0)
        self.variance = min(max(self.variance, self.lowest), self.highest)
        last_s, last = self._last.get(landmark, (-math.inf, 0.0))
        if 0.0 < stamp_s - last_s <= _LASTS_S:
            self._product += gain * (min(max(scaled * last, -_CLIP), _CLIP) - self._product)
            self._power += gain * (squared - self._power)
        self._last[landmark] = stamp_s, scaled


class SightingNoise:
    """The noise of ranges and that of bearings.

    Parameters
    ----------
    range_sigma_m, bearing_sigma_rad : float
        To begin with.
    learns : bool
        Whether they change.
    """

    def __init__(self, range_sigma_m: float, bearing_sigma_rad: float, *, learns: bool = True) -> None:
        self.range, self.bearing = NoiseLevel.around(range_sigma_m), NoiseLevel.around(bearing_sigma_rad)
        self._learns = learns

    @property
    def sigmas(self) -> Floats:
        """Standard deviations of a range [m] and of a bearing [rad], (2,)."""
        return np.array([self.range.sigma, self.bearing.sigma])

    def learn_from_fit(self, found: Consensus, sightings: Sightings, stamp_s: float) -> None:
        """Learn from what is left over where more numbers agree than a pose takes."""
        spare = 1.0 - found.leverages
        for index in np.flatnonzero(found.agrees & (spare > _LEAST_SPARE)).tolist():
            self._learn(sightings, index, stamp_s, float(found.errors[index]), own_share=float(spare[index]))

    def learn_from_belief(
        self, believed: Pose2, covariance: Floats, sightings: Sightings, *, mounting: Pose2, stamp_s: float
    ) -> None:
        """Learn from how far sightings miss what the belief, base with its covariance (3, 3), expects of them."""
        sensor = believed @ mounting
        errors = sightings.errors(sensor.array())
        rows = sightings.derivatives(sensor.array()) @ lever_of(believed, sensor)
        expected = np.einsum("mi,ij,mj->m", rows, covariance, rows)
        for index in range(len(sightings)):
            error, from_belief = float(errors[index]), float(expected[index])
            variance = (self.bearing if sightings.is_bearing[index] else self.range).variance + from_belief
            # Beyond this it is the belief that is wrong, or an outlier: neither says what noise is.
            if error * error <= _FARTHEST * _FARTHEST * variance:
                self._learn(sightings, index, stamp_s, error, from_belief=from_belief)

    def _learn(
        self,
        sightings: Sightings,
        index: int,
        stamp_s: float,
        error: float,
        *,
        own_share: float = 1.0,
        from_belief: float = 0.0,
    ) -> None:
        if self._learns:
            level = self.bearing if sightings.is_bearing[index] else self.range
            level.learn(int(sightings.ids[index]), stamp_s, error, own_share * level.variance + from_belief)
