"""A camera that looks straight down on the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from trailmark.arrays import Float32s, Floats
from trailmark.deprecation import deprecated_name
from trailmark.frames import GroundPlane, Image, SensorInfo
from trailmark.geometry import Pose3
from trailmark_sim.ground.ground import GroundTexture
from trailmark_sim.ground.optics import Optics, led_light
from trailmark_sim.ground.regions import TileRegion, touched_tiles
from trailmark_sim.ground.tiles import TILE_TEXELS, lend_tiles
from trailmark_sim.ground.warp import GreyResponse, expose_rows, warp_rows
from trailmark_sim.rng import frame_rng, stream_key
from trailmark_sim.sensors.shutter import Shutter
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.workers import in_bands

__all__ = ["GroundCameraSensor", "GroundRig"]

#: A smear of less than this is not rendered: the lens' own blur hides it [px].
_SMEAR_PX = 0.5
_MOST_INSTANTS = 32
#: Lengths of the bumps that make the camera nod [m].
_BUMPS_M = (0.02, 0.5)
_N_BUMPS = 6


@dataclass(frozen=True, slots=True)
class GroundRig:
    """Size, scale and place of a ground camera. The defaults are those of Nagai & Watanabe, Sec. IV-A.

    Attributes
    ----------
    width, height : int
        Size of the picture [px].
    field_m : (float, float)
        What it sees of the ground, along u and along v [m].
    rate_hz : float
        Pictures per second [Hz].
    mounting : Pose3
        ``point_base = mounting @ point_camera``. Along u the ground goes forward of the camera, along v to its
        right; turned by 180 deg, the vehicle's forward is -u as in the paper.
    """

    width: int = 512
    height: int = 480
    field_m: tuple[float, float] = (0.200, 0.188)
    rate_hz: float = 70.0
    mounting: Pose3 = Pose3(yaw=math.pi)

    @property
    def metres_per_pixel(self) -> tuple[float, float]:
        """Ground distance of one pixel along u and v [m/px]."""
        return self.field_m[0] / self.width, self.field_m[1] / self.height


class GroundCameraSensor:
    """Pictures of the ground under a vehicle.

    Parameters
    ----------
    name : str
        Name of the sensor.
    ground : GroundTexture
        What it sees.
    rig, optics
        How it sees it.
    seed : int
        Of noise and jitter.
    cap_mb : float
        Memory for tiles of the ground [MB].
    threads : int
        Threads that render; the bytes do not depend on it.

    Raises
    ------
    ConfigError
        If it takes longer to expose or to read a picture than until the next, or the tiles have too little memory.
    """

    def __init__(
        self,
        name: str,
        ground: GroundTexture,
        rig: GroundRig,
        optics: Optics,
        seed: int,
        cap_mb: float = 128.0,
        threads: int = 2,
    ) -> None:
        self.rig, self.optics = rig, optics
        self._shutter = Shutter(optics.exposure_s, optics.readout_s)
        self._shutter.refuse_at(name, rig.rate_hz)
        scale = rig.metres_per_pixel
        self._light = led_light(rig.width, rig.height, optics.vignette)
        self.info = SensorInfo(
            name, "image", (rig.width, rig.height), rig.rate_hz, rig.mounting, GroundPlane(scale, None, self._light)
        )
        self.rate_hz = rig.rate_hz
        self.tiles = lend_tiles(self, ground, optics.psf_px * min(scale), cap_mb, threads)
        self._texel_map = np.diag([1.0 / ground.texel_m, 1.0 / ground.texel_m, 1.0])
        self._pose_base_camera = rig.mounting.planar()
        self._plane_pixel = _plane_pixel(rig)
        self._seed = seed
        self._bumps = _bumps(seed, name)
        self._threads = threads

    def render(self, k: int, stamp_s: float, state: VehicleState) -> Image:
        """Return picture number `k`."""
        region = self._region(state)
        out = np.empty((self.rig.height, self.rig.width), dtype=np.uint8)
        optics = self.optics
        noise = (optics.read_noise**2, optics.shot_noise**2 / 255.0)
        response = GreyResponse(optics.gain, optics.offset, *noise)
        seed = np.uint64(stream_key(self._seed, f"{self.info.name}/noise/{k}"))

        def expose(first: int, last: int) -> None:
            expose_rows(out, first, last, region, self._light, response, seed)

        in_bands(expose, self.rig.height, self._threads)
        return Image(out)

    def radiance(self, state: VehicleState) -> Float32s:
        """Return what the ground sends into the lens, before light, noise and grey steps: (H, W) greys."""
        region = self._region(state)
        grey = np.empty((self.rig.height, self.rig.width), dtype=np.float32)

        def warp(first: int, last: int) -> None:
            warp_rows(grey, first, last, region)

        in_bands(warp, self.rig.height, self._threads)
        return grey

    def ground_pixel(self, state: VehicleState) -> Floats:
        """Return the homography (3, 3) from pixels to the map [m]: the camera's closed form."""
        pose_map_camera = state.pose_map_base @ self._pose_base_camera
        return np.asarray(pose_map_camera.matrix() @ self._nod(state.travelled_m) @ self._plane_pixel)

    def _nod(self, travelled_m: float) -> Floats:
        """Return what height and tilt make of the plane: shift, scale and keystone, (3, 3) in metres."""
        optics = self.optics
        phases = travelled_m / self._bumps[:, 0] * 2.0 * math.pi
        waves = math.sqrt(2.0 / _N_BUMPS) * np.sin(phases[:, None] + self._bumps[:, 1:]).sum(axis=0)
        scale = 1.0 + optics.height_jitter * float(waves[0])
        roll, pitch = (optics.tilt_jitter_rad * float(wave) for wave in waves[1:])
        if scale == 1.0 and roll == 0.0 and pitch == 0.0:
            return np.eye(3)
        # A ray (x, y, -h) of the level camera, turned by roll and pitch, meets the ground at h (x', y') / -z'.
        h = optics.camera_height_m
        level = np.diag([1.0, 1.0, -h])
        turned = np.diag([h, h, -1.0]) @ Pose3(roll=roll, pitch=pitch).rotation() @ level
        return np.asarray(np.diag([scale, scale, 1.0]) @ turned / turned[2, 2])

    def _homographies(self, state: VehicleState) -> Floats:
        """Return the homographies from pixels to texels at each instant of the exposure, for each row or for all."""
        exposure_s, twist = self.optics.exposure_s, state.twist
        reach_m = math.hypot(*self.rig.field_m) / 2.0
        speed = math.hypot(twist.forward_mps, twist.left_mps) + abs(twist.yaw_radps) * reach_m
        smear_px = speed * exposure_s / min(self.rig.metres_per_pixel)
        n = 1 if smear_px < _SMEAR_PX else min(_MOST_INSTANTS, 1 + math.ceil(smear_px))
        sharp = self._texel_map @ self.ground_pixel(state)
        is_rolling = self.optics.readout_s > 0.0 and speed > 0.0
        if n == 1 and not is_rolling:
            return sharp[np.newaxis, np.newaxis]
        map_base = state.pose_map_base.matrix()
        base_texel = np.linalg.inv(self._texel_map @ map_base)
        instants_s = exposure_s * ((np.arange(n) + 0.5) / n - 0.5)
        rows_s = self._shutter.rows_after_s(self.rig.height) if is_rolling else np.zeros(1)
        after_s = (rows_s[:, np.newaxis] + instants_s).ravel()
        moves = np.stack([twist.after(at_s).matrix() for at_s in after_s.tolist()])
        moved = self._texel_map @ map_base @ moves @ base_texel @ sharp
        return moved.reshape(len(rows_s), n, 3, 3)

    def _region(self, state: VehicleState) -> TileRegion:
        """Return the tiles under the picture, which are painted if they are not there yet."""
        texel_pixel = self._homographies(state)
        width, height = self.rig.width, self.rig.height
        corners = np.array([[0.0, width - 1, width - 1, 0.0], [0.0, 0.0, height - 1, height - 1], [1.0] * 4])
        ends = np.concatenate([texel_pixel[0], texel_pixel[len(texel_pixel) // 2], texel_pixel[-1]])
        seen = ends @ corners
        texel = seen[:, :2] / seen[:, 2:]
        # One texel more on every side: what rounds over an edge still lies in the region.
        x, y = (math.floor(n / TILE_TEXELS) for n in texel.min(axis=(0, 2)) - 1.0)
        n_cols, n_rows = (math.floor(n / TILE_TEXELS) + 1 - low for n, low in zip(texel.max(axis=(0, 2)) + 1.0, (x, y)))
        middle = np.linalg.inv(ends[len(ends) // 2])
        margin_px = 2.0 + float(np.abs(texel - texel[len(texel) // 2]).max())  # a pixel is more than a texel
        touched = touched_tiles(middle, (x, y, n_cols, n_rows), (width, height), margin_px)
        rows, cols = np.nonzero(touched)
        slots = np.zeros(touched.shape, dtype=np.int32)
        slots[rows, cols] = self.tiles.slots_of([(x + c, y + r) for r, c in zip(rows.tolist(), cols.tolist())])
        to_region = np.array([[1.0, 0.0, -x * TILE_TEXELS], [0.0, 1.0, -y * TILE_TEXELS], [0.0, 0.0, 1.0]])
        return TileRegion(to_region @ texel_pixel, self.tiles.pairs, slots)


def _plane_pixel(rig: GroundRig) -> Floats:
    """Return the matrix (3, 3) from pixels to camera axes on the ground [m]."""
    scale_u, scale_v = rig.metres_per_pixel
    return np.array(
        [
            [scale_u, 0.0, -scale_u * (rig.width - 1) / 2.0],
            [0.0, -scale_v, scale_v * (rig.height - 1) / 2.0],  # seen from above, v grows to the right
            [0.0, 0.0, 1.0],
        ]
    )


def _bumps(seed: int, name: str) -> Floats:
    """Return bumps (N, 4): length [m] and the phases of height, roll and pitch."""
    rng = frame_rng(seed, f"{name}/bumps")
    lengths = np.geomspace(*_BUMPS_M, _N_BUMPS) * rng.uniform(0.8, 1.25, _N_BUMPS)
    return np.column_stack([lengths, rng.uniform(0.0, 2.0 * math.pi, (_N_BUMPS, 3))])


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"GroundCamera": GroundCameraSensor})
