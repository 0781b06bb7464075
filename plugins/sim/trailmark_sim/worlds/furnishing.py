"""Rooms and what stands in them, for several worlds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from trailmark_sim.render import textures
from trailmark_sim.render.bake import Lamp
from trailmark_sim.render.scene import Colour, SceneBuilder, Surface
from trailmark_sim.worlds.solids import Solids

__all__ = [
    *("RoomExtent", "Thing", "add_room", "add_wall", "block_things", "hang", "lamp_panels"),
    *("show_lamps", "show_things"),
]

#: Each layer on a wall stands so far before the one below [m].
_GAP_M = 0.003


@dataclass(frozen=True, slots=True)
class RoomExtent:
    """An upright room.

    Attributes
    ----------
    west, east, south, north : float
        Its walls [m].
    height_m : float
        Of its ceiling [m].
    """

    west: float
    east: float
    south: float
    north: float
    height_m: float

    def wall(self, side: str) -> tuple[tuple[float, float], tuple[float, float], float]:
        """Return the lower left corner of a wall as seen from inside, the direction along it, and its length."""
        wide, deep = self.east - self.west, self.north - self.south
        return {
            "south": ((self.east, self.south), (-1.0, 0.0), wide),
            "north": ((self.west, self.north), (1.0, 0.0), wide),
            "west": ((self.west, self.south), (0.0, 1.0), deep),
            "east": ((self.east, self.north), (0.0, -1.0), deep),
        }[side]


def add_room(
    builder: SceneBuilder,
    room: RoomExtent,
    floor: tuple[int, float],
    ceiling: tuple[int, float],
    walls: dict[str, tuple[int, float]],
    *,
    floor_mirror: float = 0.0,
) -> None:
    """Add floor, ceiling and walls; each a texture and the length that it covers once [m]."""
    wide, deep = room.east - room.west, room.north - room.south
    (texture, tile_m), (above, panel_m) = floor, ceiling
    ground = Surface(texture, (wide / tile_m, deep / tile_m), mirror=floor_mirror, is_floor=True)
    builder.rectangle((room.west, room.south, 0.0), (wide, 0, 0), (0, deep, 0), ground)
    top = Surface(above, (wide / panel_m, deep / panel_m))
    builder.rectangle((room.west, room.north, room.height_m), (wide, 0, 0), (0, -deep, 0), top)
    for side, paper in walls.items():
        add_wall(builder, room, side, paper)


def add_wall(builder: SceneBuilder, room: RoomExtent, side: str, paper: tuple[int, float]) -> None:
    """Add one wall: a texture and the length that it covers once [m]."""
    (x, y), (ax, ay), long = room.wall(side)
    texture, length_m = paper
    surface = Surface(texture, (long / length_m, room.height_m / length_m))
    builder.rectangle((x, y, 0.0), (ax * long, ay * long, 0.0), (0.0, 0.0, room.height_m), surface)


def hang(
    builder: SceneBuilder,
    room: RoomExtent,
    side: str,
    along_m: float,
    bottom_m: float,
    size: tuple[float, float],
    surface: Surface,
    layer: int = 2,
) -> None:
    """Hang a picture, a door or a window on a wall, `along_m` from its left corner as seen from inside.

    What has a higher `layer` hides what has a lower one; paint and skirting boards have 1.
    """
    (x, y), (ax, ay), _ = room.wall(side)
    out, gap_m = (ay, -ax), _GAP_M * layer  # into the room
    corner = (x + ax * along_m + out[0] * gap_m, y + ay * along_m + out[1] * gap_m, bottom_m)
    flat = replace(surface, blocks_light=False)  # so thin that it casts no shadow on its wall
    builder.rectangle(corner, (ax * size[0], ay * size[0], 0.0), (0.0, 0.0, size[1]), flat)


def lamp_panels(
    xs: Sequence[float], ys: Sequence[float], height_m: float, size: tuple[float, float], power: float
) -> tuple[Lamp, ...]:
    """Return a grid of ceiling lamps."""
    light = (power, power * 0.97, power * 0.90)
    return tuple(
        Lamp((x, y, height_m - 0.03), (size[0], 0.0, 0.0), (0.0, size[1], 0.0), (0.0, 0.0, -1.0), light)
        for x in xs
        for y in ys
    )


def show_lamps(builder: SceneBuilder, lamps: Sequence[Lamp], emission: float) -> None:
    """Add what is seen of lamps."""
    glow = Surface(tint=(1.0, 0.98, 0.94), emission=emission, blocks_light=False)
    for lamp in lamps:
        x, y, z = lamp.centre
        wide, deep = lamp.along[0], lamp.across[1]
        builder.rectangle((x - wide / 2, y + deep / 2, z + 0.01), (wide, 0, 0), (0, -deep, 0), glow)


class Thing(NamedTuple):
    """A coloured thing on the floor: ``box``, ``cylinder`` or ``ball``; side or radius [m].

    Attributes
    ----------
    shape : str
        ``box``, ``cylinder`` or ``ball``.
    x, y : float
        Middle in the map [m].
    size_m : float
        Side or radius [m].
    colour : Colour
        Red, green, blue, 0 to 1.
    """

    shape: str
    x: float
    y: float
    size_m: float
    colour: Colour


def block_things(solids: Solids, things: Sequence[Thing]) -> None:
    """Add things to what a vehicle can run into."""
    for thing in things:
        if thing.shape == "box":
            solids.box("a box", thing.x, thing.y, thing.size_m, thing.size_m, 0.5)
        else:
            solids.pole(f"a {thing.shape}", thing.x, thing.y, thing.size_m)


def show_things(builder: SceneBuilder, rng: np.random.Generator, things: Sequence[Thing], cylinder_m: float) -> None:
    """Add what is seen of things; cylinders are `cylinder_m` high."""
    card = builder.texture(textures.plaster(rng, (235, 235, 235), 128, 0.05))
    for shape, x, y, size, colour in things:
        surface = Surface(card, (1.0, 1.0), colour)
        if shape == "box":
            builder.box((x, y, 0.0), (size, size, size * 1.6), surface, 0.5)
        elif shape == "cylinder":
            builder.cylinder(x, y, 0.0, size, cylinder_m, surface)
        else:
            builder.ellipsoid((x, y, size), (size, size, size), surface)
