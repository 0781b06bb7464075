"""Wings of the corridor: floor plans, and what stands and hangs in each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trailmark.geometry import Pose2
from trailmark_sim.render import lettering, textures
from trailmark_sim.render.scene import SceneBuilder, Surface
from trailmark_sim.worlds.furnishing import RoomExtent, add_room, add_wall, hang

__all__ = ["PLANS", "WINDOW_M", "Wing", "add_wings"]

_HEIGHT_M = 2.7
#: Windows are so wide, their sill so high, and they end there [m].
WINDOW_M, _SILL_M, _LINTEL_M = 1.5, 0.9, 2.2


@dataclass(frozen=True, slots=True)
class Wing:
    """A stretch of the corridor in axes of its own: along x, windows to the left (north), doors to the right.

    Attributes
    ----------
    pose : Pose2
        ``point_map = pose @ point_wing``.
    room : RoomExtent
        What it takes of the floor.
    north_end, south_end : float
        Where its long walls end; beyond, another wing begins [m].
    ends : tuple of str
        Its short walls: ``"west"`` behind, ``"east"`` at the far end.
    has_far_window : bool
        There is a window at the far end; otherwise pictures.
    windows, doors, posters, sheets, benches, plants, extinguishers, pipes, exits : tuples of float
        Where along x [m].
    """

    pose: Pose2
    room: RoomExtent
    north_end: float
    south_end: float
    ends: tuple[str, ...]
    has_far_window: bool
    windows: tuple[float, ...]
    doors: tuple[float, ...]
    posters: tuple[float, ...]
    sheets: tuple[float, ...]
    benches: tuple[float, ...]
    plants: tuple[float, ...]
    extinguishers: tuple[float, ...]
    pipes: tuple[float, ...]
    exits: tuple[float, ...]


_STRAIGHT = Wing(
    pose=Pose2(),
    room=RoomExtent(-2.0, 30.0, -1.2, 1.2, _HEIGHT_M),
    north_end=30.0,
    south_end=30.0,
    ends=("west", "east"),
    has_far_window=True,
    windows=(3.0, 6.0, 9.0, 15.0, 18.0, 21.0, 26.0),
    doors=(1.2, 5.0, 8.7, 12.9, 16.6, 20.8, 24.4),
    posters=tuple(np.arange(2.75, 29.0, 1.62).tolist()),
    sheets=(1.7, 5.6, 13.2, 17.0, 23.2),
    benches=(4.0, 11.5, 19.4),
    plants=(13.4,),
    extinguishers=(7.7, 15.7, 23.4),
    pipes=(5.2, 8.2, 12.0, 17.2, 24.0),
    exits=(10.5, 22.0),
)
#: 18.8 m on a wing to the left, 16.8 m on another to the right.
_FIRST = Wing(
    pose=Pose2(),
    room=RoomExtent(-2.0, 20.0, -1.2, 1.2, _HEIGHT_M),
    north_end=17.6,
    south_end=20.0,
    ends=("west", "east"),
    has_far_window=False,
    windows=(3.0, 6.0, 11.5, 14.5),
    doors=(1.2, 5.0, 8.7, 12.9, 16.6),
    posters=tuple(np.arange(2.75, 19.0, 1.62).tolist()),
    sheets=(1.7, 5.6, 10.2, 16.7),
    benches=(4.0, 11.5),
    plants=(9.4,),
    extinguishers=(7.7, 15.7),
    pipes=(5.2, 8.2, 13.6),
    exits=(14.0,),
)
_SECOND = Wing(
    pose=Pose2(18.8, 0.0, np.pi / 2),
    room=RoomExtent(1.2, 18.0, -1.2, 1.2, _HEIGHT_M),
    north_end=18.0,
    south_end=15.6,
    ends=("east",),
    has_far_window=False,
    windows=(2.4, 7.6, 10.4),
    doors=(3.1, 7.4, 11.6, 14.1),
    posters=tuple(np.arange(2.0, 15.2, 1.62).tolist()),
    sheets=(1.5, 4.6, 6.6, 12.6, 14.2, 16.6),
    benches=(5.6,),
    plants=(6.0,),
    extinguishers=(10.6,),
    pipes=(4.3, 9.6, 13.5),
    exits=(12.0,),
)
_THIRD = Wing(
    pose=Pose2(20.0, 16.8, 0.0),
    room=RoomExtent(0.0, 17.0, -1.2, 1.2, _HEIGHT_M),
    north_end=17.0,
    south_end=17.0,
    ends=("east",),
    has_far_window=True,
    windows=(2.5, 5.6, 10.0, 13.2),
    doors=(2.0, 5.9, 9.8, 14.2),
    posters=tuple(np.arange(1.4, 16.4, 1.62).tolist()),
    sheets=(0.6, 4.6, 8.4, 12.2),
    benches=(8.0,),
    plants=(8.9,),
    extinguishers=(4.2, 12.8),
    pipes=(1.9, 7.8, 12.0),
    exits=(6.5, 13.0),
)
#: The wings that each route leads through.
PLANS: Mapping[str, tuple[Wing, ...]] = {"straight": (_STRAIGHT,), "bends": (_FIRST, _SECOND, _THIRD)}


def add_wings(builder: SceneBuilder, rng: np.random.Generator, wings: Sequence[Wing]) -> None:
    """Add walls and windows of all wings."""
    paint = builder.texture(textures.plaster(rng, (206, 203, 190), 1024, 0.035))
    floor = builder.texture(textures.speckle(rng, (122, 116, 104), 512, 0.18, joints=4))
    ceiling = builder.texture(textures.panels(rng, (205, 205, 200)))
    for wing in wings:
        _add_shell(builder.at_pose(wing.pose), wing, paint, floor, ceiling)
    board = Surface(builder.texture(textures.boards(rng, (92, 74, 58), 64, 1)), (20.0, 1.0))
    dado = Surface(builder.texture(textures.plaster(rng, (96, 108, 100), 512, 0.05)), (20.0, 0.5))
    rail = Surface(builder.texture(textures.boards(rng, (150, 110, 70), 64, 1)), (20.0, 1.0))
    for wing in wings:
        _add_trim(builder.at_pose(wing.pose), wing, board, dado, rail)
    for wing in wings:
        _add_windows(builder.at_pose(wing.pose), rng, wing)


def _add_shell(builder: SceneBuilder, wing: Wing, paint: int, floor: int, ceiling: int) -> None:
    room = wing.room
    add_room(builder, room, (floor, 1.8), (ceiling, 2.4), {})
    add_wall(builder, replace(room, east=wing.south_end), "south", (paint, 2.7))
    for side in wing.ends:
        add_wall(builder, room, side, (paint, 2.7))
    # The wall with the windows: below, above and between them.
    length = wing.north_end - room.west
    edges = [room.west, *(x + side for x in wing.windows for side in (0.0, WINDOW_M)), wing.north_end]
    bands = [(room.west, length, 0.0, _SILL_M), (room.west, length, _LINTEL_M, room.height_m - _LINTEL_M)]
    bands += [(a, b - a, _SILL_M, _LINTEL_M - _SILL_M) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    for x, wide, z, high in bands:
        surface = Surface(paint, (wide / 2.7, high / 2.7))
        builder.rectangle((x, room.north, z), (wide, 0, 0), (0, 0, high), surface)


def _add_trim(builder: SceneBuilder, wing: Wing, board: Surface, dado: Surface, rail: Surface) -> None:
    room = wing.room
    south = (replace(room, east=wing.south_end), "south", wing.south_end - room.west)
    north = (room, "north", wing.north_end - room.west)
    far = [(room, "east", room.north - room.south)] if not wing.has_far_window else []
    for where, side, length in (south, north, *far):
        hang(builder, where, side, 0.0, 0.0, (length, 0.12), _stretch_surface(board, length), layer=1)
    for where, side, length in (south, north, *far):
        hang(builder, where, side, 0.0, 0.12, (length, 0.73), _stretch_surface(dado, length), layer=1)
    for where, side, length in (south, *far):
        hang(builder, where, side, 0.0, 0.85, (length, 0.10), _stretch_surface(rail, length), layer=1)


def _stretch_surface(surface: Surface, length_m: float) -> Surface:
    """Return a surface that repeats as often to the metre as on the whole wall of the straight corridor."""
    whole = _STRAIGHT.room.east - _STRAIGHT.room.west
    return replace(surface, repeat=(surface.repeat[0] * length_m / whole, surface.repeat[1]))


def _add_windows(builder: SceneBuilder, rng: np.random.Generator, wing: Wing) -> None:
    north, high = wing.room.north, _LINTEL_M - _SILL_M
    for number, x in enumerate(wing.windows):
        picture = builder.texture(textures.window(rng, 256, 2 + number % 2))
        # The sun shines from this side: what is behind the panes is too bright for the camera.
        pane = Surface(picture, emission=3.5, blocks_light=False)
        builder.rectangle((x, north + 0.12, _SILL_M), (WINDOW_M, 0, 0), (0, 0, high), pane)
        sill = Surface(tint=(0.75, 0.74, 0.7))
        builder.rectangle((x, north, _SILL_M), (WINDOW_M, 0, 0), (0, 0.12, 0), sill)
        builder.rectangle((x, north + 0.12, _LINTEL_M), (WINDOW_M, 0, 0), (0, -0.12, 0), sill)
        builder.rectangle((x, north, _SILL_M), (0, 0.12, 0), (0, 0, high), sill)
        builder.rectangle((x + WINDOW_M, north + 0.12, _SILL_M), (0, -0.12, 0), (0, 0, high), sill)
    if wing.has_far_window:
        glass = Surface(builder.texture(textures.window(rng, 256, 2)), emission=2.5, blocks_light=False)
        hang(builder, wing.room, "east", 0.45, 0.9, (1.5, 1.4), glass)
        return
    for along_m, print_ in ((0.25, lettering.poster(rng)), (1.25, lettering.notice(rng))):
        hang(builder, wing.room, "east", along_m, 1.1, (0.8, 1.0), Surface(builder.texture(print_)))
