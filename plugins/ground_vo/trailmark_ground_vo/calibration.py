"""Scale, heading and lever arm of a downward camera, from the motions it saw on a drive of known length.

A drive is cut where the camera stands still (`calibration_moves`). A straight move of known length says how large a
pixel is, and, since a robot drives along its own x axis, how the camera is turned. A turn in place says where base is:
the camera moves on a circle around it.

All motions are those of the camera in its own axes, in the scale that was assumed; a factor of that scale is what
comes out. Everything here is plain numpy on one drive: nothing has to be fast.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import DataError
from trailmark_ground_vo.calibration_moves import Move, Steps, end_of, list_moves, moves_of, sorted_moves

__all__ = ["Assumed", "Calibrated", "Known", "Move", "Steps", "calibrate", "moves_of"]


#: A turn is fitted in pieces of this, a straight way in so many pieces.
_PIECE_RAD, _N_PIECES = math.radians(15.0), 8
#: A place in the picture is known to this, at best [px].
_SIGMA_PX = 0.05
#: Two directions are independent when the matrix of their squares is at least this far from singular.
_INDEPENDENT = 0.1
#: Lengths that are given in another order than they were driven miss by more than this, and by so many sigmas.
_WRONG_LENGTH, _WRONG_SIGMAS = 0.05, 5.0
#: Such lengths change the shape of a pixel by more than this.
_WRONG_SHAPE = 0.2
#: A move in another direction is off by more than this; without a turn in place, a bend looks like some of it [rad].
_WRONG_WAY_RAD = math.radians(30.0)
_IN_ORDER = (
    "give --distance for each move along the robot, all forward or, with --backward, all backward, in the order of"
    " driving, and --sideways for those that came after them, or measure the lengths again"
)


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
        If the drive does not suffice, or the lengths cannot be those of its moves: it says what is missing, or wrong.
    """
    pixel_m = assumed.metres_per_pixel[0]
    moves = moves_of(steps, pixel_m)
    legs, turns = sorted_moves(steps, moves, pixel_m)
    n_needed = len(known.forward_m) + len(known.sideways_m)
    if len(legs) != n_needed:
        raise DataError(
            f"{n_needed} straight {'move was' if n_needed == 1 else 'moves were'} announced, but the drive has"
            f" {list_moves(steps, moves, pixel_m)}; stand still for half a second before and after each move"
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
            moved.append(end_of(steps, piece))
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
        ends.append(end_of(steps, leg) + lever - _rotation(turn_rad) @ lever)  # of base, not of the camera
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
            raise DataError(f"the lengths of the straight moves contradict each other; {_IN_ORDER}")
        factors = np.sqrt(squares)
        shape = float(factors[1] / factors[0])
        if abs(math.log(shape)) > _WRONG_SHAPE:
            raise DataError(
                f"by these lengths the ratio of height to width of a pixel is {shape:.2f} times what was assumed;"
                f" {_IN_ORDER}; if the picture is squeezed, say by how much with"
                " calibration: {metres_per_pixel: [u, v]}"
            )
        _refuse_other_lengths(np.sqrt(A @ squares), lengths_m, weights)
        covariance = 4.0 * np.linalg.inv(H)  # relative lengths count twice in squares
        sigmas = np.sqrt(np.diag(covariance)) / (2.0 * factors)
        return (float(factors[0]), float(factors[1])), (float(sigmas[0]), float(sigmas[1])), True
    each = 1.0 / np.hypot(*relative.T)
    mean = float(np.average(each, weights=weights))
    _refuse_other_lengths(mean / each, lengths_m, weights)
    scatter = float(np.average((each - mean) ** 2, weights=weights)) / max(1, len(each) - 1)
    sigma = mean * math.sqrt(max(1.0 / float(weights.sum()), scatter / mean**2))
    return (mean, mean), (sigma, sigma), False


def _refuse_other_lengths(seen: Floats, lengths_m: Floats, weights: Floats) -> None:
    """Raise where a move was not as long as it is said to be, by what all of them say of the scale.

    Parameters
    ----------
    seen : (M,) float64
        How long each move was, in units of the length that is given for it.
    lengths_m, weights : (M,) float64
        Those lengths [m], and the inverse variances of the relative lengths.
    """
    off = np.abs(seen - 1.0)
    wrong = np.flatnonzero((off > _WRONG_LENGTH) & (off * np.sqrt(weights) > _WRONG_SIGMAS))
    if len(wrong):
        one = int(wrong[np.argmax(off[wrong])])
        raise DataError(
            f"the lengths of the straight moves contradict each other: by all of them, that of {lengths_m[one]:g} m was"
            f" {seen[one] * lengths_m[one]:.3g} m long; {_IN_ORDER}"
        )


def _yaw(
    steps: Steps, legs: Sequence[Move], factors: tuple[float, float], lever: Floats, is_backward: bool
) -> tuple[float, float]:
    """Return the yaw of the mounting, and its sigma from the scatter of pieces: base moves along its x axis.

    Each step is taken in the axes of its own picture, so that a drift of heading does not enter.
    """
    way = np.hypot(steps.x, steps.y)
    _refuse_other_ways(np.array([_base_way(steps, leg, factors, lever) for leg in legs]))
    pieces = [piece for leg in legs for piece in _pieces(steps, leg, way, _N_PIECES)]
    forward = np.array([_base_way(steps, piece, factors, lever) for piece in pieces])
    unit = np.exp(1j * np.arctan2(forward[:, 1], forward[:, 0]))
    mean = unit.mean()
    off = np.angle(unit / mean)
    variance = float(np.sum(off**2)) / max(1, len(off) - 1) / len(off)
    yaw_rad = -float(np.angle(mean)) + (math.pi if is_backward else 0.0)
    return math.remainder(yaw_rad, 2.0 * math.pi), math.sqrt(variance)


def _refuse_other_ways(forward: Floats) -> None:
    """Raise where moves that were all announced as along the robot, (L, 2), have different directions in the camera."""
    angles = np.arctan2(forward[:, 1], forward[:, 0])
    off = np.array([abs(math.remainder(angle - angles[0], 2.0 * math.pi)) for angle in angles.tolist()])
    one = int(np.argmax(off))
    if off[one] > _WRONG_WAY_RAD:
        raise DataError(
            f"straight moves 1 and {one + 1} are {math.degrees(off[one]):.0f} deg apart as the camera sees them, and"
            f" both were announced as along the robot; {_IN_ORDER}"
        )


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
