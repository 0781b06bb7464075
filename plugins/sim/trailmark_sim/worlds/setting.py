"""What worlds with walls have in common: a scene, what moves and stands in it, routes, and one kind of vehicle."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from trailmark.geometry import Pose2
from trailmark_sim.props import Movers
from trailmark_sim.render.develop import Sensitometry
from trailmark_sim.render.scene import Scene
from trailmark_sim.routes import Route
from trailmark_sim.sensors.catalogue import build_sensors
from trailmark_sim.sensors.shutter import STEADY, Imaging, Shaking, Shutter
from trailmark_sim.sensors.site import SensorSite
from trailmark_sim.stage import Stage, steady_light
from trailmark_sim.vehicles import Vehicle
from trailmark_sim.worlds.base import World, WorldOptions
from trailmark_sim.worlds.scene_options import ImagingOptions
from trailmark_sim.worlds.solids import Solids

__all__ = ["Setting", "imaging_of"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Setting:
    """The place of a world with walls.

    Attributes
    ----------
    name : str
        Of the world.
    build_scene : callable
        Returns what stands there.
    movers : Movers
        Who and what moves there.
    solids : Solids
        What a vehicle can run into.
    routes : mapping of str to Route
        Ways to drive; the first is the default.
    level_lux : callable
        Takes the pose of the vehicle and the stamp and returns the light there [lux].
    light_at : callable
        Takes a stamp [s] and returns the light as a share of that: lamps may be turned down.
    """

    name: str
    build_scene: Callable[[], Scene]
    movers: Movers
    solids: Solids
    routes: Mapping[str, Route]
    level_lux: Callable[[Pose2, float], float]
    light_at: Callable[[float], float] = steady_light

    def site(self, options: WorldOptions, imaging: Imaging, rigs: Mapping[str, Any], **more: Any) -> SensorSite:
        """Return what the place offers to sensors."""

        def lux_at(pose: Pose2, stamp_s: float) -> float:
            return self.level_lux(pose, stamp_s) * self.light_at(stamp_s)

        stage = Stage.with_movers(self.build_scene, self.movers, options.threads, self.light_at)
        return SensorSite(
            world=self.name, options=options, level_lux=lux_at, stage=stage, imaging=imaging, rigs=rigs, **more
        )

    def world(
        self, site: SensorSite, vehicle: Vehicle, own: Sequence[str], default: Sequence[str], **more: Any
    ) -> World:
        """Return the world with the sensors that are asked for."""
        return World(
            name=self.name,
            vehicle=vehicle,
            sensors=build_sensors(site, own, default),
            routes=self.routes,
            collides=partial(self.solids.touched, vehicle),
            area=self.solids.area,
            around=self.solids.outlines(),
            **{"start": next(iter(self.routes.values())).start} | more,
        )


def imaging_of(
    given: ImagingOptions, default_blur_px: float, *, vignette: float = 0.25, shaking: Shaking = STEADY
) -> Imaging:
    """Return how the cameras of a world make pictures, from its options."""
    plain = Sensitometry()
    response = Sensitometry(
        exposure=given.exposure,
        vignette=vignette,
        read_noise=plain.read_noise * given.noise,
        shot_noise=plain.shot_noise * given.noise,
        blur_px=default_blur_px if given.blur_px is None else given.blur_px,
    )
    return Imaging(response, Shutter(given.exposure_ms / 1e3, given.readout_ms / 1e3), shaking)
