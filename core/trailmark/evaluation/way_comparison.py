"""Whether two trajectories of one robot tell the same way: by its length, and by where forward is.

A scale that is wrong by 5 or by 1000, and a sensor that is mounted the other way round, leave every residual of the
localizer as small as before. Only what another one says of the same stretch shows them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Trajectory

__all__ = ["WayComparison", "compare_ways"]

#: A stretch ends where both have come so far from its start [m].
_STRETCH_M = 0.1
#: Stretches that a comparison needs.
_LEAST_STRETCHES = 3
#: Instants that are looked at, at most.
_MOST_INSTANTS = 2000


@dataclass(frozen=True, slots=True)
class WayComparison:
    """What one trajectory tells of the stretches that another one tells, medians over the stretches.

    Attributes
    ----------
    ratio : float
        Length, over that of the other.
    turned_rad : float
        Direction in base, counter-clockwise from that of the other, -pi to pi [rad].
    n_stretches : int
        Stretches compared.
    """

    ratio: float
    turned_rad: float
    n_stretches: int


def compare_ways(one: Trajectory, other: Trajectory) -> WayComparison | None:
    """Compare two trajectories stretch by stretch; None where they share too little way.

    A trajectory that stands still, or has hardly moved, has no stretches: it may be right, or fail otherwise.

    Parameters
    ----------
    one, other : Trajectory
        Of the same base, each in a frame of its own.
    """
    stamps = _common_stamps(one, other)
    if len(stamps) < 2:
        return None
    poses, other_poses = one.at(stamps).poses, other.at(stamps).poses
    ends = _stretch_ends(poses, other_poses)
    if len(ends) <= _LEAST_STRETCHES:
        return None
    steps, other_steps = _steps_in_base(poses[ends]), _steps_in_base(other_poses[ends])
    turned = np.angle(steps * other_steps.conj())
    middle = np.median(np.exp(1j * turned).real) + 1j * np.median(np.exp(1j * turned).imag)
    ratio = float(np.median(np.abs(steps) / np.abs(other_steps)))
    return WayComparison(ratio, math.atan2(middle.imag, middle.real), len(steps))


def _common_stamps(one: Trajectory, other: Trajectory) -> Floats:
    """Return the stamps of the one that has fewer, within both."""
    if not len(one) or not len(other):
        return np.empty(0)
    stamps = min((one, other), key=len).stamps_s
    first, last = max(one.stamps_s[0], other.stamps_s[0]), min(one.stamps_s[-1], other.stamps_s[-1])
    inside = stamps[(stamps >= first) & (stamps <= last)]
    return np.asarray(inside[:: 1 + len(inside) // _MOST_INSTANTS], np.float64)


def _stretch_ends(poses: Floats, other_poses: Floats) -> list[int]:
    ends = [0]
    for n in range(1, len(poses)):
        apart = (math.dist(way[n, :2], way[ends[-1], :2]) for way in (poses, other_poses))
        if min(apart) >= _STRETCH_M:
            ends.append(n)
    return ends


def _steps_in_base(poses: Floats) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
    """Return each step in the frame of base where it begins, forward + 1j left [m]."""
    steps = np.diff(poses[:, 0] + 1j * poses[:, 1])
    return np.asarray(steps * np.exp(-1j * poses[:-1, 2]), np.complex128)
