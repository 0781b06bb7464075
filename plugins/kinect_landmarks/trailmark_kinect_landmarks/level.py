"""Whether the camera stays level, as ``solve: plane`` takes for granted: then landmarks keep their heights."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Floats

__all__ = ["LevelWatch", "tilt_rad"]

#: Level robots show 0.1 deg, 0.6 deg with the paper's angles and few landmarks.
_TILT_RAD = math.radians(1.0)
_IN_A_ROW = 2  # pictures: a robot nods once where it drives over a sill
_LEAST_LANDMARKS = 8
_SOFT_RAD = math.radians(0.5)  # angle of elevation by which a landmark may be wrong
_PRIOR = 0.01  # of one landmark's weight: the turn about an axis that none of them shows is none
_N_STEPS = 8


def tilt_rad(points_base: Floats, heights_map_m: Floats) -> float:
    """Return by how much the camera is tilted, from the heights of landmarks.

    A tilt lifts landmarks by an angle of elevation that goes with the cosine of their direction. Who does not fit
    hardly counts (Geman & McClure): a thing that is lifted tilts nothing.

    Parameters
    ----------
    points_base : (N, 3) float64
        Landmarks as they are seen from a base that is taken for level [m].
    heights_map_m : (N,) float64
        Their heights as remembered [m].

    Returns
    -------
    float
        Angle between the axis of the base that is taken for vertical and the vertical [rad].
    """
    ranges_m = np.maximum(np.linalg.norm(points_base[:, :2], axis=1), 1e-6)
    J = points_base[:, :2] / ranges_m[:, None]
    lifted_rad = (heights_map_m - points_base[:, 2]) / ranges_m
    tilt = np.array([float(np.median(lifted_rad)), 0.0])
    for _ in range(_N_STEPS):
        misses = np.abs(lifted_rad - J @ tilt)
        soft = max(_SOFT_RAD, 1.5 * float(np.median(misses)))
        weights = (1.0 + (misses / soft) ** 2) ** -2.0
        tilt = np.linalg.solve((J.T * weights) @ J + _PRIOR * np.eye(2), (J.T * weights) @ lifted_rad)
    return float(np.hypot(*tilt))


class LevelWatch:
    """Knows whether poses are solved in the plane: as it is told, until the camera is seen to tilt.

    Parameters
    ----------
    is_level : bool
        Whether the camera is told to stay level.
    """

    def __init__(self, is_level: bool) -> None:
        self.is_level = is_level
        self._n_tilted = 0

    @property
    def n_dimensions(self) -> int:
        """2 in the plane, 3 in space."""
        return 2 if self.is_level else 3

    def notices_tilt(self, points_base: Floats, heights_map_m: Floats) -> bool:
        """Take landmarks of a picture (see `tilt_rad`); return whether they show for the first time that it tilts."""
        if not self.is_level or len(points_base) < _LEAST_LANDMARKS:
            return False
        is_tilted = tilt_rad(points_base, heights_map_m) > _TILT_RAD
        self._n_tilted = self._n_tilted + 1 if is_tilted else 0
        self.is_level = self._n_tilted < _IN_A_ROW
        return not self.is_level
