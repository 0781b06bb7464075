"""A calibration drive cut into its moves: straight ones, and turns in place, between the times of standing still.

All motions are those of the camera in its own axes, in the scale that was assumed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from trailmark.arrays import Bools, Floats, Int64s
from trailmark.errors import DataError

__all__ = ["Move", "Steps", "end_of", "list_moves", "moves_of", "sorted_moves"]

#: A point so far from the middle of the picture stands for what a turn moves [px].
_LEVER_PX = 150.0
#: Less than this share of the usual motion per picture is standing still; never less than the noise [px].
_REST_SHARE, _REST_PX = 0.05, 0.1
_REST_S = 0.3
_SMOOTHED = 5
#: A move bends by less than this, or turns about a point that is nearer than this.
_STRAIGHT_RAD, _TURN_RAD = math.radians(8.0), math.radians(60.0)
_FARTHEST_PX = 4000.0
#: A shorter way or a longer gap says nothing.
_SHORTEST_PX, _LONGEST_GAP_S = 150.0, 0.5


@dataclass(frozen=True, eq=False)
class Steps:
    """Motions of the camera from picture to picture.

    Attributes
    ----------
    since_s, stamp_s : (N,) float64
        From and to [s].
    x, y, theta : (N,) float64
        In the camera's axes, in the assumed scale [m, m, rad].
    variance : (N,) float64
        Of the shift, per axis [m^2].
    """

    since_s: Floats
    stamp_s: Floats
    x: Floats
    y: Floats
    theta: Floats
    variance: Floats

    def __len__(self) -> int:
        return len(self.stamp_s)


@dataclass(frozen=True, slots=True)
class Move:
    """A drive from one standstill to the next.

    Attributes
    ----------
    first, last : int
        Its steps are `first` to `last`, the latter not included.
    """

    first: int
    last: int


def moves_of(steps: Steps, pixel_m: float) -> list[Move]:
    """Return the moves between the times in which the camera stood still; each reaches to the middle of those.

    Raises
    ------
    DataError
        If the camera saw nothing move, or the first or the last move is cut off.
    """
    if len(steps) == 0:
        raise DataError("no motion was seen: fewer than two pictures, or none that fit together")
    pictures, step_of = _split_by_picture(steps)
    x, y, theta = (_running_means(part) for part in (pictures.x, pictures.y, pictures.theta))
    sizes_px = np.hypot(x, y) / pixel_m + _LEVER_PX * np.abs(theta)
    moves_px = max(_REST_PX, _REST_SHARE * float(np.quantile(sizes_px, 0.95)))
    is_moving = sizes_px > moves_px
    if not is_moving.any():
        raise DataError("the camera stood still all the time")
    for end, verb in ((0, "begins"), (-1, "ends")):
        if is_moving[end]:  # a move that is cut off would be taken for a whole one
            raise DataError(f"the recording {verb} while the camera moves: it must stand still for a second there")
    edges = [0]
    for first, last in _runs(~is_moving):
        is_at_end = first == 0 or last == len(pictures)
        if is_at_end or pictures.stamp_s[last - 1] - pictures.since_s[first] >= _REST_S:
            edges.append((first + last) // 2)
    edges.append(len(pictures))
    step_of = np.append(step_of, len(steps))
    moves = [
        Move(int(step_of[first]), int(step_of[last])) for first, last in pairwise(edges) if is_moving[first:last].any()
    ]
    return [move for move in moves if move.last > move.first]


def _split_by_picture(steps: Steps) -> tuple[Steps, Int64s]:
    """Return steps of one picture each, and of which step each is a part.

    A step over pictures that were passed over, as a sudden stop is taken for repeats, is split evenly. Otherwise
    running means would take several pictures of rest for one, and the rest for too short.
    """
    lengths_s = steps.stamp_s - steps.since_s
    # a longer gap is refused later: no need to fill it
    n_pictures = np.rint(np.minimum(lengths_s, _LONGEST_GAP_S) / np.median(lengths_s)).astype(np.int64)
    n_pictures = np.maximum(n_pictures, 1)
    step_of = np.repeat(np.arange(len(steps)), n_pictures)
    n = n_pictures[step_of]
    part = np.arange(len(step_of)) - (np.cumsum(n_pictures) - n_pictures)[step_of]
    since_s, length_s = steps.since_s[step_of], lengths_s[step_of]
    x, y, theta, variance = (values[step_of] / n for values in (steps.x, steps.y, steps.theta, steps.variance))
    return Steps(since_s + length_s * part / n, since_s + length_s * (part + 1) / n, x, y, theta, variance), step_of


def _running_means(values: Floats) -> Floats:
    """Return running means: noise is no motion."""
    return np.convolve(values, np.full(_SMOOTHED, 1.0 / _SMOOTHED), mode="same") if len(values) > _SMOOTHED else values


def _runs(flags: Bools) -> list[tuple[int, int]]:
    """Return first and past-the-last index of every run of True."""
    padded = np.concatenate([[False], flags, [False]]).astype(np.int8)
    changes = np.diff(padded)
    return list(zip(np.flatnonzero(changes == 1).tolist(), np.flatnonzero(changes == -1).tolist()))


def sorted_moves(steps: Steps, moves: Sequence[Move], pixel_m: float) -> tuple[list[Move], list[Move]]:
    """Return straight moves and turns in place; jolts are left out, anything else is refused.

    Raises
    ------
    DataError
        If a move is neither, or the camera lost track in it.
    """
    legs, turns = [], []
    for move in moves:
        _refuse_gaps(steps, move)
        way_px, turn_rad = _way_and_turn(steps, move, pixel_m)
        if way_px + _LEVER_PX * abs(turn_rad) < _SHORTEST_PX / 3:
            continue  # a jolt
        if abs(turn_rad) <= _STRAIGHT_RAD and way_px >= _SHORTEST_PX:
            legs.append(move)
        elif abs(turn_rad) >= _TURN_RAD and _is_in_place(steps, move, pixel_m):
            turns.append(move)
        else:
            raise DataError(
                f"the move {_when(steps, move)} is neither straight nor a turn in place: {way_px:.0f} px long, turned"
                f" by {math.degrees(turn_rad):.0f} deg. Straight is less than {math.degrees(_STRAIGHT_RAD):.0f} deg and"
                f" more than {_SHORTEST_PX:.0f} px, a turn in place more than {math.degrees(_TURN_RAD):.0f} deg"
            )
    return legs, turns


def _is_in_place(steps: Steps, move: Move, pixel_m: float) -> bool:
    """Return whether the camera turns as it moves, all the way: about a point that is not far off."""
    part = slice(move.first, move.last)
    ways_px = np.hypot(_running_means(steps.x[part]), _running_means(steps.y[part])) / pixel_m
    is_straight = ways_px > _FARTHEST_PX * np.abs(_running_means(steps.theta[part])) + 0.5
    return float(ways_px[is_straight].sum()) < 0.1 * float(ways_px.sum()) + _SHORTEST_PX / 10.0


def _way_and_turn(steps: Steps, move: Move, pixel_m: float) -> tuple[float, float]:
    part = slice(move.first, move.last)
    return float(np.hypot(*end_of(steps, move)) / pixel_m), float(steps.theta[part].sum())


def _refuse_gaps(steps: Steps, move: Move) -> None:
    gaps_s = steps.since_s[move.first + 1 : move.last] - steps.stamp_s[move.first : move.last - 1]
    lengths_s = steps.stamp_s[move.first : move.last] - steps.since_s[move.first : move.last]
    if np.any(np.abs(gaps_s) > 1e-6) or np.any(lengths_s > _LONGEST_GAP_S):
        raise DataError(
            f"the camera lost track in the move {_when(steps, move)}: drive slower, and mind that the ground is lit and"
            " in focus"
        )


def _when(steps: Steps, move: Move) -> str:
    return f"from {steps.since_s[move.first]:.2f} s to {steps.stamp_s[move.last - 1]:.2f} s"


def list_moves(steps: Steps, moves: Sequence[Move], pixel_m: float) -> str:
    """Return in words when each move was, how long it is and how far it turns."""
    if not moves:
        return "none"
    parts = [(_when(steps, move), *_way_and_turn(steps, move, pixel_m)) for move in moves]
    return "; ".join(f"{when}: {way_px:.0f} px, {math.degrees(turn_rad):.0f} deg" for when, way_px, turn_rad in parts)


def end_of(steps: Steps, move: Move, factors: tuple[float, float] = (1.0, 1.0)) -> Floats:
    """Return the end of a move as seen from its beginning (x, y), in the camera's axes [m]."""
    part = slice(move.first, move.last)
    x, y, theta = factors[0] * steps.x[part], factors[1] * steps.y[part], steps.theta[part]
    before = np.cumsum(theta) - theta
    cos, sin = np.cos(before), np.sin(before)
    return np.array([np.sum(cos * x - sin * y), np.sum(sin * x + cos * y)])
