"""A planar laser range finder."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from trailmark.arrays import Bools
from trailmark.frames import Scan, SensorInfo
from trailmark.geometry import Pose3
from trailmark_sim.render.rays import ray_table
from trailmark_sim.render.view import SceneView
from trailmark_sim.rng import frame_rng
from trailmark_sim.sensors.site import SensorSite
from trailmark_sim.stage import Stage
from trailmark_sim.vehicles import VehicleState

__all__ = ["LaserRig", "LaserSensor", "build"]

#: Below this cosine a beam slides along the surface and little comes back.
_GRAZING = 0.05
#: A mirror that sends on more than this share of the beam shows what stands in it, and less, what stands behind it.
_MIRRORED = 0.5
#: A surface that mirrors this much sends the beam elsewhere, unless it is met squarely.
_SHINY, _SQUARE = 0.3, 0.95


@dataclass(frozen=True, slots=True)
class LaserRig:
    """Size, errors and place of a laser. The defaults are those of a scanner of 240 deg and 10 Hz.

    Attributes
    ----------
    n_beams : int
        Beams of a sweep.
    field_rad : float
        Angle from the first to the last beam [rad].
    range_min_m, range_max_m : float
        What it can measure [m].
    noise_m, noise_share : float
        Standard deviation of a range: a part that is always there, and one that grows with the range [m, 1].
    dropout : float
        Share of beams that are lost for no reason.
    rate_hz : float
        Sweeps per second [Hz].
    mounting : Pose3
        ``point_base = mounting @ point_sensor``.
    """

    n_beams: int = 681
    field_rad: float = math.radians(240.0)
    range_min_m: float = 0.06
    range_max_m: float = 12.0
    noise_m: float = 0.008
    noise_share: float = 0.002
    dropout: float = 0.003
    rate_hz: float = 10.0
    mounting: Pose3 = Pose3(x=0.28, z=0.30)


class LaserSensor:
    """Ranges to what stands around, at the height of the laser.

    Parameters
    ----------
    name : str
        Name of the sensor.
    rig : LaserRig
        How it measures.
    stage : Stage
        What stands and moves there.
    seed : int
        Of the noise.
    """

    def __init__(self, name: str, rig: LaserRig, stage: Stage, seed: int) -> None:
        self.rig, self.rate_hz = rig, rig.rate_hz
        self.info = SensorInfo(name, "scan", None, rig.rate_hz, rig.mounting)
        self._scene, self._moment_at, self._seed = stage.build_scene(), stage.moment_at, seed
        angles = self.angle_min_rad + self.angle_step_rad * np.arange(rig.n_beams)
        self._table = ray_table(np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)[None])

    @property
    def angle_min_rad(self) -> float:
        """Direction of the first beam [rad]."""
        return -self.rig.field_rad / 2.0

    @property
    def angle_step_rad(self) -> float:
        """Step to the next beam [rad]."""
        return self.rig.field_rad / (self.rig.n_beams - 1)

    def render(self, k: int, stamp_s: float, state: VehicleState) -> Scan:
        """Return sweep number `k`."""
        rig = self.rig
        true_m, returns = self._cast(stamp_s, state)
        rng = frame_rng(self._seed, f"{self.info.name}/noise", k)
        sigma = np.hypot(rig.noise_m, rig.noise_share * true_m)
        ranges = true_m + sigma * rng.standard_normal(rig.n_beams)
        returns &= rng.random(rig.n_beams) >= rig.dropout
        returns &= (ranges >= rig.range_min_m) & (ranges <= rig.range_max_m)
        measured = np.where(returns, ranges, np.nan).astype(np.float32)
        return Scan(measured, self.angle_min_rad, self.angle_step_rad, rig.range_min_m, rig.range_max_m)

    def _cast(self, stamp_s: float, state: VehicleState) -> tuple[np.ndarray, np.ndarray]:
        """Return the true ranges (N,), and which beams come back."""
        pose = Pose3.from_planar(state.pose_map_base) @ self.rig.mounting
        view = SceneView(self._scene, self._table, pose, self._moment_at(stamp_s, state.pose_map_base))
        ranges_m, comes_back = view.ranges_m, _comes_back(view)
        for share, reflected in view.reflections():
            is_ghost = share > _MIRRORED
            ranges_m = np.where(is_ghost, reflected.ranges_m, ranges_m)
            comes_back = np.where(is_ghost, _comes_back(reflected), comes_back)
        ranges = self._table.picture(ranges_m, math.inf)[0].astype(np.float64)
        returns = self._table.picture(comes_back.astype(np.float32), 0.0)[0] > 0.5
        return np.where(returns, ranges, 0.0), returns


def _comes_back(view: SceneView) -> Bools:
    cosines, shine = view.facing()
    return np.asarray((cosines > _GRAZING) & ((shine < _SHINY) | (cosines > _SQUARE)) & ~view.is_nothing)


def build(name: str, site: SensorSite) -> LaserSensor:
    """Return the laser of a vehicle in a world with walls."""
    rig: LaserRig = site.rigs.get(name, LaserRig())
    rig = replace(rig, rate_hz=site.rate_hz(name, rig.rate_hz))
    return LaserSensor(name, rig, site.stage_for(name), site.options.seed)
