"""Rooms with a laser in them, exactly."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.geometry import Pose2
from trailmark_laser_maps.carving import PlacedScan

#: Returns where rays of a laser end: walls (W, 4), pose of base, number of rays all round; (N, 2) in base axes [m].
Looker: TypeAlias = Callable[..., Floats]

#: Walls of a room of 8 x 5 m with a niche and a pillar, so that no two places look alike; from and to [m].
CORNERS = [(0, 0), (8, 0), (8, 2), (7, 2), (7, 3.5), (8, 3.5), (8, 5), (3, 5), (3, 4.4), (1, 4.4), (1, 5), (0, 5)]
PILLAR = [(4.5, 2.0), (5.0, 2.0), (5.0, 2.6), (4.5, 2.6)]


def _loop(corners: list[tuple[float, float]]) -> Floats:
    return np.array([(*a, *b) for a, b in zip(corners, corners[1:] + corners[:1])], np.float64)


WALLS = np.concatenate([_loop(CORNERS), _loop(PILLAR)])


def cast_rays(walls: Floats, origin: Floats, angles: Floats) -> Floats:
    """Return the ranges of rays to the nearest of walls (W, 4) [m]; infinite where there is none."""
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    start, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    offset = start - origin
    determinant = directions[:, None, 0] * along[None, :, 1] - directions[:, None, 1] * along[None, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        ranges = (offset[:, 0] * along[:, 1] - offset[:, 1] * along[:, 0])[None] / determinant
        share = (
            offset[None, :, 0] * directions[:, None, 1] - offset[None, :, 1] * directions[:, None, 0]
        ) / determinant
    meets = (ranges > 0) & (share >= 0) & (share <= 1)
    return np.where(meets, ranges, math.inf).min(axis=1)


@pytest.fixture(scope="session")
def walls() -> Floats:
    """The room."""
    return WALLS


@pytest.fixture(scope="session")
def look() -> Looker:
    """Return the points of a scan at a pose."""

    def points_at(walls: Floats, pose: Pose2, n_beams: int = 360, noise_m: float = 0.0, seed: int = 0) -> Floats:
        angles = np.linspace(-math.pi, math.pi, n_beams, endpoint=False)
        ranges = cast_rays(walls, pose.array()[:2], angles + pose.theta)
        ranges = ranges + noise_m * np.random.default_rng(seed).standard_normal(n_beams)
        seen = np.isfinite(ranges)
        return np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=1)[seen]

    return points_at


@pytest.fixture(scope="session")
def room_scans(walls: Floats, look: Looker) -> list[PlacedScan]:
    """Scans all over the room, enough to draw it."""
    places = [Pose2(x, y) for x in (1.0, 2.5, 4.0, 5.5, 6.5) for y in (0.6, 1.6, 2.9, 3.9)]
    return [PlacedScan.at(pose, look(walls, pose, 720), (0.0, 0.0)) for pose in places]
