"""Boxes that people carry: their poses depend on the clock alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from trailmark.geometry import Pose2, Pose3
from trailmark_sim.render.scene import SceneBuilder, Surface
from trailmark_sim.render.shapes import Shape, rectangle
from trailmark_sim.render.viewpoints import Moment

__all__ = ["Movers", "Prop", "Props", "rises", "walks_off"]

_NOBODY = Moment(np.empty((0, 3, 3)), np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 4), np.float32))


class Movers(Protocol):
    """Whatever moves in a world."""

    def add_to(self, builder: SceneBuilder) -> None:
        """Add all of it to a scene as moving shapes."""

    def at(self, stamp_s: float, vehicle: Pose2 | None = None) -> Moment:
        """Return where it is."""


@dataclass(frozen=True, slots=True, eq=False)
class Prop:
    """A box that moves.

    Attributes
    ----------
    size_m : (float, float, float)
        Length, width and height along its own x, y and z [m].
    pose_at : callable
        Takes a stamp [s] and returns ``pose_map_prop`` of its middle.
    look : callable
        Takes the builder and returns the surfaces of its front (towards +x) and of its other sides.
    """

    size_m: tuple[float, float, float]
    pose_at: Callable[[float], Pose3]
    look: Callable[[SceneBuilder], tuple[Surface, Surface]]

    def faces(self, stamp_s: float) -> list[Shape]:
        """Return its six sides, the front first."""
        pose = self.pose_at(stamp_s)
        R, middle = pose.rotation(), np.array([pose.x, pose.y, pose.z])
        half = np.asarray(self.size_m) / 2.0
        shapes = []
        for out, along, up in _SIDES:
            normal, a, b = (np.asarray(side, float) * half for side in (out, along, up))
            shapes.append(rectangle(middle + R @ (normal - a - b), R @ (2.0 * a), R @ (2.0 * b)))
        return shapes


#: Of a box: outwards, along and up as seen from outside; ``along x up`` faces the viewer.
_SIDES = (
    ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ((-1, 0, 0), (0, -1, 0), (0, 0, 1)),
    ((0, 1, 0), (-1, 0, 0), (0, 0, 1)),
    ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
    ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
)


@dataclass(frozen=True, slots=True, eq=False)
class Props:
    """Boxes that move, and the people beside them.

    Attributes
    ----------
    props : sequence of Prop
        The boxes.
    people : Movers or None
        Everybody else; their shapes come first.
    """

    props: Sequence[Prop]
    people: Movers | None = None
    _nobody: Moment = field(default=_NOBODY, init=False, repr=False)

    def add_to(self, builder: SceneBuilder) -> None:
        """Add all as moving shapes, where they stand at stamp 0."""
        if self.people is not None:
            self.people.add_to(builder)
        for prop in self.props:
            front, others = prop.look(builder)
            for side, shape in enumerate(prop.faces(0.0)):
                builder.add_mover(shape, front if side == 0 else others)

    def at(self, stamp_s: float, vehicle: Pose2 | None = None) -> Moment:
        """Return where all of it is."""
        people = self._nobody if self.people is None else self.people.at(stamp_s, vehicle)
        shapes = [shape for prop in self.props for shape in prop.faces(stamp_s)]
        if not shapes:
            return people
        return Moment(
            np.concatenate([people.frames, [shape.frame for shape in shapes]]),
            np.concatenate([people.origins, [shape.origin for shape in shapes]]),
            np.concatenate([people.centres, [shape.centre for shape in shapes]]),
            people.shadows,
        )


def walks_off(
    pose: Pose3, from_s: float, direction_rad: float, speed_mps: float, way_m: float
) -> Callable[[float], Pose3]:
    """Return the poses of something that stands until a stamp and is then carried away, so far and no farther."""

    def at(stamp_s: float) -> Pose3:
        gone_m = min(max(0.0, stamp_s - from_s) * speed_mps, way_m)
        along = math.cos(direction_rad) * gone_m, math.sin(direction_rad) * gone_m
        return Pose3(pose.x + along[0], pose.y + along[1], pose.z, pose.roll, pose.pitch, pose.yaw)

    return at


def rises(pose: Pose3, from_s: float, way_m: float, speed_mps: float = 1.0) -> Callable[[float], Pose3]:
    """Return the poses of something that waits so far below and is lifted to a pose from a stamp on."""

    def at(stamp_s: float) -> Pose3:
        below_m = way_m - min(max(0.0, stamp_s - from_s) * speed_mps, way_m)
        return Pose3(pose.x, pose.y, pose.z - below_m, pose.roll, pose.pitch, pose.yaw)

    return at
