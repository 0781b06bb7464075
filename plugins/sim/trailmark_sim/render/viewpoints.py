"""Where a sensor looks from and where things are, at one instant or at several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import AnyArray, Float32s, Floats
from trailmark.geometry import Pose3

__all__ = ["Moment", "Viewpoints", "moments_between"]

#: A shape whose frame changes by more than this share from one known moment to the next has been put about.
_TURNED = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """Where the moving shapes of a scene are at one instant, or at G of them.

    Attributes
    ----------
    frames : (M, 3, 3) or (G, M, 3, 3) float64
    origins, centres : (M, 3) or (G, M, 3) float64
        As in `Scene`, of its moving shapes.
    shadows : (K, 4) or (G, K, 4) float32
        Soft shadows on the floor: x, y, radius [m], depth.
    """

    frames: Floats
    origins: Floats
    centres: Floats
    shadows: Float32s

    @property
    def is_empty(self) -> bool:
        """Whether nothing moves in the scene."""
        return self.frames.size == 0


@dataclass(frozen=True, slots=True, eq=False)
class Viewpoints:
    """Where a sensor looks from at G instants.

    Attributes
    ----------
    rotations : (G, 3, 3) float64
        ``direction_map = rotation @ direction_sensor``.
    eyes : (G, 3) float64
        Where it stands in the map [m].
    """

    rotations: Floats
    eyes: Floats

    @classmethod
    def of(cls, pose_map_sensor: Pose3) -> Viewpoints:
        """Return the one viewpoint of a pose."""
        eye = [pose_map_sensor.x, pose_map_sensor.y, pose_map_sensor.z]
        return cls(pose_map_sensor.rotation()[None], np.array([eye]))


def moments_between(known: Sequence[Moment], places: Floats) -> Moment:
    """Return where things are at G instants between moments at equal distances in time.

    Parameters
    ----------
    known : sequence of Moment
        At least two moments of one instant each.
    places : (G,) float64
        Instants, counted in moments: 0 is the first, 1.5 is midway between the second and the third.
    """
    before = np.clip(np.floor(places).astype(np.intp), 0, len(known) - 2)
    share = places - before

    def column(name: str) -> tuple[AnyArray, AnyArray]:
        values = np.stack([getattr(moment, name) for moment in known])
        return values[before], values[before + 1]

    def between(name: str, shares: Floats = share) -> AnyArray:
        first, second = column(name)
        weights = shares.reshape(shares.shape + (1,) * (first.ndim - shares.ndim))
        return np.asarray(first + weights * (second - first), first.dtype)

    first, second = column("frames")
    turned = np.abs(second - first).max(axis=(2, 3), initial=0.0) > _TURNED * np.abs(first).max(
        axis=(2, 3), initial=0.0
    )
    # Whoever turns about does so at once: a frame halfway between both would be no frame.
    frames = between("frames", np.where(turned, np.round(share)[:, None], share[:, None]))
    return Moment(frames, between("origins"), between("centres"), between("shadows"))
