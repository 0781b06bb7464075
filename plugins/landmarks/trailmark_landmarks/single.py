"""One landmark's range, bearing or both, as a fix that knows no more than they say."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Fix, Lost
from trailmark.geometry import Pose2
from trailmark_landmarks.sightings import Sightings, lever_of

__all__ = ["single_fix"]

_MOST_STEPS = 10
_SETTLED = 1e-6  # [m, rad]


def single_fix(believed: Pose2, covariance: Floats, sighting: Sightings, mounting: Pose2, stamp_s: float) -> Fix | Lost:
    """Return a pose from which one landmark is seen as measured, with the information that this holds.

    Linearised where belief and sighting together are most likely (the iterated extended Kalman filter): an estimator
    that takes the fix to the same belief arrives there.

    Parameters
    ----------
    believed, covariance : Pose2, (3, 3) float64
        Of base, in map axes.
    sighting : Sightings
        Of one landmark: a range, a bearing or both.
    mounting : Pose2
        The sensor on base.
    stamp_s : float
        When [s].

    Returns
    -------
    Fix or Lost
        `Lost` where the landmark is so near that the belief does not tell its direction.
    """
    shift, noise = np.zeros(3), np.diag(sighting.sigmas**2)
    for _ in range(_MOST_STEPS):
        base = Pose2.from_array(believed.array() + shift)
        sensor = base @ mounting
        rows = sighting.derivatives(sensor.array()) @ lever_of(base, sensor)
        miss = sighting.errors(sensor.array())
        gain = covariance @ rows.T
        before, shift = shift, gain @ np.linalg.solve(rows @ gain + noise, miss + rows @ shift)
        if np.abs(shift - before).max() < _SETTLED:
            break
    distance_m = float(np.hypot(*(sighting.landmarks[0] - sensor.array()[:2])))
    spread_m = float(np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[-1]))
    if 2.0 * spread_m > distance_m:
        return Lost(stamp_s, f"the landmark is {distance_m:.2g} m away, its direction is a guess")
    rest = rows.T @ np.linalg.solve(rows @ rows.T, miss)
    weighted = rows / sighting.sigmas[:, np.newaxis]
    return Fix(stamp_s, Pose2.from_array(base.array() + rest), weighted.T @ weighted)
