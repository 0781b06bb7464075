"""From a shift to a drift: Eqs. (15) and (16), and the gain of a column."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.estimates import information_along
from trailmark.frames import Calibration, Pinhole

__all__ = ["DriftLaw", "GainLearner", "radians_per_column"]

# Eqs. (15) and (16) for a gain of 1.
_HEADING_RAD_PER_COLUMN = math.radians(1.0)
_LATERAL_M_PER_COLUMN = 0.01
_HEADING_LIMIT_RAD = math.radians(10.0)
_LATERAL_LIMIT_M = 0.5

# A path that turns less than this turns too little for a shift to say anything of use about the station; an
# estimator that shares a number out evenly among what it depends on would move the station by metres.
_LEAST_BEND_PER_M = 0.3

_LEAST_TURN_RAD = math.radians(1.5)
_MOST_WAY_M = 1.0
_MOST_RATIO = 4.0


def radians_per_column(
    calibration: Calibration | None, field_of_view_deg: float | None, column_px: int, n_columns: int, width_px: int
) -> float:
    """Return the angle that a column of the picture's centre covers [rad].

    A field of view that is told wins over the calibration. Without either, a column is a degree: the paper's
    Eqs. (15) and (16), whose shift is in columns although the text says pixels.

    Parameters
    ----------
    calibration : Calibration or None
        Of the camera.
    field_of_view_deg : float or None
        Horizontal field of view, where the config gives it [deg].
    column_px : int
        Width of a column [px].
    n_columns : int
        How many columns the picture is divided into.
    width_px : int
        Width of the picture [px].

    Returns
    -------
    float
        Angle of one column [rad].
    """
    if field_of_view_deg is not None:
        focal_px = width_px / 2.0 / math.tan(math.radians(field_of_view_deg) / 2.0)
        return column_px / focal_px
    if isinstance(calibration, Pinhole):
        return column_px / calibration.fx
    return _HEADING_RAD_PER_COLUMN * 50.0 / n_columns


@dataclass(frozen=True, slots=True)
class DriftLaw:
    """Turns a shift into a drift.

    A shift is one number: ``angle = heading + lateral / depth``. It is told once, as a heading and an offset that
    explain it together, with information in that one direction only.

    Attributes
    ----------
    columns_per_rad : float or None
        What a turn of the robot does to the shift; None: Eqs. (15) and (16) as they stand [columns/rad].
    depth_m : float
        Sideways way that shifts as much as a turn of one radian; negative for a camera that looks back [m].
    """

    columns_per_rad: float | None
    depth_m: float

    def drift(self, shift_columns: float) -> tuple[float, float]:
        """Return heading and lateral drift of a shift [rad, m]; positive to the left.

        Eqs. (15) and (16), with both sides scaled so that together they explain the shift.
        """
        gain = self._gain() * shift_columns
        lateral_limit_m = min(_LATERAL_LIMIT_M, abs(gain) * _LATERAL_M_PER_COLUMN)
        heading_limit_rad = min(_HEADING_LIMIT_RAD, abs(gain) * _HEADING_RAD_PER_COLUMN)
        side = math.copysign(1.0, shift_columns)
        return side * heading_limit_rad, side * math.copysign(lateral_limit_m, self.depth_m)

    def information(
        self, shift_columns: float, sigma_columns: float, bend_per_m: float = 0.0
    ) -> npt.NDArray[np.float64]:
        """Return the rank-one information of a drift, (3, 3) of station, lateral and heading.

        Parameters
        ----------
        shift_columns, sigma_columns : float
            The shift and its standard deviation [columns].
        bend_per_m : float
            How the taught heading turns. A shift is measured against the heading taught at one station, so in a
            bend it says something of the station too [rad/m].
        """
        heading_rad, lateral_m = self.drift(shift_columns)
        explained_rad = heading_rad + lateral_m / self.depth_m
        missing_rad = shift_columns * self._radians_per_column() - explained_rad  # cut off by the limits
        sigma_rad = math.hypot(sigma_columns * self._radians_per_column(), missing_rad)
        bend = bend_per_m if abs(bend_per_m) >= _LEAST_BEND_PER_M else 0.0
        return information_along((bend, 1.0 / self.depth_m, 1.0), sigma_rad)

    def _radians_per_column(self) -> float:
        if self.columns_per_rad is not None:
            return 1.0 / self.columns_per_rad
        return _HEADING_RAD_PER_COLUMN + _LATERAL_M_PER_COLUMN / abs(self.depth_m)

    def _gain(self) -> float:
        """Return the factor on Eqs. (15) and (16); 1 for the paper's."""
        return self._radians_per_column() / (_HEADING_RAD_PER_COLUMN + _LATERAL_M_PER_COLUMN / abs(self.depth_m))


class GainLearner:
    """Learns the gain of a column from under- and overshoot (the paper's future work, Sec. VI).

    When the robot has turned relative to the path, the shift should have changed by that turn. What it changed
    by more or less corrects the gain, as a scalar Kalman filter: turns that are large against the noise of the
    shift count most.

    Parameters
    ----------
    columns_per_rad : float
        Where to begin [columns/rad].
    sigma_columns : float
        Standard deviation of a shift [columns].
    """

    def __init__(self, columns_per_rad: float, sigma_columns: float) -> None:
        self._nominal = columns_per_rad
        self._noise = 2.0 * sigma_columns**2  # of a difference of two shifts
        self.columns_per_rad = columns_per_rad
        self._variance = columns_per_rad**2
        self._since: tuple[float, float, float] | None = None

    def update(self, shift_columns: float, heading_rad: float, station_m: float) -> None:
        """Take a shift, and the heading relative to the path from motion alone (its zero does not matter)."""
        now = (shift_columns, heading_rad, station_m)
        if self._since is None or abs(station_m - self._since[2]) > _MOST_WAY_M:
            self._since = now  # on a longer way, sideways drift would pass for a turn
            return
        turn_rad = heading_rad - self._since[1]
        if abs(turn_rad) < _LEAST_TURN_RAD:
            return
        surprise = shift_columns - self._since[0] - self.columns_per_rad * turn_rad
        weight = self._variance * turn_rad / (turn_rad**2 * self._variance + self._noise)
        learned = self.columns_per_rad + weight * surprise
        self._variance *= 1.0 - weight * turn_rad
        self.columns_per_rad = min(max(learned, self._nominal / _MOST_RATIO), self._nominal * _MOST_RATIO)
        self._since = now
