"""How a synthetic robot moves: the pose of base at any time, in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from trailmark.geometry import Pose2, Trajectory

__all__ = ["MotionLaw", "circle", "straight", "true_poses", "uneven"]

#: Pose of base in the map at a time [s], in closed form.
MotionLaw = Callable[[float], Pose2]


def straight(
    speed_mps: float, heading_rad: float = 0.0, sway_m: float = 0.0, sway_s: float = 3.0, shake_rad: float = 0.0
) -> MotionLaw:
    """Return a straight drive from the origin that may sway to the sides and shake about the vertical.

    Parameters
    ----------
    sway_m, sway_s : float
        Amplitude and period of the sway [m, s].
    shake_rad : float
        Amplitude of a yaw vibration of 11 Hz [rad].
    """
    start = Pose2(0.0, 0.0, heading_rad)

    def pose(time_s: float) -> Pose2:
        sway = sway_m * math.sin(2.0 * math.pi * time_s / sway_s)
        return start @ Pose2(speed_mps * time_s, sway, shake_rad * math.sin(2.0 * math.pi * 11.0 * time_s))

    return pose


def circle(speed_mps: float, radius_m: float) -> MotionLaw:
    """Return a drive on a circle from the origin, to the left for a positive radius.

    Parameters
    ----------
    speed_mps : float
        Constant speed [m/s].
    radius_m : float
        Radius, positive to the left [m].

    Returns
    -------
    MotionLaw
        Returns the pose at a time [s].
    """

    def pose(time_s: float) -> Pose2:
        return Pose2.exp(speed_mps * time_s, 0.0, speed_mps * time_s / radius_m)

    return pose


def uneven(motion: MotionLaw, share: float = 0.6, period_s: float = 2.0) -> MotionLaw:
    """Return the same way driven faster and slower by turns: speed and turn rate swing by a share of themselves.

    At constant speed and turn an estimate that is 20 ms late looks like one in time.

    Parameters
    ----------
    share : float
        How far the speed swings about its mean, 0 to 1.
    period_s : float
        Of the swing [s].
    """
    if not 0.0 <= share <= 1.0 or not period_s > 0.0:
        raise ValueError(f"the share must lie between 0 and 1 and the period be positive, not {share} and {period_s} s")
    swing = 2.0 * math.pi / period_s

    def pose(time_s: float) -> Pose2:
        return motion(time_s - share / swing * math.sin(swing * time_s))

    return pose


def true_poses(motion: MotionLaw, n_frames: int, rate_hz: float) -> Trajectory:
    """Return the poses at `n_frames` stamps, from 0 s on, at a rate [Hz].

    Parameters
    ----------
    motion : MotionLaw
        Returns the pose at a time [s].
    n_frames : int
        How many poses.
    rate_hz : float
        Poses per second [Hz].

    Returns
    -------
    Trajectory
        The poses at 0, 1 / `rate_hz`, 2 / `rate_hz` ...
    """
    stamps_s = np.arange(n_frames) / rate_hz
    return Trajectory.from_poses((float(stamp_s), motion(float(stamp_s))) for stamp_s in stamps_s)
