"""Statistics of the built-in floors as the ground camera sees them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from trailmark.geometry import Pose2
from trailmark_sim.ground.camera import GroundCameraSensor, GroundRig
from trailmark_sim.ground.ground import Floor, GroundTexture, Zone
from trailmark_sim.ground.optics import Optics
from trailmark_sim.realism import PictureStatistics, photo_statistics, picture_statistics
from trailmark_sim.vehicles import VehicleState

__all__ = ["PHOTOGRAPHS", "floor_statistics", "photographed_statistics"]

#: Photographs of each kind of floor in the folder ``ground`` of the recordings. Carpet and gravel have none.
PHOTOGRAPHS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "wood": ("wood_floor", "wood_dark", "planks"),
        "asphalt": ("asphalt", "asphalt_cracked_1k"),
        "concrete": ("warehouse_concrete_1k",),
        "pavers": ("pavers",),
        "soil": ("grass_1k",),
        "terrazzo": ("tiles_1k",),
    }
)
_N_PLACES = 4
_REDUCED_PX = 640


def floor_statistics(floor: Floor, seed: int = 1) -> PictureStatistics:
    """Return the mean statistics of a floor at four places and headings.

    With the noise of the default camera, but in even light: what the calibration leaves after the flat field.
    """
    ground = GroundTexture([Zone(floor)], seed)
    camera = GroundCameraSensor("floor", ground, GroundRig(), Optics(vignette=0.0), seed, cap_mb=32.0)
    poses = [Pose2(3.37 * k + 0.1, 1.7 * k, 0.6 * k) for k in range(_N_PLACES)]
    pictures = [camera.render(k, 0.0, VehicleState(pose)).pixels for k, pose in enumerate(poses)]
    return PictureStatistics.mean([picture_statistics(picture) for picture in pictures])


def photographed_statistics(floor: str, folder: Path) -> list[PictureStatistics]:
    """Return the statistics of the photographs of a kind of floor, each at its full size and reduced to 640 px.

    Nobody knows how large their pixels were on the ground.

    Parameters
    ----------
    floor : str
        One of `PHOTOGRAPHS`.
    folder : Path
        Where the photographs are.
    """
    paths = [folder / f"{name}.jpg" for name in PHOTOGRAPHS[floor]]
    return [photo_statistics(path, longest_px) for path in paths for longest_px in (None, _REDUCED_PX)]
