"""Scale, heading and lever arm of a downward camera, from the motions it saw on a drive of known length.

A drive is cut where the camera stands still. A straight move of known length says how large a pixel is, and, since a
robot drives along its own x axis, how the camera is turned. A turn in place says where base is: the camera moves on a
circle around it.

All motions are those of the camera in its own axes, in the scale that was assumed; a factor of that scale is what
comes out. Everything here is plain numpy on one drive: nothing has to be fast.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from trailmark.arrays import Bools, Floats, Int64s
from trailmark.errors import DataError

__all__ = ["Assumed", "Calibrated", "Known", "Move", "Steps", "calibrate", "moves_of"]


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
#: A turn is fitted in pieces of this, a straight way in so many pieces.
_PIECE_RAD, _N_PIECES = math.radians(15.0), 8
#: A place in the picture is known to this, at best [px].
_SIGMA_PX = 0.05
#: Two directions are independent when the matrix of their squares is at least this far from singular.
_INDEPENDENT = 0.1


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


@dataclass(frozen=True, slots=True)
class Assumed:
    """What the motions were computed with.

    Attributes
    ----------
    metres_per_pixel : (float, float)
        Along u and v [m].
    """

    metres_per_pixel: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Known:
    """What was measured on the ground.

    Attributes
    ----------
    forward_m : sequence of float
        Lengths of the straight moves along the robot's x axis, in the order in which they were driven [m].
    sideways_m : sequence of float
        Lengths of straight moves in any other direction, for the scale alone, after those [m].
    sigma_m : float
        How well a length is known, one standard deviation [m].
    is_backward : bool
        Whether the robot drove backwards.
    """

    forward_m: Sequence[float]
    sideways_m: Sequence[float] = ()
    sigma_m: float = 1e-3
    is_backward: bool = False


@dataclass(frozen=True, slots=True)
class Calibrated:
    """What a drive says of the camera; sigmas are one standard deviation.

    Attributes
    ----------
    metres_per_pixel, metres_per_pixel_sigma : (float, float)
        Along u and v [m].
    has_both_scales : bool
        False when only one was observable: the other one keeps the assumed ratio to it.
    yaw_rad, yaw_sigma_rad : float
        Of the mounting.
    lever_m, lever_sigma_m : (float, float) or None
        The camera as seen from base, forward and left [m]; None without a turn in place.
    turned_rad : float
        Sum of the turns in place [rad].
    """

    metres_per_pixel: tuple[float, float]
    metres_per_pixel_sigma: tuple[float, float]
    has_both_scales: bool
    yaw_rad: float
    yaw_sigma_rad: float
    lever_m: tuple[float, float] | None
    lever_sigma_m: tuple[float, float] | None
    turned_rad: float


def calibrate(steps: Steps, known: Known, assumed: Assumed) -> Calibrated:
    """Return what a drive says of the camera.

    Raises
    ------
    DataError
        If the drive does not suffice: it says what is missing.
    """
    pixel_m = assumed.metres_per_pixel[0]
    moves = moves_of(steps, pixel_m)
    legs, turns = _sorted_moves(steps, moves, pixel_m)
    n_needed = len(known.forward_m) + len(known.sideways_m)
    if len(legs) != n_needed:
        raise DataError(
            f"{n_needed} straight {'move was' if n_needed == 1 else 'moves were'} announced, but the drive has"
            f" {_list_moves(steps, moves, pixel_m)}; stand still for half a second before and after each move"
        )
    lever, lever_covariance = _lever(steps, turns, pixel_m) if turns else (np.zeros(2), np.zeros((2, 2)))
    factors, spread, has_both = _scales(steps, legs, known, lever)
    yaw_rad, yaw_sigma_rad = _yaw(steps, legs[: len(known.forward_m)], factors, lever, known.is_backward)
    scaled = (assumed.metres_per_pixel[0] * factors[0], assumed.metres_per_pixel[1] * factors[1])
    sigmas = (assumed.metres_per_pixel[0] * spread[0], assumed.metres_per_pixel[1] * spread[1])
    turned_rad = float(sum(abs(steps.theta[turn.first : turn.last].sum()) for turn in turns))
    lever_m = lever_sigma_m = None
    if turns:
        lever_m, lever_sigma_m = _in_base(lever, lever_covariance, factors, spread, (yaw_rad, yaw_sigma_rad))
    return Calibrated(scaled, sigmas, has_both, yaw_rad, yaw_sigma_rad, lever_m, lever_sigma_m, turned_rad)


# --- cutting the drive -------------------------------------------------------------------------------------------


def moves_of(steps: Steps, pixel_m: float) -> list[Move]:
    """Return the moves between the times in which the camera stood still; each reaches to the middle of those.

    Raises
    ------
    DataError
        If the camera saw nothing move.
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


