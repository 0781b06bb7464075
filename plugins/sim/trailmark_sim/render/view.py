"""One look at a scene: the kernels with everything they need, in bands of tiles."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.arrays import AnyArray, Bools, Float32s, Floats
from trailmark.deprecation import deprecated_name
from trailmark.geometry import Pose3
from trailmark_sim.render.cast import NOTHING_M, bound_shapes, cast_tiles
from trailmark_sim.render.facing import face_tiles
from trailmark_sim.render.rays import LANES, RayTable
from trailmark_sim.render.records import RayHits, SeenShapes, SensorSurroundings
from trailmark_sim.render.scene import Scene
from trailmark_sim.render.shade import shade_tiles
from trailmark_sim.render.shapes import RECTANGLE
from trailmark_sim.render.viewpoints import Moment, Viewpoints
from trailmark_sim.workers import in_bands

__all__ = ["SceneView"]

#: Radius of a shape that cannot be met.
_NEVER_M = -1e9


class SceneView:
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
    left_out : (P,) bool or None
        Which of the shapes that stand are not there for it; None: all are.
    """

    def __init__(
        self,
        scene: Scene,
        table: RayTable,
        pose_map_sensor: Pose3 | Viewpoints,
        moment: Moment | None = None,
        threads: int = 1,
        left_out: Bools | None = None,
    ) -> None:
        self._scene, self.table, self._threads, self._moment = scene, table, threads, moment
        points = Viewpoints.of(pose_map_sensor) if isinstance(pose_map_sensor, Pose3) else pose_map_sensor
        self._points, n_instants = points, len(points.eyes)
        frames, origins, centres = scene.frames[None], scene.origins[None], scene.centres[None]
        self._shadows = np.empty((n_instants, 0, 4), np.float32)
        if moment is not None:
            n = scene.n_fixed
            frames = _stack_moving(scene.frames[:n], moment.frames, 3)
            origins = _stack_moving(scene.origins[:n], moment.origins, 2)
            centres = _stack_moving(scene.centres[:n], moment.centres, 2)
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
        if left_out is not None:
            faces[:, : len(left_out)] &= ~left_out
        near = np.where(is_rectangle, np.maximum(near, eyes[..., 0]), near).min(axis=0)
        order = np.argsort(near, kind="stable")
        n_shapes = frames.shape[1]
        turned = frames.reshape(-1, 3 * n_shapes, 3) @ points.rotations  # all rows of all shapes in one product
        radii = np.where(faces, scene.radii * 1.0001 + 1e-4, _NEVER_M)
        order = order[faces.any(axis=0)[order]].astype(np.int32)
        frames_seen, eyes_seen = turned.astype(np.float32).reshape(n_instants, n_shapes, 3, 3), eyes.astype(np.float32)
        spheres = np.concatenate([towards, radii[..., None]], axis=2).astype(np.float32)
        bounds = bound_shapes(scene.kinds, frames_seen, eyes_seen, spheres, order)
        near_m = (near * 0.9999 - 1e-3).astype(np.float32)
        self.shapes = SeenShapes(scene.kinds, frames_seen, eyes_seen, bounds, near_m, order)
        size = (table.n_tiles, LANES)
        self.met = RayHits(np.empty(size, np.float32), np.empty(size, np.int32))
        in_bands(lambda first, last: cast_tiles(first, last, table, self.shapes, self.met), table.n_tiles, threads)

    def radiance(self) -> Float32s:
        """Return the light of every pixel, (H, W, 3) red, green, blue; 1 is a white wall in unit light."""
        light = self._own_light()
        for share, reflected in self.reflections():
            light += self.table.picture(share, 0.0)[..., None] * (reflected._own_light() - light)
        return light

    def reflections(self) -> Iterator[tuple[Float32s, SceneView]]:
        """Give the share of its light that each ray gets from a mirror, (T, 64), and what is seen in it, by mirror.

        A mirror in a mirror is no mirror.
        """
        for mirror in self._scene.mirrors:
            is_met = np.isin(self.met.shapes, mirror.shapes)
            if is_met.any():
                points, hidden = mirror.reflect(self._points), mirror.is_behind
                reflected = SceneView(self._scene, self.table, points, self._moment, self._threads, hidden)
                yield np.where(is_met, mirror.share(self.facing()[0]), np.float32(0.0)), reflected

    def _own_light(self) -> Float32s:
        table, scene = self.table, self._scene
        height, width = table.shape
        out = np.zeros((height * width, 3), np.float32)
        around = SensorSurroundings(self._to_map, scene.key.astype(np.float32), self._shadows, scene.sky)
        looks = (scene.surfaces, scene.light, scene.atlas)

        def shade(first: int, last: int) -> None:
            shade_tiles(first, last, table, self.met, self.shapes, *looks, around, out)

        in_bands(shade, table.n_tiles, self._threads)
        return out.reshape(height, width, 3)

    def facing(self) -> tuple[Float32s, Float32s]:
        """Return the cosine between each ray and the surface it meets, and how much that mirrors: (T, 64) each."""
        cosines, shine = np.empty_like(self.ranges_m), np.empty_like(self.ranges_m)

        def face(first: int, last: int) -> None:
            face_tiles(first, last, self.table, self.met, self.shapes, self._scene.surfaces, cosines, shine)

        in_bands(face, self.table.n_tiles, self._threads)
        return cosines, shine

    def labels(self) -> npt.NDArray[np.str_]:
        """Return what every pixel shows, (H, W): the label of its shape; "" for what moves, and where nothing is."""
        known = np.array([*self._scene.labels, ""])
        shapes = self.table.picture(self.met.shapes.astype(np.float32), -1.0).astype(np.intp)
        return np.asarray(known[np.where((shapes >= 0) & (shapes < len(known) - 1), shapes, -1)])

    @property
    def ranges_m(self) -> Float32s:
        """Range along each ray, (T, 64); `NOTHING_M` where it meets nothing [m]."""
        return self.met.ranges_m

    @property
    def is_nothing(self) -> Bools:
        """Which rays meet nothing, (T, 64)."""
        return self.ranges_m >= NOTHING_M


def _stack_moving(fixed: Floats, moving: Floats, ndim: int) -> AnyArray:
    """Return rows (1, n, ...) or (G, n, ...) of what stands, then of what moves; a row has ``ndim - 1`` axes."""
    moving = moving if moving.ndim > ndim else moving[None]
    still = np.broadcast_to(fixed, (len(moving), *fixed.shape))
    return np.concatenate([still, moving], axis=1)


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"View": SceneView})
