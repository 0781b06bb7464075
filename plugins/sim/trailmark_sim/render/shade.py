"""The kernel that gives each ray its light: texture, baked light, highlights, sky.

The rays of a tile are done surface by surface, in loops without branches over all 64 of them: most tiles show one or
two surfaces, and eight or sixteen rays are done at once. What is computed for rays that meet something else is thrown
away; their range counts as 0, so that every number stays finite.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import inlined_kernel, kernel
from trailmark_sim.render.atlas import Atlas
from trailmark_sim.render.footprints import place_flat, place_round
from trailmark_sim.render.illumination import darken, mirrored_light, read_baked_light, show_sky
from trailmark_sim.render.lanes import Colours, Footprints, Taps, floats, ints
from trailmark_sim.render.rays import LANES, RayTable
from trailmark_sim.render.records import RayHits, SeenShape, SeenShapes, SensorSurroundings, TileRays
from trailmark_sim.render.reflectance import plain, read_texture
from trailmark_sim.render.shapes import RECTANGLE

__all__ = ["shade_tiles"]

_F: Any = np.float32
_I: Any = np.int32
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
    found, level, part, shade = ints(), ints(), floats(), floats()
    place = Footprints(floats(), floats(), floats(), floats(), floats(), floats(), floats())
    taps = Taps(floats(), floats(), floats(), floats(), ints(), ints(), ints(), ints())
    colours, lit = Colours(floats(), floats(), floats()), Colours(floats(), floats(), floats())
    for t in range(first, last):
        tile = TileRays(table.rays[t], table.pixels[t], table.pixel_rad[t], met.ranges_m[t], met.shapes[t])
        now = table.instants[t]
        to_map = around.to_map[now]
        for k in range(_distinct(tile.shapes, found)):
            p = found[k]
            if p < 0:
                show_sky(out, tile, to_map, around.sky)
                continue
            shape, surface = SeenShape(p, shapes.kinds[p], shapes.frames[now, p], shapes.eyes[now, p]), surfaces[p]
            n = surface.texture
            size = atlas.sizes[n]
            is_flat = shape.kind == RECTANGLE
            if is_flat:
                place_flat(tile, shape, place)
            else:
                texels = (surface.repeat_u * _F(size.width), surface.repeat_v * _F(size.height))
                place_round(tile, shape, surface.texels_per_m, texels, place)
            if size.n_levels == 1:
                plain(atlas.texels[atlas.starts[n, 0]], colours)
            else:
                read_texture(atlas.texels, atlas.starts[n], size, surface, place, taps, part, level, colours)
            read_baked_light(light, surface, is_flat, place, taps, lit)
            for lane in range(LANES):
                shade[lane] = _ONE
            if surface.is_floor and around.shadows.shape[1] > 0:
                darken(tile, p, to_map, around.shadows[now], taps, shade)
            _blend_lanes(out, tile, shape, surface, to_map, around.key, colours, lit, shade)


@inlined_kernel
def _blend_lanes(
    out: AnyArray,
    tile: TileRays,
    shape: SeenShape,
    surface: Any,
    to_map: AnyArray,
    key: AnyArray,
    colours: Colours,
    lit: Colours,
    shade: AnyArray,
) -> None:
    """Write the pixels that show a surface: its colour in its light, what it mirrors, and what shines of itself."""
    pixels, hit, p = tile.pixels, tile.shapes, shape.number
    red, green, blue = colours
    lr, lg, lb = lit
    shine, own = surface.shine, surface.emission
    for lane in range(LANES):
        pixel = pixels[lane]
        if hit[lane] != p or pixel < 0:
            continue
        gloss = _ZERO
        if shine > _ZERO:
            gloss = shine * mirrored_light(tile, lane, shape, to_map, key)
        out[pixel, 0] = surface.red * red[lane] * (lr[lane] * shade[lane] + own) + gloss * lr[lane]
        out[pixel, 1] = surface.green * green[lane] * (lg[lane] * shade[lane] + own) + gloss * lg[lane]
        out[pixel, 2] = surface.blue * blue[lane] * (lb[lane] * shade[lane] + own) + gloss * lb[lane]


@kernel(error_model="numpy")
def _distinct(hit: AnyArray, found: AnyArray) -> int:
    """Write which shapes the rays of a tile meet, each once, and return how many."""
    n = 0
    previous = _I(-2)
    for lane in range(LANES):
        p = hit[lane]
        if p == previous:
            continue
        previous = p
        is_new = True
        for k in range(n):
            is_new = is_new and found[k] != p
        if is_new:
            found[n] = p
            n += 1
    return n
