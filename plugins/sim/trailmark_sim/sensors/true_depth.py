"""The exact depth of a camera's picture: a reference for measurements, not the model of a real sensor."""

from __future__ import annotations

import numpy as np

from trailmark.errors import ConfigError
from trailmark.frames import RGBD, DepthCamera, Pinhole, SensorInfo
from trailmark_sim.render.lenses import PinholeLens
from trailmark_sim.sensors.camera import CameraSensor
from trailmark_sim.sensors.camera import build as build_camera
from trailmark_sim.sensors.site import SensorSite
from trailmark_sim.vehicles import VehicleState

__all__ = ["TrueDepthSensor", "build"]


class TrueDepthSensor:
    """Pictures of a perspective camera with the depth of every pixel, without error and without limit.

    With the depth and two poses of the vehicle, the true displacement of every pixel between two pictures is known:
    ``point_map = pose_map_base @ pose_base_sensor @ (depth * ray)``, seen again from the other pose. That is exact
    as long as the floor does not shake the camera (`vibration_mrad: 0`) and people stand still. With a rolling shutter
    every row has its depth, and its pose, at its own time; blurred by a long exposure, in the middle of it.

    Parameters
    ----------
    camera : CameraSensor
        The camera, under the name that the depth is to have.

    Raises
    ------
    ConfigError
        If its lens has no optical plane: depth is measured along the optical axis.
    """

    def __init__(self, camera: CameraSensor) -> None:
        info = camera.info
        if not isinstance(camera.lens, PinholeLens) or not isinstance(info.calibration, Pinhole):
            raise ConfigError(
                f"sim: depth along the optical axis needs a perspective camera, which {info.name!r} is not"
            )
        self._camera, self.rate_hz = camera, camera.rate_hz
        calibration = DepthCamera(info.calibration, depth_kind="z")
        self.info = SensorInfo(info.name, "rgbd", info.size, info.rate_hz, info.pose_base_sensor, calibration)

    def render(self, k: int, stamp_s: float, state: VehicleState) -> RGBD:
        """Return picture number `k` and its depth; NaN where there is nothing but sky."""
        camera = self._camera
        view = camera.view(stamp_s, state)
        depth = view.ranges_m * view.table.rays[:, 0]
        depth[view.is_nothing] = np.nan
        return RGBD(camera.develop(view, k, stamp_s, state).pixels, view.table.picture(depth, np.nan))


def build(name: str, site: SensorSite) -> TrueDepthSensor:
    """Return the exact depth of the camera ``front`` of a world."""
    return TrueDepthSensor(build_camera(name, site, rig_of="front"))
