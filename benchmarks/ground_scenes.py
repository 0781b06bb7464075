"""Drives over photographed and built-in floors for the benchmarks of the downward camera, rendered by the simulator.

The camera is the paper's: 512 x 480 pixels of 0.39 mm, 70 pictures a second. Noise of 3 grey levels, a vignette of 30 %
with four unequal LEDs; the flat field of the calibration is the mean of 32 noisy pictures of a grey card. Height and
tilt are held: what a camera that nods does is another question.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from trailmark.frames import Frame, GroundPlane, SensorInfo
from trailmark.geometry import Pose2, Twist2
from trailmark_sim.ground.camera import GroundCameraSensor, GroundRig
from trailmark_sim.ground.floors import FLOORS as PAINTED
from trailmark_sim.ground.ground import Floor, GroundTexture, Zone
from trailmark_sim.ground.optics import Optics, led_light
from trailmark_sim.vehicles import VehicleState

__all__ = ["BUILT_IN", "PHOTOGRAPHS", "RATE_HZ", "SPEED_MPS", "Drive", "Law", "photographs", "scale_m", "sensor"]

RATE_HZ, SPEED_MPS = 70.0, 0.26
#: Photographs of real floors (``TRAILMARK_DATA``/ground); the last two are the hard ones.
PHOTOGRAPHS = (
    "wood_floor", "planks", "tiles_1k", "pavers", "asphalt", "asphalt_cracked_1k", "warehouse_concrete_1k", "grass_1k",
    "wood_dark", "artificial_turf_1k",
)  # fmt: skip
#: Floors that the simulator paints; the prefix tells them from photographs.
BUILT_IN = tuple(f"sim:{name}" for name in sorted(PAINTED))

_NOISE, _VIGNETTE, _N_REFERENCE = 3.0, 0.3, 32
_RIG = GroundRig()

#: Pose at a time, from the start of the drive.
Law = Callable[[float], Pose2]


def data_folder() -> Path:
    """Return the folder of the photographs, which may be missing."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    return Path(os.environ.get("TRAILMARK_DATA", beside)) / "ground"


def photographs() -> tuple[str, ...]:
    """Return the names of the photographs that are here."""
    return tuple(name for name in PHOTOGRAPHS if (data_folder() / f"{name}.jpg").is_file())


def scale_m() -> float:
    """Return the size of a pixel along the drive [m]."""
    return _RIG.metres_per_pixel[0]


@lru_cache(maxsize=1)
def sensor() -> SensorInfo:
    """Return the camera as its owner has calibrated it: true scales, flat field from noisy reference pictures."""
    light, rng = led_light(_RIG.width, _RIG.height, _VIGNETTE), np.random.default_rng(999)
    pictures = [np.rint(150.0 * light + rng.normal(0.0, _NOISE, light.shape)) for _ in range(_N_REFERENCE)]
    mean = cv2.GaussianBlur(np.mean(pictures, axis=0, dtype=np.float32), (0, 0), 8.0)
    plane = GroundPlane(_RIG.metres_per_pixel, flat_field=np.asarray(mean / mean.mean(), np.float32))
    return SensorInfo("floor", "image", (_RIG.width, _RIG.height), RATE_HZ, _RIG.mounting, plane)


def floor(name: str) -> Floor:
    """Return a floor by name: a photograph, or one that the simulator paints."""
    if name in BUILT_IN:
        return Floor(name.removeprefix("sim:"))
    return Floor(photo=data_folder() / f"{name}.jpg")


@dataclass(frozen=True)
class Drive:
    """A drive over a floor. A seed is the arrangement of the floor, a place and direction on it, and the noise.

    Attributes
    ----------
    floor : str
        Name of a photograph or a built-in floor.
    law : Law
        How it is driven.
    n_frames : int
        Pictures.
    seed : int
        See above.
    noise_seed : int
        Another noise over the same floor.
    zones : tuple of Zone
        Other floors that lie on it.
    """

    floor: str
    law: Law
    n_frames: int
    seed: int
    noise_seed: int = 0
    zones: tuple[Zone, ...] = ()

    def pose(self, index: int) -> Pose2:
        """Return the true pose of a picture, in the map."""
        rng = np.random.default_rng([1, self.seed])
        x, y = rng.uniform(0.0, 5.0, 2).tolist()
        start = Pose2(x, y, float(rng.uniform(-math.pi, math.pi)))
        return start @ self.law(index / RATE_HZ)

    def truth(self) -> Sequence[Pose2]:
        """Return all poses as seen from the first."""
        first = self.pose(0)
        return [first.between(self.pose(index)) for index in range(self.n_frames)]

    def frames(self) -> Iterator[Frame]:
        """Yield the pictures, each rendered when it is asked for."""
        camera = self.camera()
        for index in range(self.n_frames):
            yield Frame("floor", index / RATE_HZ, camera.render(index, index / RATE_HZ, self._state(index)))

    def ground(self) -> GroundTexture:
        """Return the floor of this drive."""
        return GroundTexture([Zone(floor(self.floor)), *self.zones], self.seed)

    def camera(self) -> GroundCameraSensor:
        """Return a camera over the floor of this drive."""
        optics = replace(
            Optics(), vignette=_VIGNETTE, read_noise=_NOISE, shot_noise=0.0, height_jitter=0.0, tilt_jitter_rad=0.0
        )
        return GroundCameraSensor("floor", self.ground(), _RIG, optics, 1000 * self.noise_seed + self.seed, threads=1)

    def _state(self, index: int) -> VehicleState:
        pose = self.pose(index)
        forward_m, left_m, turn_rad = pose.between(self.pose(index + 1)).log()
        return VehicleState(pose, Twist2(forward_m * RATE_HZ, left_m * RATE_HZ, turn_rad * RATE_HZ))
