"""Statistics of the built-in floors as the ground camera sees them."""

from __future__ import annotations

from trailmark.geometry import Pose2
from trailmark_sim.ground.camera import GroundCamera, GroundRig
from trailmark_sim.ground.ground import Floor, Ground, Zone
from trailmark_sim.ground.optics import Optics
from trailmark_sim.realism import PictureStatistics, picture_statistics
from trailmark_sim.vehicles import VehicleState

__all__ = ["floor_statistics"]

_N_PLACES = 4


def floor_statistics(floor: Floor, seed: int = 1) -> PictureStatistics:
    """Return the mean statistics of a floor at four places and headings.

    With the noise of the default camera, but in even light: what the calibration leaves after the flat field.
    """
    ground = Ground([Zone(floor)], seed)
    camera = GroundCamera("floor", ground, GroundRig(), Optics(vignette=0.0), seed, cap_mb=32.0)
    poses = [Pose2(3.37 * k + 0.1, 1.7 * k, 0.6 * k) for k in range(_N_PLACES)]
    pictures = [camera.render(k, 0.0, VehicleState(pose)).pixels for k, pose in enumerate(poses)]
    return PictureStatistics.mean([picture_statistics(picture) for picture in pictures])
