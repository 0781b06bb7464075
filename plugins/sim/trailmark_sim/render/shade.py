"""The kernel that gives each ray its light: texture, baked light, highlights, sky.

The rays of a tile are done surface by surface, those of one surface side by side, in loops without branches: eight or
sixteen rays are done at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import inlined_kernel, kernel
from trailmark_sim.render.atlas import Atlas
from trailmark_sim.render.footprints import place_flat, place_round
from trailmark_sim.render.illumination import darken, mirrored_light, read_baked_light, show_sky
from trailmark_sim.render.lanes import Colours, Footprints, Taps, distinct_shapes, floats, ints
from trailmark_sim.render.rays import LANES, RayTable
from trailmark_sim.render.records import RayHits, SeenShape, SeenShapes, SensorSurroundings, TileRays
from trailmark_sim.render.reflectance import plain, read_texture
from trailmark_sim.render.shapes import RECTANGLE

__all__ = ["shade_tiles"]

_F: Any = np.float32
_ZERO, _ONE = _F(0.0), _F(1.0)


@kernel(error_model="numpy")
def shade_tiles(
    first: int,
    last: int,
    table: RayTable,
    met: RayHits,
    shapes: SeenShapes,
    surfaces: AnyArray,
    light: AnyArray,
    atlas: Atlas,
    around: SensorSurroundings,
    out: AnyArray,
) -> None:
    """Give the rays of some tiles their light.

    Parameters
    ----------
    first, last : int
        Tiles `first` to `last` (without it) are done.
    table, met, shapes
        Rays, and what `cast_tiles` found along them.
    surfaces, light, atlas
        Of the `Scene`.
    around : SensorSurroundings
        Of the scene and the sensor.
    out : (H * W, 3) float32
        Receives red, green and blue: 1 is a white wall in unit light.
    """
    found, lanes, level = ints(), ints(), ints()
    part, shade, gloss = floats(), floats(), floats()
    tile = TileRays(floats(), floats(), floats(), ints(), floats(), floats())
    place = Footprints(floats(), floats(), floats(), floats(), floats(), floats(), floats())
    taps = Taps(floats(), floats(), floats(), floats(), ints(), ints(), ints(), ints())
    colours, lit = Colours(floats(), floats(), floats()), Colours(floats(), floats(), floats())
    for t in range(first, last):
        now = table.instants[t]
        to_map = around.to_map[now]
        n_found = distinct_shapes(met.shapes[t], found)
        for k in range(n_found):
            p = found[k]
            n = _pick(tile, lanes, table, met, t, p)
            if p < 0:
                show_sky(out, tile, n, to_map, around.sky)
                continue
            shape, surface = SeenShape(p, shapes.kinds[p], shapes.frames[now, p], shapes.eyes[now, p]), surfaces[p]
            texture = surface.texture
            size = atlas.sizes[texture]
            is_flat = shape.kind == RECTANGLE
            if is_flat:
                place_flat(tile, n, shape, place)
            else:
                texels = (surface.repeat_u * _F(size.width), surface.repeat_v * _F(size.height))
                place_round(tile, n, shape, surface.texels_per_m, texels, place)
            if size.n_levels == 1:
                plain(atlas.texels[atlas.starts[texture, 0]], n, colours)
            else:
                read_texture(atlas.texels, atlas.starts[texture], size, surface, n, place, taps, part, level, colours)
            read_baked_light(light, surface, is_flat, n, place, taps, lit)
            for lane in range(n):
                shade[lane], gloss[lane] = _ONE, _ZERO
            if surface.is_floor and around.shadows.shape[1] > 0:
                darken(tile, n, to_map, around.shadows[now], taps, shade)
            if surface.shine > _ZERO:
                for lane in range(n):
                    gloss[lane] = surface.shine * mirrored_light(tile, lane, shape, to_map, around.key)
            _add_up(surface, n, colours, lit, shade, gloss)
            for lane in range(n):
                pixel = tile.pixels[lane]
                if pixel >= 0:
                    out[pixel, 0], out[pixel, 1], out[pixel, 2] = (
                        colours.red[lane],
                        colours.green[lane],
                        colours.blue[lane],
                    )


@inlined_kernel
def _pick(tile: TileRays, lanes: AnyArray, table: RayTable, met: RayHits, t: int, p: int) -> int:
    """Copy the rays of a tile that meet one shape, and return how many there are.

    Up to a multiple of 16 the first follows again, of no pixel: loops of such lengths need no rest.
    """
    hit = met.shapes[t]
    n = 0
    for lane in range(LANES):
        lanes[n] = lane
        n += 1 if hit[lane] == p else 0
    whole = (n + 15) & ~15
    for k in range(n, whole):
        lanes[k] = lanes[0]
    ray, pixels, pixel_rad, far = table.rays[t], table.pixels[t], table.pixel_rad[t], met.ranges_m[t]
    for k in range(whole):
        at = np.uint64(lanes[k])  # unsigned: no test for indices from the end
        tile.dx[k], tile.dy[k], tile.dz[k] = ray[0, at], ray[1, at], ray[2, at]
        tile.pixels[k], tile.pixel_rad[k], tile.ranges_m[k] = pixels[at], pixel_rad[at], far[at]
    for k in range(n, whole):
        tile.pixels[k] = -1
    return whole


@inlined_kernel
def _add_up(surface: Any, n: int, colours: Colours, lit: Colours, shade: AnyArray, gloss: AnyArray) -> None:
    """Write what a surface sends to each pixel: its colour in its light, what it mirrors, and what shines of itself."""
    red, green, blue = colours
    lr, lg, lb = lit
    own = surface.emission
    for lane in range(n):
        red[lane] = surface.red * red[lane] * (lr[lane] * shade[lane] + own) + gloss[lane] * lr[lane]
        green[lane] = surface.green * green[lane] * (lg[lane] * shade[lane] + own) + gloss[lane] * lg[lane]
        blue[lane] = surface.blue * blue[lane] * (lb[lane] * shade[lane] + own) + gloss[lane] * lb[lane]
