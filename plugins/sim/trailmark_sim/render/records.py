"""What the kernels of the renderer take and hand on: records of arrays, by name. Numba takes them whole."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from trailmark.arrays import AnyArray, Float32s, Int32s

__all__ = ["N_BOUNDS", "SURFACE_ROW", "RayHits", "SeenShape", "SeenShapes", "SensorSurroundings", "TileRays"]

#: A row of `Scene.surfaces`: how a shape looks, and where its baked light stands in `Scene.light`.
SURFACE_ROW = np.dtype(
    [
        *((name, np.float32) for name in ("repeat_u", "repeat_v", "red", "green", "blue", "emission", "shine")),
        ("texels_per_m", np.float32),
        *((name, np.int32) for name in ("texture", "light_start", "light_columns", "light_rows")),
        ("is_floor", np.bool_),
    ],
    align=True,
)

#: Numbers of a column of `SeenShapes.bounds`.
N_BOUNDS = 16


class SeenShapes(NamedTuple):
    """All P shapes of a scene, as a sensor sees them at each of G instants.

    Attributes
    ----------
    kinds : (P,) int8
        Kind of each shape.
    frames : (G, P, 3, 3) float32
        From the sensor's axes to each shape's own.
    eyes : (G, P, 3) float32
        The eye in each shape's own axes.
    bounds : (G, N_BOUNDS, M) float32
        Of each shape of `order`, by columns: the centre and the radius of a sphere around it in the sensor's axes [m],
        and four vectors of length one (zeros: none). No ray meets it whose product with one of them is negative.
        Columns beyond `order` are of shapes that cannot be met.
    near_m : (P,) float32
        No point of the shape is ever nearer than this [m].
    order : (N,) int32
        Shapes that face the sensor at any instant, in the order of `near_m`.
    """

    kinds: AnyArray
    frames: Float32s
    eyes: Float32s
    bounds: Float32s
    near_m: Float32s
    order: Int32s


class RayHits(NamedTuple):
    """What each ray of a `RayTable` meets first.

    Attributes
    ----------
    ranges_m : (T, 64) float32
        Range along each ray; `NOTHING_M` where it meets nothing [m].
    shapes : (T, 64) int32
        Number of the shape, or -1.
    """

    ranges_m: Float32s
    shapes: Int32s


class SensorSurroundings(NamedTuple):
    """What lies around the shapes of a scene, and where a sensor stands in it at each of G instants.

    Attributes
    ----------
    to_map : (G, 4, 3) float32
        Rotation from the sensor's axes to the map, and the eye.
    key : (3,) float32
        Direction to the key light, in the map.
    shadows : (G, K, 4) float32
        Soft round shadows on floors: x, y, radius [m], depth.
    sky : (H, W, 3) float32
        Light from where no shape is.
    """

    to_map: Float32s
    key: Float32s
    shadows: Float32s
    sky: Float32s


class TileRays(NamedTuple):
    """Rays of a tile: all 64, or those that meet one surface, without gaps.

    Attributes
    ----------
    dx, dy, dz : array
        (64,) float32, along each ray; of length one.
    pixels : array
        (64,), index of each in the picture; -1: none.
    pixel_rad : array
        (64,), angle to the next ray [rad].
    ranges_m : array
        (64,), way to what it meets [m].
    """

    dx: AnyArray
    dy: AnyArray
    dz: AnyArray
    pixels: AnyArray
    pixel_rad: AnyArray
    ranges_m: AnyArray


class SeenShape(NamedTuple):
    """One shape of `SeenShapes` at one instant: its number and kind, its frame (3, 3) and the eye in it (3,).

    Attributes
    ----------
    number, kind : Any
        Number of the shape in the scene, and which kind it is.
    frame : array
        (3, 3), axes of the shape in the map.
    eye : array
        (3,), the camera in coordinates of the shape [m].
    """

    number: Any
    kind: Any
    frame: AnyArray
    eye: AnyArray