def _sorted_moves(steps: Steps, moves: Sequence[Move], pixel_m: float) -> tuple[list[Move], list[Move]]:
    """Return straight moves and turns in place; jolts are left out, anything else is refused."""
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
    return float(np.hypot(*_end(steps, move)) / pixel_m), float(steps.theta[part].sum())


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


def _list_moves(steps: Steps, moves: Sequence[Move], pixel_m: float) -> str:
    if not moves:
        return "none"
    parts = [(_when(steps, move), *_way_and_turn(steps, move, pixel_m)) for move in moves]
    return "; ".join(f"{when}: {way_px:.0f} px, {math.degrees(turn_rad):.0f} deg" for when, way_px, turn_rad in parts)


# --- what follows from it ----------------------------------------------------------------------------------------


def _end(steps: Steps, move: Move, factors: tuple[float, float] = (1.0, 1.0)) -> Floats:
    """Return the end of a move as seen from its beginning (x, y), in the camera's axes [m]."""
    part = slice(move.first, move.last)
    x, y, theta = factors[0] * steps.x[part], factors[1] * steps.y[part], steps.theta[part]
    before = np.cumsum(theta) - theta
    cos, sin = np.cos(before), np.sin(before)
    return np.array([np.sum(cos * x - sin * y), np.sum(sin * x + cos * y)])


def _rotation(angle_rad: float) -> Floats:
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])


def _pieces(steps: Steps, move: Move, weights: Floats, n: int) -> list[Move]:
    """Cut a move into `n` pieces of equal weight."""
    share = np.cumsum(weights[move.first : move.last])
    cuts = move.first + np.searchsorted(share, np.linspace(0.0, share[-1], n + 1)[1:-1])
    edges = [move.first, *cuts.tolist(), move.last]
    return [Move(int(first), int(last)) for first, last in pairwise(edges) if last > first]


def _lever(steps: Steps, turns: Sequence[Move], pixel_m: float) -> tuple[Floats, Floats]:
    """Return the camera as seen from base, in the camera's axes and the assumed scale, and its covariance.

    When base turns by theta in place, a camera at l moves by (R(theta) - I) l.
    """
    rows, moved = [], []
    for turn in turns:
        weights = np.abs(steps.theta)
        n = max(2, round(float(weights[turn.first : turn.last].sum()) / _PIECE_RAD))
        for piece in _pieces(steps, turn, weights, n):
            angle_rad = float(steps.theta[piece.first : piece.last].sum())
            rows.append(_rotation(angle_rad) - np.eye(2))
            moved.append(_end(steps, piece))
    A, t = np.concatenate(rows), np.concatenate(moved)
    lever, *_ = np.linalg.lstsq(A, t, rcond=None)
    variance = max(float(np.sum((t - A @ lever) ** 2)) / max(1, len(t) - 2), (_SIGMA_PX * pixel_m) ** 2)
    return np.asarray(lever), np.asarray(variance * np.linalg.inv(A.T @ A))


