"""One look at a scene: the kernels with everything they need, in bands of tiles."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.geometry import Pose3
from trailmark_sim.render.cast import NOTHING_M, cast_tiles
from trailmark_sim.render.facing import face_tiles
from trailmark_sim.render.rays import LANES, RayTable
from trailmark_sim.render.scene import Scene
from trailmark_sim.render.shade import shade_tiles
from trailmark_sim.render.shapes import RECTANGLE
from trailmark_sim.render.viewpoints import Moment, Viewpoints
from trailmark_sim.workers import in_bands

__all__ = ["View"]

#: Radius of a shape that cannot be met.
_NEVER_M = -1e9


class View:
    """What a camera, or a laser, sees of a scene from a pose, or from one for each instant of its `RayTable`.

    Parameters
    ----------
    scene : Scene
        What there is.
    table : RayTable
        Rays in the sensor's axes.
    pose_map_sensor : Pose3 or Viewpoints
        Where it looks from.
    moment : Moment or None
        Where the moving shapes are, at one instant or at each; None: where they were built.
    threads : int
        Threads that render; no byte depends on it.
    """

    def __init__(
        self,
        scene: Scene,
        table: RayTable,
        pose_map_sensor: Pose3 | Viewpoints,
        moment: Moment | None = None,
        threads: int = 1,
    ) -> None:
        self._scene, self.table, self._threads = scene, table, threads
        points = Viewpoints.of(pose_map_sensor) if isinstance(pose_map_sensor, Pose3) else pose_map_sensor
        n_instants = len(points.eyes)
        frames, origins, centres = scene.frames[None], scene.origins[None], scene.centres[None]
        self._shadows = np.empty((n_instants, 0, 4), np.float32)
        if moment is not None:
            n = scene.n_fixed
            frames = _followed(scene.frames[:n], moment.frames, 3)
            origins = _followed(scene.origins[:n], moment.origins, 2)
            centres = _followed(scene.centres[:n], moment.centres, 2)
            shadows = moment.shadows if moment.shadows.ndim == 3 else moment.shadows[None]
            self._shadows = np.ascontiguousarray(np.broadcast_to(shadows, (n_instants, *shadows.shape[1:])))
        at = points.eyes[:, None]
        self._to_map = np.concatenate([points.rotations, points.eyes[:, None]], axis=1).astype(np.float32)
        away = (at - origins)[..., None, :]
        eyes = frames[..., 0] * away[..., 0] + frames[..., 1] * away[..., 1] + frames[..., 2] * away[..., 2]
        towards = (centres - at) @ points.rotations
        near = np.linalg.norm(towards, axis=2) - scene.radii
        is_rectangle = scene.kinds == RECTANGLE
        faces = ~is_rectangle | (eyes[..., 0] > 0.0)
        near = np.where(is_rectangle, np.maximum(near, eyes[..., 0]), near).min(axis=0)
        order = np.argsort(near, kind="stable")
        self._order = order[faces.any(axis=0)[order]].astype(np.int32)
        n_shapes = frames.shape[1]
        turned = frames.reshape(-1, 3 * n_shapes, 3) @ points.rotations  # all rows of all shapes in one product
        self._frames = turned.astype(np.float32).reshape(n_instants, n_shapes, 3, 3)
        self._eyes = eyes.astype(np.float32)
        radii = np.where(faces, scene.radii * 1.0001 + 1e-4, _NEVER_M)
        self._spheres = np.concatenate([towards, radii[..., None]], axis=2).astype(np.float32)
        self._near = (near * 0.9999 - 1e-3).astype(np.float32)
        self.ranges_m = np.empty((table.n_tiles, LANES), np.float32)
        self.hits = np.empty((table.n_tiles, LANES), np.int32)
        in_bands(self._cast, table.n_tiles, threads)

    def _cast(self, first: int, last: int) -> None:
        table, scene = self.table, self._scene
        shapes = (scene.kinds, self._frames, self._eyes, self._spheres, self._near, self._order)
        rays = (table.rays, table.axes, table.spread, table.instants)
        cast_tiles(first, last, *rays, *shapes, self.ranges_m, self.hits)

    def radiance(self) -> npt.NDArray[np.float32]:
        """Return the light of every pixel, (H, W, 3) red, green, blue; 1 is a white wall in unit light."""
        table, scene, atlas = self.table, self._scene, self._scene.atlas
        height, width = table.shape
        out = np.zeros((height * width, 3), np.float32)
        surfaces = (scene.looks, scene.textures, scene.floors, scene.light, scene.patches)
        textures = (atlas.texels, atlas.starts, atlas.sizes, scene.sky)
        place = (self._to_map, scene.key.astype(np.float32), self._shadows)

        def shade(first: int, last: int) -> None:
            shapes = (scene.kinds, self._frames, self._eyes)
            found = (table.rays, table.pixels, table.pixel_rad, table.instants, self.ranges_m, self.hits)
            shade_tiles(first, last, *found, *shapes, *surfaces, *textures, *place, out)

        in_bands(shade, table.n_tiles, self._threads)
        return out.reshape(height, width, 3)

    def facing(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Return the cosine between each ray and the surface it meets, and how much that mirrors: (T, 64) each."""
        cosines, shine = np.empty_like(self.ranges_m), np.empty_like(self.ranges_m)

        def face(first: int, last: int) -> None:
            shapes = (self._scene.kinds, self._frames, self._eyes, self._scene.looks)
            rays = (self.table.rays, self.table.instants)
            face_tiles(first, last, *rays, self.ranges_m, self.hits, *shapes, cosines, shine)

        in_bands(face, self.table.n_tiles, self._threads)
        return cosines, shine

    @property
    def is_nothing(self) -> npt.NDArray[np.bool_]:
        """Which rays meet nothing, (T, 64)."""
        return self.ranges_m >= NOTHING_M


def _followed(fixed: npt.NDArray[np.float64], moving: npt.NDArray[np.float64], ndim: int) -> npt.NDArray[Any]:
    """Return rows (1, n, ...) or (G, n, ...) of what stands, then of what moves; a row has ``ndim - 1`` axes."""
    moving = moving if moving.ndim > ndim else moving[None]
    still = np.broadcast_to(fixed, (len(moving), *fixed.shape))
    return np.concatenate([still, moving], axis=1)
