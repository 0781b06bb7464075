"""One look at a scene from one pose: the kernels with everything they need, in bands of tiles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.geometry import Pose3
from trailmark_sim.render.cast import NOTHING_M, cast_tiles
from trailmark_sim.render.facing import face_tiles
from trailmark_sim.render.rays import LANES, RayTable
from trailmark_sim.render.scene import Scene
from trailmark_sim.render.shade import shade_tiles
from trailmark_sim.render.shapes import RECTANGLE
from trailmark_sim.workers import in_bands

__all__ = ["Moment", "View"]


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """Where the moving shapes of a scene are at one instant.

    Attributes
    ----------
    frames : (M, 3, 3) float64
    origins, centres : (M, 3) float64
        As in `Scene`, of its moving shapes.
    shadows : (K, 4) float32
        Soft shadows on the floor: x, y, radius [m], depth.
    """

    frames: npt.NDArray[np.float64]
    origins: npt.NDArray[np.float64]
    centres: npt.NDArray[np.float64]
    shadows: npt.NDArray[np.float32]


class View:
    """What a camera, or a laser, sees of a scene from a pose.

    Parameters
    ----------
    scene : Scene
        What there is.
    table : RayTable
        Rays in the sensor's axes.
    pose_map_sensor : Pose3
        Where it looks from.
    moment : Moment or None
        Where the moving shapes are; None: where they were built.
    threads : int
        Threads that render; no byte depends on it.
    """

    def __init__(
        self, scene: Scene, table: RayTable, pose_map_sensor: Pose3, moment: Moment | None = None, threads: int = 1
    ) -> None:
        self._scene, self._table, self._threads = scene, table, threads
        frames, origins, centres = scene.frames, scene.origins, scene.centres
        if moment is not None:
            n = scene.n_fixed
            frames = np.concatenate([frames[:n], moment.frames])
            origins = np.concatenate([origins[:n], moment.origins])
            centres = np.concatenate([centres[:n], moment.centres])
        self._shadows = np.empty((0, 4), np.float32) if moment is None else moment.shadows
        rotation = pose_map_sensor.rotation()
        eye = np.array([pose_map_sensor.x, pose_map_sensor.y, pose_map_sensor.z])
        self._to_map = np.vstack([rotation, eye]).astype(np.float32)
        eyes = np.einsum("pij,pj->pi", frames, eye - origins)
        towards = (centres - eye) @ rotation
        near = np.linalg.norm(towards, axis=1) - scene.radii
        is_rectangle = scene.kinds == RECTANGLE
        near = np.where(is_rectangle, np.maximum(near, eyes[:, 0]), near)
        order = np.argsort(near, kind="stable")
        seen = ~is_rectangle[order] | (eyes[order, 0] > 0.0)
        self._order = order[seen].astype(np.int32)
        self._frames = (frames @ rotation).astype(np.float32)
        self._eyes = eyes.astype(np.float32)
        self._spheres = np.column_stack([towards, scene.radii * 1.0001 + 1e-4]).astype(np.float32)
        self._near = (near * 0.9999 - 1e-3).astype(np.float32)
        self.ranges_m = np.empty((table.n_tiles, LANES), np.float32)
        self.hits = np.empty((table.n_tiles, LANES), np.int32)
        in_bands(self._cast, table.n_tiles, threads)

    def _cast(self, first: int, last: int) -> None:
        table, scene = self._table, self._scene
        shapes = (scene.kinds, self._frames, self._eyes, self._spheres, self._near, self._order)
        cast_tiles(first, last, table.rays, table.axes, table.spread, *shapes, self.ranges_m, self.hits)

    def radiance(self) -> npt.NDArray[np.float32]:
        """Return the light of every pixel, (H, W, 3) red, green, blue; 1 is a white wall in unit light."""
        table, scene, atlas = self._table, self._scene, self._scene.atlas
        height, width = table.shape
        out = np.zeros((height * width, 3), np.float32)
        surfaces = (scene.looks, scene.textures, scene.floors, scene.light, scene.patches)
        textures = (atlas.texels, atlas.starts, atlas.sizes, scene.sky)
        place = (self._to_map, scene.key.astype(np.float32), self._shadows)

        def shade(first: int, last: int) -> None:
            shapes = (scene.kinds, self._frames, self._eyes)
            found = (table.rays, table.pixels, table.pixel_rad, self.ranges_m, self.hits)
            shade_tiles(first, last, *found, *shapes, *surfaces, *textures, *place, out)

        in_bands(shade, table.n_tiles, self._threads)
        return out.reshape(height, width, 3)

    def facing(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Return the cosine between each ray and the surface it meets, and how much that mirrors: (T, 64) each."""
        cosines, shine = np.empty_like(self.ranges_m), np.empty_like(self.ranges_m)

        def face(first: int, last: int) -> None:
            shapes = (self._scene.kinds, self._frames, self._eyes, self._scene.looks)
            face_tiles(first, last, self._table.rays, self.ranges_m, self.hits, *shapes, cosines, shine)

        in_bands(face, self._table.n_tiles, self._threads)
        return cosines, shine

    @property
    def is_nothing(self) -> npt.NDArray[np.bool_]:
        """Which rays meet nothing, (T, 64)."""
        return self.ranges_m >= NOTHING_M
