"""One landmark's range, bearing or both, as a fix that knows no more than they say."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Fix, Lost
from trailmark.geometry import Pose2
from trailmark_landmarks.sightings import NEAREST_M, Sightings, lever_of

__all__ = ["single_fix", "squares_of_curves"]

_MOST_STEPS = 10
_SETTLED = 1e-6  # [m, rad]


def single_fix(believed: Pose2, covariance: Floats, sighting: Sightings, mounting: Pose2, stamp_s: float) -> Fix | Lost:
    """Return a pose from which one landmark is seen as measured, with the information that this holds.

    Linearised where belief and sighting together are most likely (the iterated extended Kalman filter): an estimator
    that takes the fix to the same belief arrives there. What a line does not follow counts as noise
    (`squares_of_curves`): otherwise sightings of a pose that is hardly known, each linearised elsewhere, seem to tell
    what none of them does.

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
    noise += squares_of_curves(sighting, base, mounting, covariance)
    distance_m = float(np.hypot(*(sighting.landmarks[0] - sensor.array()[:2])))
    spread_m = float(np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[-1]))
    if 2.0 * spread_m > distance_m:
        return Lost(stamp_s, f"the landmark is {distance_m:.2g} m away, its direction is a guess")
    rest = rows.T @ np.linalg.solve(rows @ rows.T, miss)
    information = rows.T @ np.linalg.solve(noise, rows)
    return Fix(stamp_s, Pose2.from_array(base.array() + rest), (information + information.T) / 2.0)


def squares_of_curves(sighting: Sightings, base: Pose2, mounting: Pose2, covariance: Floats) -> Floats:
    """Return the mean products, (M, M), of what the derivatives of ranges and bearings leave out over a belief.

    ``tr(H_i P H_j P) / 2 + tr(H_i P) tr(H_j P) / 4`` with the second derivatives H of each number by the pose of base,
    and P its covariance: the terms of the second-order extended Kalman filter (Athans, Wishner & Bertolini 1968),
    whose shift of the mean counts as noise, too. Ranges lie on circles and bearings on a fan about the landmark, and
    the sensor turns on a circle about base.

    Parameters
    ----------
    sighting : Sightings
        M numbers, of one landmark.
    base : Pose2
        Where the derivatives are taken.
    mounting : Pose2
        The sensor on base.
    covariance : (3, 3) float64
        Of base before the sighting, in map axes.
    """
    sensor = base @ mounting
    offset = sighting.landmarks[0] - sensor.array()[:2]
    distance_m = max(float(np.hypot(*offset)), NEAREST_M)
    along = offset / distance_m
    across = np.array([-along[1], along[0]])
    of_range = np.outer(across, across) / distance_m
    of_bearing = -(np.outer(along, across) + np.outer(across, along)) / distance_m**2
    second = np.zeros((len(sighting), 3, 3))
    second[:, :2, :2] = np.where(sighting.is_bearing[:, None, None], of_bearing, of_range)
    lever = lever_of(base, sensor)
    second = lever.T @ second @ lever
    second[:, 2, 2] += sighting.derivatives(sensor.array())[:, :2] @ (base.array() - sensor.array())[:2]
    curves = second @ covariance
    means = 0.5 * np.trace(curves, axis1=1, axis2=2)
    return np.asarray(0.5 * np.einsum("iab,jba->ij", curves, curves) + np.outer(means, means))