def _scales(
    steps: Steps, legs: Sequence[Move], known: Known, lever: Floats
) -> tuple[tuple[float, float], tuple[float, float], bool]:
    """Return the factors of the assumed scales along u and v, their sigmas, and whether both were measured."""
    lengths_m = np.array([*known.forward_m, *known.sideways_m])
    ends, variances = [], []
    for leg in legs:
        turn_rad = float(steps.theta[leg.first : leg.last].sum())
        ends.append(_end(steps, leg) + lever - _rotation(turn_rad) @ lever)  # of base, not of the camera
        variances.append(known.sigma_m**2 + float(steps.variance[leg.first : leg.last].sum()))
    seen = np.array(ends)
    weights = lengths_m**2 / np.array(variances)  # of the relative length
    relative = seen / lengths_m[:, None]
    A = relative**2  # a^2 f_u^2 + b^2 f_v^2 = 1
    normalised = A / A.sum(axis=1, keepdims=True)
    if len(legs) > 1 and np.linalg.svd(normalised, compute_uv=False)[-1] > _INDEPENDENT:
        W = np.diag(weights)
        H = A.T @ W @ A
        squares = np.linalg.solve(H, A.T @ W @ np.ones(len(A)))
        if np.any(squares <= 0.0):
            raise DataError("the lengths of the straight moves contradict each other: were they given in order?")
        factors = np.sqrt(squares)
        covariance = 4.0 * np.linalg.inv(H)  # relative lengths count twice in squares
        sigmas = np.sqrt(np.diag(covariance)) / (2.0 * factors)
        return (float(factors[0]), float(factors[1])), (float(sigmas[0]), float(sigmas[1])), True
    each = 1.0 / np.hypot(*relative.T)
    mean = float(np.average(each, weights=weights))
    scatter = float(np.average((each - mean) ** 2, weights=weights)) / max(1, len(each) - 1)
    sigma = mean * math.sqrt(max(1.0 / float(weights.sum()), scatter / mean**2))
    return (mean, mean), (sigma, sigma), False


def _yaw(
    steps: Steps, legs: Sequence[Move], factors: tuple[float, float], lever: Floats, is_backward: bool
) -> tuple[float, float]:
    """Return the yaw of the mounting, and its sigma from the scatter of pieces: base moves along its x axis.

    Each step is taken in the axes of its own picture, so that a drift of heading does not enter.
    """
    way = np.hypot(steps.x, steps.y)
    pieces = [piece for leg in legs for piece in _pieces(steps, leg, way, _N_PIECES)]
    forward = np.array([_base_way(steps, piece, factors, lever) for piece in pieces])
    unit = np.exp(1j * np.arctan2(forward[:, 1], forward[:, 0]))
    mean = unit.mean()
    off = np.angle(unit / mean)
    variance = float(np.sum(off**2)) / max(1, len(off) - 1) / len(off)
    yaw_rad = -float(np.angle(mean)) + (math.pi if is_backward else 0.0)
    return math.remainder(yaw_rad, 2.0 * math.pi), math.sqrt(variance)


def _base_way(steps: Steps, move: Move, factors: tuple[float, float], lever: Floats) -> Floats:
    """Return the sum of base's own steps, each seen in the camera's axes: forward is the same in all of them."""
    part = slice(move.first, move.last)
    turn = steps.theta[part]
    level = lever * np.array(factors)
    x = factors[0] * steps.x[part] + (1.0 - np.cos(turn)) * level[0] + np.sin(turn) * level[1]
    y = factors[1] * steps.y[part] + (1.0 - np.cos(turn)) * level[1] - np.sin(turn) * level[0]
    return np.array([x.sum(), y.sum()])


def _in_base(
    lever: Floats,
    covariance: Floats,
    factors: tuple[float, float],
    sigmas: tuple[float, float],
    yaw: tuple[float, float],
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the lever arm in base's axes, and its sigmas: of the turn, of the scales and of the yaw."""
    scale, R = np.diag(factors), _rotation(yaw[0])
    level = scale @ lever
    in_base = R @ level
    across = np.array([-in_base[1], in_base[0]])
    spread = scale @ covariance @ scale + np.diag((lever * np.array(sigmas)) ** 2)
    total = R @ spread @ R.T + yaw[1] ** 2 * np.outer(across, across)
    return (float(in_base[0]), float(in_base[1])), (math.sqrt(total[0, 0]), math.sqrt(total[1, 1]))
