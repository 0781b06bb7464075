"""What is seen of landmarks at one instant, and how it changes with the pose of the sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Floats, Int64s
from trailmark.geometry import Pose2, wrap_angles

__all__ = ["NEAREST_M", "Seen", "Sightings", "lever_of", "pose_of_base"]

#: A bearing from on top of a landmark says nothing, but must not divide by zero [m].
NEAREST_M = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """The known landmarks that are seen at one instant.

    Attributes
    ----------
    ids : (N,) int64
        Which.
    landmarks : (N, 2) float64
        Where they stand in the map [m].
    ranges_m, bearings_rad : (N,) float64
        What is seen of each, NaN where it is not told.
    """

    ids: Int64s
    landmarks: Floats
    ranges_m: Floats
    bearings_rad: Floats

    def __len__(self) -> int:
        return len(self.ids)

    def one_by_one(self) -> Iterator[Seen]:
        """Yield each landmark for itself."""
        for i in range(len(self)):
            one = slice(i, i + 1)
            yield Seen(self.ids[one], self.landmarks[one], self.ranges_m[one], self.bearings_rad[one])


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """Measured numbers, one a row: the ranges of those that have one, and below them the bearings.

    Attributes
    ----------
    ids : (M,) int64
        The landmark that each number is about.
    landmarks : (M, 2) float64
        Its place [m].
    measured : (M,) float64
        Ranges [m] and bearings in sensor axes, counter-clockwise from its forward axis [rad].
    is_bearing : (M,) bool
        Which of the two a number is.
    sigmas, gates : (M,) float64
        Standard deviations, and errors from which on a number is an outlier [m, rad].
    """

    ids: Int64s
    landmarks: Floats
    measured: Floats
    is_bearing: Bools
    sigmas: Floats
    gates: Floats

    @classmethod
    def of(cls, seen: Seen, *, sigmas: Floats, gates: Floats) -> Sightings:
        """Return the numbers of what is seen; `sigmas` and `gates`, (2,), are of a range [m] and of a bearing [rad]."""
        has_range, has_bearing = np.isfinite(seen.ranges_m), np.isfinite(seen.bearings_rad)
        is_bearing = np.repeat([False, True], [has_range.sum(), has_bearing.sum()])
        return cls(
            np.concatenate([seen.ids[has_range], seen.ids[has_bearing]]),
            np.concatenate([seen.landmarks[has_range], seen.landmarks[has_bearing]]),
            np.concatenate([seen.ranges_m[has_range], seen.bearings_rad[has_bearing]]),
            is_bearing,
            np.where(is_bearing, sigmas[1], sigmas[0]),
            np.where(is_bearing, gates[1], gates[0]),
        )

    def __len__(self) -> int:
        return len(self.measured)

    def errors(self, poses: Floats) -> Floats:
        """Return "measured minus expected" at poses of the sensor, (..., 3) to (..., M) [m, rad]."""
        dx = self.landmarks[:, 0] - poses[..., 0, np.newaxis]
        dy = self.landmarks[:, 1] - poses[..., 1, np.newaxis]
        expected = np.where(self.is_bearing, np.arctan2(dy, dx) - poses[..., 2, np.newaxis], np.hypot(dx, dy))
        errors = self.measured - expected
        return np.where(self.is_bearing, wrap_angles(errors), errors)

    def derivatives(self, pose: Floats) -> Floats:
        """Return how the expected numbers change with the sensor's (x, y, theta), (M, 3)."""
        offsets = self.landmarks - pose[:2]
        distances = np.maximum(np.hypot(offsets[:, 0], offsets[:, 1]), NEAREST_M)
        cos, sin = offsets[:, 0] / distances, offsets[:, 1] / distances
        of_ranges = np.stack([-cos, -sin, np.zeros_like(cos)], axis=1)
        of_bearings = np.stack([sin / distances, -cos / distances, -np.ones_like(cos)], axis=1)
        return np.where(self.is_bearing[:, np.newaxis], of_bearings, of_ranges)


def pose_of_base(pose_sensor: Floats, information: Floats, mounting: Pose2) -> tuple[Pose2, Floats]:
    """Return pose and information of base from those of a sensor that is mounted on it.

    Parameters
    ----------
    pose_sensor : (3,) float64
        The sensor in the map.
    information : (3, 3) float64
        Of `pose_sensor`, in map axes.
    mounting : Pose2
        The sensor on base.
    """
    sensor = Pose2.from_array(pose_sensor)
    base = sensor @ mounting.inverse()
    lever = lever_of(base, sensor)
    turned = lever.T @ information @ lever
    return base, (turned + turned.T) / 2.0


def lever_of(base: Pose2, sensor: Pose2) -> Floats:
    """Return how a sensor's pose in the map changes with that of the base that it is mounted on, (3, 3)."""
    return np.array([[1.0, 0.0, base.y - sensor.y], [0.0, 1.0, sensor.x - base.x], [0.0, 0.0, 1.0]])
