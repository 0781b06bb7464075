"""Synthetic runs of sensors that are no cameras: wheels, inertia, light and landmarks; and what every run has."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Protocol

import numpy as np

from trailmark.errors import ShapeError
from trailmark.frames import Arrays, Frame, Imu, Odometry, Record, Scalar, SensorInfo
from trailmark.geometry import Trajectory, Twist2, wrap_angle
from trailmark.testing.motions import MotionLaw, circle, true_poses, uneven

__all__ = ["AnyRun", "SyntheticRun", "imu_run", "landmark_run", "light_run", "odometry_run", "pose_run"]


class AnyRun(Protocol):
    """What the checks need of a run: frames, sensors and truth."""

    @property
    def frames(self) -> Sequence[Frame]: ...
    @property
    def sensors(self) -> Mapping[str, SensorInfo]: ...
    @property
    def truth(self) -> Trajectory: ...


@dataclass(frozen=True, eq=False)
class SyntheticRun:
    """Frames with exact ground truth.

    Attributes
    ----------
    frames : sequence of Frame
        In stamp order, perhaps of several sensors.
    sensors : mapping of str to SensorInfo
        What a source would say of them.
    truth : Trajectory
        True pose of base in the map.
    noise : mapping of str to (float, float)
        Standard deviations of the poses that a sensor tells, by sensor; none where what it tells is exact [m, rad].

    Raises
    ------
    ShapeError
        If frames are out of order, outside of the truth, or of sensors that are not told.
    """

    frames: Sequence[Frame]
    sensors: Mapping[str, SensorInfo]
    truth: Trajectory
    noise: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.truth, Trajectory):
            kind = type(self.truth).__name__
            raise ShapeError(f"the truth is a Trajectory, not a {kind}: Trajectory.from_poses([(stamp_s, pose), ...])")
        unknown = {frame.sensor for frame in self.frames} - set(self.sensors)
        if unknown:
            raise ShapeError(f"frames of {', '.join(sorted(unknown))}, but the sensors are {', '.join(self.sensors)}")
        misnamed = [name for name, info in self.sensors.items() if info.name != name]
        if misnamed:
            raise ShapeError(f"the sensor called {misnamed[0]!r} says that it is {self.sensors[misnamed[0]].name!r}")
        back = [now.stamp_s for last, now in pairwise(self.frames) if now.stamp_s < last.stamp_s]
        if back:
            raise ShapeError(f"frames must be in the order of their stamps, but one of {back[0]} s follows a later one")
        if not len(self.truth):
            raise ShapeError("the truth must have one pose at least")
        first_s, last_s = self.truth.stamps_s[[0, -1]].tolist()
        outside = [frame.stamp_s for frame in self.frames if not first_s - 1e-6 <= frame.stamp_s <= last_s + 1e-6]
        if outside:
            raise ShapeError(f"the truth covers {first_s} to {last_s} s, but a frame is of {outside[0]} s")

    def __repr__(self) -> str:
        return f"SyntheticRun({len(self.frames)} frames of {', '.join(self.sensors)}; truth {self.truth!r})"

    def with_sensors(self, *others: SyntheticRun) -> SyntheticRun:
        """Return this run with the frames of others of the same motion, merged by stamp."""
        frames = sorted((frame for run in (self, *others) for frame in run.frames), key=lambda frame: frame.stamp_s)
        sensors = {name: info for run in (self, *others) for name, info in run.sensors.items()}
        noise = {name: sigma for run in (self, *others) for name, sigma in run.noise.items()}
        return SyntheticRun(tuple(frames), sensors, self.truth, noise)


def odometry_run(
    motion: MotionLaw | None = None, n_frames: int = 100, *, rate_hz: float = 20.0, sensor: str = "wheels"
) -> SyntheticRun:
    """Return exact wheel odometry of a drive: pose, distance and velocity since the start.

    Parameters
    ----------
    motion : MotionLaw or None
        Returns the pose at a time [s]; None: an uneven circle to the left, of 1 m radius at 0.3 m/s.
    n_frames : int
        How many readings.
    rate_hz : float
        Readings per second [Hz].
    sensor : str
        Name of the sensor.

    Returns
    -------
    SyntheticRun
        Frames, sensors and true poses.
    """
    motion = motion or uneven(circle(0.3, 1.0))
    truth = true_poses(motion, n_frames, rate_hz)
    start, travelled_m = motion(0.0), truth.travelled_m()
    frames = tuple(
        Frame(sensor, stamp_s, Odometry(start.between(pose), float(travelled_m[index]), _twist(motion, stamp_s)))
        for index, (stamp_s, pose) in enumerate(truth)
    )
    return SyntheticRun(frames, {sensor: SensorInfo(sensor, "odometry", rate_hz=rate_hz)}, truth)


def imu_run(
    motion: MotionLaw | None = None, n_frames: int = 200, *, rate_hz: float = 100.0, sensor: str = "imu"
) -> SyntheticRun:
    """Return the exact yaw rate of a drive, with gravity and an orientation.

    Parameters
    ----------
    motion : MotionLaw or None
        Returns the pose at a time [s]; None: an uneven circle to the left, of 1 m radius at 0.3 m/s.
    n_frames : int
        How many readings.
    rate_hz : float
        Readings per second [Hz].
    sensor : str
        Name of the sensor.

    Returns
    -------
    SyntheticRun
        Frames, sensors and true poses.
    """
    motion = motion or uneven(circle(0.3, 1.0))
    truth = true_poses(motion, n_frames, rate_hz)
    frames = tuple(
        Frame(
            sensor,
            stamp_s,
            Imu(
                np.array([0.0, 0.0, _twist(motion, stamp_s).yaw_radps]),
                np.array([0.0, 0.0, 9.81]),
                np.array([0.0, 0.0, math.sin(pose.theta / 2), math.cos(pose.theta / 2)]),
            ),
        )
        for stamp_s, pose in truth
    )
    return SyntheticRun(frames, {sensor: SensorInfo(sensor, "imu", rate_hz=rate_hz)}, truth)


def light_run(
    motion: MotionLaw | None = None, n_frames: int = 50, *, rate_hz: float = 10.0, sensor: str = "light"
) -> SyntheticRun:
    """Return an ambient light that rises and falls along the drive [lux].

    Parameters
    ----------
    motion : MotionLaw or None
        Returns the pose at a time [s]; None: an uneven circle to the left, of 1 m radius at 0.3 m/s.
    n_frames : int
        How many readings.
    rate_hz : float
        Readings per second [Hz].
    sensor : str
        Name of the sensor.

    Returns
    -------
    SyntheticRun
        Frames, sensors and true poses.
    """
    truth = true_poses(motion or uneven(circle(0.3, 1.0)), n_frames, rate_hz)
    frames = tuple(
        Frame(sensor, stamp_s, Scalar(300.0 + 200.0 * math.sin(pose.x + 2.0 * pose.y))) for stamp_s, pose in truth
    )
    return SyntheticRun(frames, {sensor: SensorInfo(sensor, "scalar", rate_hz=rate_hz)}, truth)


def pose_run(
    motion: MotionLaw | None = None,
    n_frames: int = 100,
    *,
    rate_hz: float = 10.0,
    sigma: tuple[float, float] = (0.02, 0.01),
    seed: int = 0,
    sensor: str = "poses",
) -> SyntheticRun:
    """Return absolute poses of a drive from elsewhere, with noise of `sigma` [m, rad]; each reading has its covariance.

    A frame's `Record` has ``pose`` (3,) and ``covariance`` (3, 3); the sensor's kind is ``pose``.

    Parameters
    ----------
    motion : MotionLaw or None
        Returns the pose at a time [s]; None: an uneven circle to the left, of 1 m radius at 0.3 m/s.
    n_frames : int
        How many readings.
    rate_hz : float
        Readings per second [Hz].
    sigma : (float, float)
        Standard deviations of position and heading [m, rad].
    seed : int
        Of the noise.
    sensor : str
        Name of the sensor.

    Returns
    -------
    SyntheticRun
        Frames, sensors and true poses.
    """
    rng = np.random.default_rng(seed)
    truth = true_poses(motion or uneven(circle(0.3, 1.0)), n_frames, rate_hz)
    sigmas = np.array([sigma[0], sigma[0], sigma[1]])
    frames = tuple(
        Frame(
            sensor,
            stamp_s,
            Record({"pose": pose.array() + rng.normal(size=3) * sigmas, "covariance": np.diag(sigmas**2)}),
        )
        for stamp_s, pose in truth
    )
    return SyntheticRun(frames, {sensor: SensorInfo(sensor, "pose", rate_hz=rate_hz)}, truth, {sensor: sigma})


def landmark_run(
    motion: MotionLaw | None = None,
    n_frames: int = 50,
    *,
    kind: str = "range_bearing",
    rate_hz: float = 5.0,
    n_landmarks: int = 6,
    seed: int = 0,
    sensor: str = "sightings",
) -> SyntheticRun:
    """Return exact ranges and bearings of known landmarks about the origin, all seen all the time.

    A frame's `Record` has ``ids``, ``ranges_m`` and ``bearings_rad``; the calibration (`Arrays`) says where the
    landmarks stand: ``ids`` and ``positions_map``.

    Parameters
    ----------
    motion : MotionLaw or None
        Returns the pose at a time [s]; None: an uneven circle to the left, of 1 m radius at 0.3 m/s.
    n_frames : int
        How many readings.
    kind : str
        Kind of the sensor.
    rate_hz : float
        Readings per second [Hz].
    n_landmarks : int
        How many landmarks stand about the origin.
    seed : int
        Of the places of the landmarks.
    sensor : str
        Name of the sensor.

    Returns
    -------
    SyntheticRun
        Frames, sensors and true poses.
    """
    rng = np.random.default_rng(seed)
    positions, ids = rng.uniform(-5.0, 5.0, (n_landmarks, 2)), np.arange(1, n_landmarks + 1)
    truth = true_poses(motion or uneven(circle(0.3, 1.0)), n_frames, rate_hz)
    frames = []
    for stamp_s, pose in truth:
        away = positions - [pose.x, pose.y]
        bearings = [wrap_angle(math.atan2(dy, dx) - pose.theta) for dx, dy in away]
        arrays = {"ids": ids, "ranges_m": np.hypot(away[:, 0], away[:, 1]), "bearings_rad": np.array(bearings)}
        frames.append(Frame(sensor, stamp_s, Record(arrays)))
    calibration = Arrays({"ids": ids, "positions_map": positions})
    info = SensorInfo(sensor, kind, rate_hz=rate_hz, calibration=calibration)
    return SyntheticRun(tuple(frames), {sensor: info}, truth)


def _twist(motion: MotionLaw, stamp_s: float, step_s: float = 1e-4) -> Twist2:
    """Return the velocity in base axes, by a central difference."""
    forward_m, left_m, turn_rad = motion(stamp_s - step_s).between(motion(stamp_s + step_s)).log()
    return Twist2(forward_m / (2 * step_s), left_m / (2 * step_s), turn_rad / (2 * step_s))
