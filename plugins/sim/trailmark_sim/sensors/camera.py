"""A camera that looks at a scene."""

from __future__ import annotations

from trailmark.frames import Calibration, Image, Omni, Pinhole, SensorInfo
from trailmark.geometry import Pose3
from trailmark_sim.render.develop import Film, Sensitometry
from trailmark_sim.render.lenses import Catadioptric, Lens, PinholeLens
from trailmark_sim.render.scene import Scene
from trailmark_sim.render.view import View
from trailmark_sim.sensors.shutter import GLOBAL_SHUTTER, STEADY, Shaking, Shutter
from trailmark_sim.sensors.sight import MomentAt, Sight
from trailmark_sim.vehicles import VehicleState

__all__ = ["CameraSensor"]


class CameraSensor:
    """Pictures of a scene, through any central lens.

    Parameters
    ----------
    name : str
        Name of the sensor.
    scene : Scene
        What it sees.
    lens : Lens
        Rays of its pixels.
    mounting : Pose3
        ``point_base = mounting @ point_sensor``.
    rate_hz : float
        Pictures per second [Hz].
    response : Sensitometry
        How it sees.
    moment_at : callable
        Takes a stamp [s] and the pose of the vehicle and returns where people are.
    seed : int
        Of the noise.
    shaking : Shaking
        How the floor shakes it.
    threads : int
        Threads that render; no byte depends on it.
    shutter : Shutter
        When it sees each row, and for how long.

    Raises
    ------
    ConfigError
        If it takes longer to expose or to read a picture than until the next.
    """

    def __init__(
        self,
        name: str,
        scene: Scene,
        lens: Lens,
        mounting: Pose3,
        rate_hz: float,
        response: Sensitometry,
        moment_at: MomentAt,
        seed: int,
        shaking: Shaking = STEADY,
        threads: int = 1,
        shutter: Shutter = GLOBAL_SHUTTER,
    ) -> None:
        shutter.refuse_at(name, rate_hz)
        self.rate_hz = rate_hz
        self.info = SensorInfo(name, "image", (lens.width, lens.height), rate_hz, mounting, _calibration(lens))
        self.lens = lens
        self._sight = Sight(scene, lens, mounting, moment_at, shutter, shaking, threads)
        self._threads = threads
        mask = self._sight.mask
        self._film = Film(response, (lens.height, lens.width), seed, name, None if mask.all() else mask)

    def render(self, k: int, stamp_s: float, state: VehicleState) -> Image:
        """Return picture number `k`."""
        return self.develop(self.view(stamp_s, state), k, stamp_s, state)

    def develop(self, view: View, k: int, stamp_s: float, state: VehicleState) -> Image:
        """Return picture number `k`, of which `view` is the middle of the exposure."""
        return Image(self._film.develop(self._sight.radiance(view, stamp_s, state), k, 1.0, self._threads))

    def view(self, stamp_s: float, state: VehicleState) -> View:
        """Return what is before the lens in the middle of the exposure, each row at its own time."""
        return self._sight.view(stamp_s, state)


def _calibration(lens: Lens) -> Calibration | None:
    if isinstance(lens, PinholeLens):
        pinhole: Pinhole = lens.calibration
        return pinhole
    if isinstance(lens, Catadioptric):
        return Omni(lens.cx, lens.cy, lens.inner_px, lens.outer_px, "clockwise", -90.0)
    return None
