"""When each row of a picture is exposed, and where the vehicle has the sensor then."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ConfigError
from trailmark.geometry import Pose3
from trailmark_sim.render.develop import Sensitometry
from trailmark_sim.render.viewpoints import Viewpoints
from trailmark_sim.rng import frame_rng
from trailmark_sim.vehicles import VehicleState

__all__ = ["GLOBAL_SHUTTER", "STEADY", "Imaging", "Shaking", "Shutter", "poses_after", "viewpoints_after"]

_WAVES_M = (0.03, 0.05, 0.09, 0.16, 0.35, 0.8)


@dataclass(frozen=True, slots=True)
class Shutter:
    """How long a camera exposes, and how it reads its rows.

    The stamp of a picture is the middle of the exposure of its middle. Row r of H is exposed around
    ``stamp + readout_s ((r + 1/2) / H - 1/2)``, each for `exposure_s`.

    Attributes
    ----------
    exposure_s : float
        While it exposes, motion smears the picture; 0: it is sharp [s].
    readout_s : float
        From one picture's first row to where its next row would be, one line time after the last: H line times.
        0: all rows at once, a global shutter [s].

    Raises
    ------
    ConfigError
        If a time is negative or not finite.
    """

    exposure_s: float = 0.0
    readout_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("exposure_s", "readout_s"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ConfigError(f"sim: {name} of a camera is a time of 0 or more, not {value}")

    def rows_after_s(self, n_rows: int) -> Floats:
        """Return how long after the stamp the middle of each row's exposure is, (n_rows,) [s]."""
        return np.asarray(self.readout_s * ((np.arange(n_rows) + 0.5) / n_rows - 0.5))

    def refuse_at(self, sensor: str, rate_hz: float) -> None:
        """Refuse a rate at which a row would be read again before it was exposed, or read twice at once.

        Raises
        ------
        ConfigError
            If exposure or readout take longer than from one picture to the next.
        """
        longest_s = max(self.exposure_s, self.readout_s)
        if longest_s * rate_hz > 1.0 + 1e-9:
            name = "exposes" if self.exposure_s >= self.readout_s else "is read"
            raise ConfigError(
                f"sim: a picture of {sensor!r} {name} for {longest_s * 1e3:g} ms, but at {rate_hz:g} Hz the next comes"
                f" after {1e3 / rate_hz:.4g} ms; shorten it or lower the rate"
            )


@dataclass(frozen=True, slots=True)
class Shaking:
    """How the floor shakes a sensor: the same bumps at the same places of the way.

    Attributes
    ----------
    angle_rad : float
        Standard deviation of roll, pitch and (a third) yaw [rad].
    height_m : float
        Standard deviation of the height [m].
    seed : int
        Of the bumps.
    """

    angle_rad: float = 0.0
    height_m: float = 0.0
    seed: int = 0

    def at(self, travelled_m: float) -> Pose3:
        """Return the motion of the sensor's base after some way."""
        if self.angle_rad == 0.0 and self.height_m == 0.0:
            return Pose3()
        roll, pitch, yaw, height = (float(wave) for wave in self.along(np.array([travelled_m]))[:, 0])
        return Pose3(0.0, 0.0, height, roll, pitch, yaw)

    def along(self, travelled_m: Floats) -> Floats:
        """Return roll, pitch, yaw [rad] and height [m] after several ways (n,), as (4, n)."""
        turns = 2.0 * math.pi * travelled_m / np.array(_WAVES_M)[:, None]
        waves = np.sin(turns + _phases(self.seed)[..., None]).sum(axis=1) * math.sqrt(2.0 / len(_WAVES_M))
        sizes = (self.angle_rad, self.angle_rad, self.angle_rad / 3.0, self.height_m)
        return np.asarray(waves * np.array(sizes)[:, None])


#: A camera that sees everything at once.
GLOBAL_SHUTTER = Shutter()
#: A sensor that nothing shakes.
STEADY = Shaking()


@dataclass(frozen=True, slots=True)
class Imaging:
    """How a camera makes pictures.

    Attributes
    ----------
    response : Sensitometry
        How it turns light into grey levels.
    shutter : Shutter
        When it sees each row, and for how long.
    shaking : Shaking
        How the floor shakes it.
    """

    response: Sensitometry = Sensitometry()
    shutter: Shutter = GLOBAL_SHUTTER
    shaking: Shaking = STEADY


@lru_cache(maxsize=64)
def _phases(seed: int) -> Floats:
    return frame_rng(seed, "bumps").uniform(0.0, 2.0 * math.pi, (4, len(_WAVES_M)))


def poses_after(state: VehicleState, after_s: Floats) -> Floats:
    """Return x, y and heading of a vehicle that keeps its twist, at n times from now, (n, 3) [m, m, rad]."""
    pose, twist = state.pose_map_base, state.twist
    turned = twist.yaw_radps * after_s
    # The chord of an arc is as long as its sine says and points half the turn away.
    chord_s = after_s * np.sinc(turned / (2.0 * math.pi))
    direction = pose.theta + turned / 2.0
    cos, sin = np.cos(direction), np.sin(direction)
    x = pose.x + chord_s * (cos * twist.forward_mps - sin * twist.left_mps)
    y = pose.y + chord_s * (sin * twist.forward_mps + cos * twist.left_mps)
    return np.stack([x, y, pose.theta + turned], axis=1)


def viewpoints_after(state: VehicleState, mounting: Pose3, shaking: Shaking, after_s: Floats) -> Viewpoints:
    """Return where a sensor looks from at n times from now, while the vehicle keeps its twist."""
    x, y, heading = poses_after(state, after_s).T
    speed_mps = math.hypot(state.twist.forward_mps, state.twist.left_mps)
    roll, pitch, yaw, height = shaking.along(state.travelled_m + speed_mps * after_s)
    still = np.zeros_like(x)
    level, shaken = _rotations(still, still, heading), _rotations(roll, pitch, yaw)
    arm = shaken @ np.array([mounting.x, mounting.y, mounting.z]) + np.stack([still, still, height], axis=1)
    eyes = np.stack([x, y, still], axis=1) + np.einsum("nij,nj->ni", level, arm)
    return Viewpoints(level @ shaken @ mounting.rotation(), eyes)


def _rotations(roll: Floats, pitch: Floats, yaw: Floats) -> Floats:
    """Return ``Rz(yaw) Ry(pitch) Rx(roll)``, (n, 3, 3)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.asarray(np.moveaxis(np.array(rows), 2, 0))
