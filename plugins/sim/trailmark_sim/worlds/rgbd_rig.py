"""A skid-steered robot with a colour and depth camera and a light sensor (Toth et al. 2015), for lab and hallway."""

from __future__ import annotations

from dataclasses import replace

from trailmark_sim.sensors.rgbd import RgbdRig
from trailmark_sim.vehicles import SkidSteer
from trailmark_sim.worlds.base import World, WorldOptions
from trailmark_sim.worlds.scene_options import HallwayOptions, LabOptions
from trailmark_sim.worlds.setting import Setting, imaging_of

__all__ = ["SENSORS", "rgbd_world"]

SENSORS = ("laser", "rgbd")


def rgbd_world(setting: Setting, options: WorldOptions, given: LabOptions | HallwayOptions) -> World:
    """Return the world of a setting with its sensors."""
    plain = RgbdRig()
    rig = RgbdRig(
        is_registered=given.registered,
        disparity_noise_px=plain.disparity_noise_px * given.depth_noise,
        disparity_step_px=plain.disparity_step_px if given.depth_noise > 0 else 0.0,
    )

    def light_at(stamp_s: float) -> float:
        return 1.0 if given.dims_s is None or stamp_s < given.dims_s else given.dims_to

    setting = replace(setting, light_at=light_at)
    site = setting.site(options, imaging_of(given, 0.7), {"rgbd": rig})
    return setting.world(site, options.vehicle or SkidSteer(), SENSORS, ("wheels", "light", "rgbd"))
