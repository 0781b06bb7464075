"""People who walk about: nine ellipsoids each, moved by the clock alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trailmark.geometry import Pose2
from trailmark_sim.render.scene import Colour, SceneBuilder, Surface
from trailmark_sim.render.shapes import Shape, ellipsoid
from trailmark_sim.render.textures import clouds
from trailmark_sim.render.viewpoints import Moment
from trailmark_sim.rng import frame_rng

__all__ = ["Crowd", "Walk", "add_cloth"]

_STRIDE_M = 1.3
_SWING_M = 0.16
#: Room that people leave to a vehicle, from its middle [m].
_KEEP_M = 0.8
#: Of each part: forward, left, height [m]; half axes forward, left, up [m]; how far it swings; which colour.
_PARTS = (
    (0.02, 0.0, 1.62, 0.095, 0.080, 0.120, 0.0, "skin"),
    (0.0, 0.0, 1.22, 0.120, 0.210, 0.320, 0.0, "shirt"),
    (0.0, 0.0, 0.90, 0.130, 0.180, 0.160, 0.0, "trousers"),
    (0.0, 0.24, 1.15, 0.060, 0.055, 0.330, -0.6, "shirt"),
    (0.0, -0.24, 1.15, 0.060, 0.055, 0.330, 0.6, "shirt"),
    (0.0, 0.09, 0.66, 0.085, 0.085, 0.250, 0.5, "trousers"),
    (0.0, -0.09, 0.66, 0.085, 0.085, 0.250, -0.5, "trousers"),
    (0.0, 0.09, 0.24, 0.075, 0.060, 0.250, 1.0, "trousers"),
    (0.0, -0.09, 0.24, 0.075, 0.060, 0.250, -1.0, "trousers"),
)
_SKINS: tuple[Colour, ...] = ((0.75, 0.55, 0.43), (0.55, 0.36, 0.25), (0.85, 0.66, 0.54), (0.35, 0.22, 0.15))


@dataclass(frozen=True, slots=True)
class Walk:
    """How one person walks: round and round a closed way, or to and fro when it has two points.

    Attributes
    ----------
    points : tuple of (float, float)
        Corners of the way [m].
    speed_mps : float
        Walking speed; 0 stands still at `start_m` [m/s].
    start_m : float
        Where on the way at stamp 0 [m].
    """

    points: tuple[tuple[float, float], ...]
    speed_mps: float
    start_m: float

    def at(self, stamp_s: float) -> tuple[float, float, float, float]:
        """Return x, y [m], heading [rad] and the way walked [m]."""
        corners = np.array([*self.points, self.points[0]])
        legs = np.hypot(*np.diff(corners, axis=0).T)
        walked_m = self.start_m + self.speed_mps * stamp_s
        rest_m = walked_m % float(legs.sum())
        for leg, length_m in enumerate(legs):
            if rest_m <= length_m or leg == len(legs) - 1:
                break
            rest_m -= length_m
        dx, dy = (corners[leg + 1] - corners[leg]) / legs[leg]
        x, y = corners[leg] + rest_m * np.array([dx, dy])
        return float(x), float(y), math.atan2(dy, dx), walked_m


class Crowd:
    """All people of a world.

    Parameters
    ----------
    walks : sequence of Walk
        One for each person.
    seed : int
        Of their clothes and sizes.
    """

    def __init__(self, walks: Sequence[Walk], seed: int) -> None:
        rng = frame_rng(seed, "people")
        self._walks = tuple(walks)
        self._sizes = rng.uniform(0.92, 1.06, len(self._walks))
        self._colours = [_clothes(rng) for _ in self._walks]

    def add_to(self, builder: SceneBuilder) -> None:
        """Add all people to a scene as moving shapes."""
        cloth = add_cloth(builder)
        for walk, size, colours in zip(self._walks, self._sizes, self._colours):
            pose = walk.at(0.0)
            for part in _PARTS:
                texture = 0 if part[7] == "skin" else cloth
                builder.add_mover(_part(part, pose, float(size)), Surface(texture, (2.0, 1.0), colours[part[7]]))

    def at(self, stamp_s: float, vehicle: Pose2 | None = None) -> Moment:
        """Return the poses of all people; they keep `_KEEP_M` from the vehicle."""
        poses = [_aside(walk.at(stamp_s), vehicle) for walk in self._walks]
        shapes = [_part(part, pose, float(size)) for pose, size in zip(poses, self._sizes) for part in _PARTS]
        return Moment(
            np.array([shape.frame for shape in shapes]).reshape(-1, 3, 3),
            np.array([shape.origin for shape in shapes]).reshape(-1, 3),
            np.array([shape.centre for shape in shapes]).reshape(-1, 3),
            np.array([(x, y, 0.45, 0.55) for x, y, _, _ in poses], np.float32).reshape(-1, 4),
        )


def add_cloth(builder: SceneBuilder) -> int:
    """Add the texture of people's clothes to a scene, one for all of them, and return its number."""
    return builder.texture(clouds(frame_rng(0, "cloth"), (150, 150, 150), (255, 255, 255), 64, 0.6))


def _aside(pose: tuple[float, float, float, float], vehicle: Pose2 | None) -> tuple[float, float, float, float]:
    """Return the pose of a person who makes room for the vehicle."""
    if vehicle is None:
        return pose
    x, y, heading, walked_m = pose
    dx, dy = x - vehicle.x, y - vehicle.y
    away_m = math.hypot(dx, dy)
    if away_m >= _KEEP_M:
        return pose
    # Straight through the middle they step to their left.
    dx, dy = (dx / away_m, dy / away_m) if away_m > 1e-6 else (-math.sin(heading), math.cos(heading))
    return vehicle.x + _KEEP_M * dx, vehicle.y + _KEEP_M * dy, heading, walked_m


def _part(
    part: tuple[float, float, float, float, float, float, float, str],
    pose: tuple[float, float, float, float],
    size: float,
) -> Shape:
    x, y, heading, walked_m = pose
    cos, sin = math.cos(heading), math.sin(heading)
    swing = part[6] * _SWING_M * math.sin(2.0 * math.pi * walked_m / _STRIDE_M)
    forward, left = (part[0] + swing) * size, part[1] * size
    centre = (x + cos * forward - sin * left, y + sin * forward + cos * left, part[2] * size)
    return ellipsoid(centre, (part[3] * size, part[4] * size, part[5] * size), heading)


def _clothes(rng: np.random.Generator) -> dict[str, Colour]:
    def colour(low: float, high: float) -> Colour:
        r, g, b = rng.uniform(low, high, 3).tolist()
        return r, g, b

    skin = _SKINS[int(rng.integers(len(_SKINS)))]
    return {"skin": skin, "shirt": colour(0.05, 0.8), "trousers": colour(0.03, 0.3)}
