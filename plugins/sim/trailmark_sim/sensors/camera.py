"""A camera that looks at a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace

from trailmark.errors import ConfigError
from trailmark.frames import Calibration, Image, Omni, Pinhole, SensorInfo
from trailmark.geometry import Pose2, Pose3
from trailmark_sim.render.develop import Film
from trailmark_sim.render.lenses import Catadioptric, Lens, PinholeLens
from trailmark_sim.render.view import SceneView
from trailmark_sim.sensors.shutter import Imaging
from trailmark_sim.sensors.sight import Sight
from trailmark_sim.sensors.site import SensorSite
from trailmark_sim.stage import Stage
from trailmark_sim.vehicles import VehicleState

__all__ = ["CameraRig", "CameraSensor", "build"]


@dataclass(frozen=True, slots=True)
class CameraRig:
    """Lens, place and rate of a camera.

    Attributes
    ----------
    lens : Lens
        Rays of its pixels.
    mounting : Pose3
        ``point_base = mounting @ point_sensor``.
    rate_hz : float
        Pictures per second [Hz].
    """

    lens: Lens
    mounting: Pose3
    rate_hz: float = 20.0


class CameraSensor:
    """Pictures of a scene, through any central lens.

    Parameters
    ----------
    name : str
        Name of the sensor.
    rig : CameraRig
        Lens, place and rate.
    stage : Stage
        What it sees.
    imaging : Imaging
        How it sees.
    seed : int
        Of the noise.

    Raises
    ------
    ConfigError
        If it takes longer to expose or to read a picture than until the next.
    """

    def __init__(
        self, name: str, rig: CameraRig, stage: Stage, *, imaging: Imaging | None = None, seed: int = 0
    ) -> None:
        imaging, lens = imaging or Imaging(), rig.lens
        imaging.shutter.refuse_at(name, rig.rate_hz)
        self.rate_hz, self.lens = rig.rate_hz, lens
        size = (lens.width, lens.height)
        self.info = SensorInfo(name, "image", size, rig.rate_hz, rig.mounting, _calibration(lens))
        self._sight = Sight(stage, lens, rig.mounting, shutter=imaging.shutter, shaking=imaging.shaking)
        self._threads = stage.threads
        mask = self._sight.mask
        self._film = Film(imaging.response, (lens.height, lens.width), seed, name, None if mask.all() else mask)

    def render(self, k: int, stamp_s: float, state: VehicleState) -> Image:
        """Return picture number `k`."""
        return self.develop(self.view(stamp_s, state), k, stamp_s, state)

    def develop(self, view: SceneView, k: int, stamp_s: float, state: VehicleState) -> Image:
        """Return picture number `k`, of which `view` is the middle of the exposure."""
        return Image(self._film.develop(self._sight.radiance(view, stamp_s, state), k, 1.0, self._threads))

    def view(self, stamp_s: float, state: VehicleState) -> SceneView:
        """Return what is before the lens in the middle of the exposure, each row at its own time."""
        return self._sight.view(stamp_s, state)

    def view_from(self, pose_map_base: Pose2, stamp_s: float) -> SceneView:
        """Return what is before the lens of a vehicle that stands at a pose."""
        return self.view(stamp_s, VehicleState(pose_map_base))

    def picture_from(self, pose_map_base: Pose2, k: int) -> Image:
        """Return picture number `k`, of a vehicle that stands at a pose as the run begins."""
        return self.render(k, 0.0, VehicleState(pose_map_base))


def _calibration(lens: Lens) -> Calibration | None:
    if isinstance(lens, PinholeLens):
        pinhole: Pinhole = lens.calibration
        return pinhole
    if isinstance(lens, Catadioptric):
        return Omni(lens.cx, lens.cy, lens.inner_px, lens.outer_px, "clockwise", -90.0)
    return None


def build(name: str, site: SensorSite, rig_of: str | None = None) -> CameraSensor:
    """Return a camera of a world, with the rig of its name or of another camera.

    Raises
    ------
    ConfigError
        If the world has no such camera.
    """
    rig = site.rigs.get(rig_of or name)
    if not isinstance(rig, CameraRig):
        raise ConfigError(f"sim: world {site.world!r} has no lens for a camera named {rig_of or name!r}")
    rig = replace(rig, rate_hz=site.rate_hz(name, rig.rate_hz))
    return CameraSensor(name, rig, site.stage_for(name), imaging=site.imaging, seed=site.options.seed)
