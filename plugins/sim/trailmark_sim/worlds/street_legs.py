"""Legs of the street: what is paved, where houses stand, and what stands before them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trailmark.geometry import Pose2

__all__ = ["PLANS", "Block", "HouseRow", "Leg", "StreetPlan", "Strip"]

Place = tuple[float, float]

#: Edge of the paved way to the left of the route [m].
_KERB_M = 2.2


@dataclass(frozen=True, slots=True)
class Strip:
    """A rectangle of ground: ``"slabs"``, ``"tar"`` or ``"green"`` from corner to corner, at a height [m].

    Attributes
    ----------
    ground : str
        ``slabs``, ``tar`` or ``green``.
    west, east, south, north : float
        Sides [m].
    z : float
        Height [m].
    """

    ground: str
    west: float
    east: float
    south: float
    north: float
    z: float


@dataclass(frozen=True, slots=True)
class HouseRow:
    """A row of houses along x of a leg.

    Attributes
    ----------
    side : str
        ``north`` or ``south`` of the leg.
    west, east : float
        From where to where [m].
    is_cut : bool
        Whether the last house ends at `east`.
    """

    side: str
    west: float
    east: float
    is_cut: bool


@dataclass(frozen=True, slots=True)
class Leg:
    """A stretch of street in axes of its own: along x, green and houses to the left, cars and houses to the right.

    Attributes
    ----------
    pose : Pose2
        ``point_map = pose @ point_leg``.
    houses : tuple of HouseRow
        In the leg's axes.
    cars, trees : tuple of (float, float)
        Where they stand.
    signs, posts, boards, drains : tuple of float
        Where along x [m].
    """

    pose: Pose2
    houses: tuple[HouseRow, ...]
    cars: tuple[Place, ...]
    trees: tuple[Place, ...]
    signs: tuple[float, ...]
    posts: tuple[float, ...]
    boards: tuple[float, ...]
    drains: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Block:
    """A rectangle of houses that a vehicle can run into [m].

    Attributes
    ----------
    west, east, south, north : float
        Sides [m].
    """

    west: float
    east: float
    south: float
    north: float


@dataclass(frozen=True, slots=True)
class StreetPlan:
    """The street of one route.

    Attributes
    ----------
    bounds : (float, float, float, float)
        West, east, south and north end of where a vehicle can be [m].
    legs : tuple of Leg
        Its stretches.
    strips : tuple of Strip
        The ground, in the map.
    kerbs : tuple of (float, float)
        From where to where along x of each leg its kerb goes [m].
    end : (float, float, float)
        Middle and width of the house that closes the far end [m].
    blocks : tuple of Block
        Houses within the bounds.
    lanes : tuple of (float, float)
        The ways of people beside a lane's offset to the left: see `lane`.
    """

    bounds: tuple[float, float, float, float]
    legs: tuple[Leg, ...]
    strips: tuple[Strip, ...]
    kerbs: tuple[tuple[float, float], ...]
    end: tuple[float, float, float]
    blocks: tuple[Block, ...]
    lanes: tuple[Place, ...]

    def lane(self, left_m: float) -> list[Place]:
        """Return the way of a person who keeps `left_m` to the left of the middle."""
        if len(self.lanes) == 2:
            (first, _), (last, _) = self.lanes
            return [(first, left_m), (last, left_m * 0.9)]
        (first, _), (corner, across), (last, _) = self.lanes
        return [(first, left_m), (corner - left_m, left_m), (corner - left_m, across + left_m), (last, across + left_m)]


def _long_strips(west: float, east: float) -> tuple[Strip, ...]:
    return (
        Strip("slabs", west, east, -_KERB_M - 0.3, _KERB_M, 0.0),
        Strip("tar", west, east, -10.5, -_KERB_M - 0.3, -0.1),
        Strip("green", west, east, _KERB_M, 9.0, 0.0),
    )


_STRAIGHT = StreetPlan(
    bounds=(-8.0, 62.0, -7.5, 6.0),
    legs=(
        Leg(
            pose=Pose2(),
            houses=(HouseRow("north", -18.0, 72.0, False), HouseRow("south", -18.0, 72.0, False)),
            cars=((6.0, -4.4), (12.5, -4.5), (20.5, -4.3), (27.0, -4.5), (38.0, -4.4), (46.0, -4.4)),
            trees=(
                *((4.0, 3.4), (11.0, 3.5), (18.0, 3.3), (25.0, 3.5), (33.0, 3.4), (42.0, 3.5)),
                *((15.5, -6.3), (31.0, -6.2)),
            ),
            signs=(8.0, 17.5, 28.5, 40.0),
            posts=(6.5, 13.5, 23.0, 35.0),
            boards=(5.0, 14.0, 21.5),
            drains=(3.0, 9.5, 16.0, 22.0, 36.0),
        ),
    ),
    strips=_long_strips(-28.0, 82.0),
    kerbs=((-8.0, 62.0),),
    end=(71.0, -1.0, 20.0),
    blocks=(),
    lanes=((1.0, 0.0), (50.0, 0.0)),
)

#: 20 m on a street to the left, 18 m on one to the right.
_BENDS = StreetPlan(
    bounds=(-8.0, 52.0, -7.5, 24.0),
    legs=(
        Leg(
            pose=Pose2(),
            houses=(HouseRow("north", -18.0, 14.0, True), HouseRow("south", -18.0, 36.0, True)),
            cars=((6.0, -4.4), (12.5, -4.5)),
            trees=((4.0, 3.4), (11.0, 3.5), (15.5, -6.3)),
            signs=(8.0,),
            posts=(6.5, 13.5),
            boards=(5.0, 14.0),
            drains=(3.0, 9.5, 16.0),
        ),
        Leg(
            pose=Pose2(20.0, 0.0, np.pi / 2),
            houses=(HouseRow("north", 12.0, 24.0, True), HouseRow("south", -10.0, 8.0, True)),
            cars=((4.5, -4.4), (11.0, -4.5)),
            trees=((7.5, 3.4), (14.0, 3.5), (1.0, -6.3)),
            signs=(5.0,),
            posts=(4.2, 10.5),
            boards=(11.0,),
            drains=(6.0,),
        ),
        Leg(
            pose=Pose2(20.0, 18.0, 0.0),
            houses=(HouseRow("north", -12.0, 40.0, False), HouseRow("south", 16.0, 40.0, False)),
            cars=((6.5, -4.4), (14.0, -4.4)),
            trees=((0.5, 3.4), (8.0, 3.5), (15.0, 3.4), (22.0, 3.5), (18.5, -6.2)),
            signs=(5.5, 17.0),
            posts=(6.0, 13.0, 20.0),
            boards=(3.0, 11.5),
            drains=(4.0, 11.0),
        ),
    ),
    strips=(
        Strip("tar", -60.0, 110.0, -60.0, 80.0, -0.1),
        Strip("slabs", -28.0, 22.5, -2.5, 2.2, 0.0),
        Strip("slabs", 17.8, 22.5, 2.2, 15.5, 0.0),
        Strip("slabs", 17.8, 72.0, 15.5, 20.2, 0.0),
        Strip("green", -28.0, 17.8, 2.2, 9.0, 0.0),
        Strip("green", 5.0, 17.8, 9.0, 20.2, 0.0),
        Strip("green", 5.0, 72.0, 20.2, 27.0, 0.0),
    ),
    kerbs=((-8.0, 22.5), (-2.5, 15.5), (2.5, 52.0)),
    end=(61.0, 17.0, 20.0),
    blocks=(Block(-8.0, 14.0, 6.0, 24.0), Block(30.0, 52.0, -7.5, 8.0)),
    lanes=((1.0, 0.0), (20.0, 18.0), (45.0, 0.0)),
)
#: The street that each route leads along.
PLANS: Mapping[str, StreetPlan] = {"straight": _STRAIGHT, "bends": _BENDS}
