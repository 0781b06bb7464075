"""The kernel that gives each ray its light: texture, baked light, highlights, sky.

The rays of a tile are done surface by surface, in loops without branches over all 64 of them: most tiles show one or
two surfaces, and eight or sixteen rays are done at once. What is computed for rays that meet something else is thrown
away; their range counts as 0, so that every number stays finite.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.kernels import inlined_kernel, kernel
from trailmark_sim.render.footprints import place_flat, place_round
from trailmark_sim.render.illumination import baked, darken, mirrored, show_sky
from trailmark_sim.render.lanes import floats, ints
from trailmark_sim.render.rays import LANES
from trailmark_sim.render.reflectance import plain, textured
from trailmark_sim.render.shapes import RECTANGLE

__all__ = ["shade_tiles"]

_F: Any = np.float32
_I: Any = np.int32
_ZERO, _ONE = _F(0.0), _F(1.0)


@kernel(error_model="numpy")
def shade_tiles(
    first: int,
    last: int,
    rays: npt.NDArray[Any],
    pixels: npt.NDArray[Any],
    pixel_rad: npt.NDArray[Any],
    instants: npt.NDArray[Any],
    ranges: npt.NDArray[Any],
    hits: npt.NDArray[Any],
    kinds: npt.NDArray[Any],
    frames: npt.NDArray[Any],
    eyes: npt.NDArray[Any],
    looks: npt.NDArray[Any],
    textures: npt.NDArray[Any],
    floors: npt.NDArray[Any],
    light: npt.NDArray[Any],
    patches: npt.NDArray[Any],
    texels: npt.NDArray[Any],
    starts: npt.NDArray[Any],
    sizes: npt.NDArray[Any],
    sky: npt.NDArray[Any],
    to_map: npt.NDArray[Any],
    key: npt.NDArray[Any],
    shadows: npt.NDArray[Any],
    out: npt.NDArray[Any],
) -> None:
    """Give the rays of some tiles their light.

    Parameters
    ----------
    first, last : int
        Tiles `first` to `last` (without it) are done.
    rays, pixels, pixel_rad, instants
        Of the `RayTable`.
    ranges, hits
        From `cast_tiles`.
    kinds, frames, eyes
        As in `cast_tiles`.
    looks, textures, floors, light, patches, sky
        Of the `Scene`.
    texels, starts, sizes
        Of its `Atlas`.
    to_map : (G, 4, 3) float32
        Rotation from the camera's axes to the map, and the eye, at each instant.
    key : (3,) float32
        Direction to the key light, in the map.
    shadows : (G, K, 4) float32
        Soft round shadows on floors: x, y, radius [m], depth.
    out : (H * W, 3) float32
        Receives red, green and blue: 1 is a white wall in unit light.
    """
    surfaces, level = ints(), ints()
    at = (ints(), ints(), ints(), ints())
    u, v, foot = floats(), floats(), floats()
    ax, ay, bx, by = floats(), floats(), floats(), floats()
    x, y, wx, wy = floats(), floats(), floats(), floats()
    red, green, blue = floats(), floats(), floats()
    lr, lg, lb = floats(), floats(), floats()
    part, shade = floats(), floats()
    for tile in range(first, last):
        hit, ray, far = hits[tile], rays[tile], ranges[tile]
        now = instants[tile]
        for number in range(_distinct(hit, surfaces)):
            p = surfaces[number]
            if p < 0:
                show_sky(out, pixels[tile], hit, ray, to_map[now], sky)
                continue
            is_flat = kinds[p] == RECTANGLE
            n = textures[p]
            if is_flat:
                place_flat(p, hit, ray, far, frames[now, p], eyes[now, p], pixel_rad[tile], u, v, foot, ax, ay, bx, by)
            else:
                size = (looks[p, 0] * _F(sizes[n, 0]), looks[p, 1] * _F(sizes[n, 1]))
                place_round(
                    p, hit, ray, far, frames[now, p], eyes[now, p], kinds[p], pixel_rad[tile], looks[p, 7], size,
                    u, v, foot, ax, ay, bx, by,
                )  # fmt: skip
            if sizes[n, 2] == 1:
                plain(texels[starts[n, 0]], red, green, blue)
            else:
                textured(
                    texels, starts[n], sizes[n], looks[p], u, v, foot, ax, ay, bx, by,
                    x, y, wx, wy, part, level, at, red, green, blue,
                )  # fmt: skip
            baked(light, patches[p], is_flat, u, v, wx, wy, at, lr, lg, lb)
            for lane in range(LANES):
                shade[lane] = _ONE
            if floors[p] and shadows.shape[1] > 0:
                darken(shade, ray, far, hit, p, to_map[now], shadows[now], x, y)
            _blend_lanes(
                out, pixels[tile], hit, ray, far, p, looks[p], frames[now, p], eyes[now, p], kinds[p], to_map[now], key,
                red, green, blue, lr, lg, lb, shade,
            )  # fmt: skip


@inlined_kernel
def _blend_lanes(
    out: npt.NDArray[Any],
    pixels: npt.NDArray[Any],
    hit: npt.NDArray[Any],
    ray: npt.NDArray[Any],
    far: npt.NDArray[Any],
    p: int,
    look: npt.NDArray[Any],
    m: npt.NDArray[Any],
    q: npt.NDArray[Any],
    kind: int,
    to_map: npt.NDArray[Any],
    key: npt.NDArray[Any],
    red: npt.NDArray[Any],
    green: npt.NDArray[Any],
    blue: npt.NDArray[Any],
    lr: npt.NDArray[Any],
    lg: npt.NDArray[Any],
    lb: npt.NDArray[Any],
    shade: npt.NDArray[Any],
) -> None:
    """Write the pixels that show a surface: its colour in its light, what it mirrors, and what shines of itself."""
    shine = look[6]
    for lane in range(LANES):
        pixel = pixels[lane]
        if hit[lane] != p or pixel < 0:
            continue
        gloss = _ZERO
        if shine > _ZERO:
            gloss = shine * mirrored(ray, far, lane, m, q, kind, to_map, key)
        own = look[5]
        out[pixel, 0] = look[2] * red[lane] * (lr[lane] * shade[lane] + own) + gloss * lr[lane]
        out[pixel, 1] = look[3] * green[lane] * (lg[lane] * shade[lane] + own) + gloss * lg[lane]
        out[pixel, 2] = look[4] * blue[lane] * (lb[lane] * shade[lane] + own) + gloss * lb[lane]


@kernel(error_model="numpy")
def _distinct(hit: npt.NDArray[Any], surfaces: npt.NDArray[Any]) -> int:
    """Write which surfaces the rays of a tile meet, each once, and return how many."""
    n = 0
    previous = _I(-2)
    for lane in range(LANES):
        p = hit[lane]
        if p == previous:
            continue
        previous = p
        is_new = True
        for k in range(n):
            is_new = is_new and surfaces[k] != p
        if is_new:
            surfaces[n] = p
            n += 1
    return n
