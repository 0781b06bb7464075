"""Both lenses and the pose between them, from views of a rectangle of known size: the better way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy.optimize import least_squares

from trailmark.arrays import Floats
from trailmark.errors import ConfigError
from trailmark.frames import DepthCamera, Pinhole
from trailmark_kinect_landmarks.calibrating.board import BoardView
from trailmark_kinect_landmarks.calibrating.crop_ratios import lens_of_angle
from trailmark_kinect_landmarks.calibration import sensor_transform

__all__ = ["LensFit", "fit_lenses"]

Size = tuple[int, int]

_MIN_VIEWS = 8
_MIN_DISTANCE_RATIO = 1.2  # of the farthest view to the nearest: one distance cannot tell parallax from the lens
_MAX_FOCAL_SIGMA = 0.03
_SIGMA_PX, _SIGMA_SIDE_M = 0.7, 0.005
_GOOD_PX = 2.0  # a view with no corner farther off than this is kept
#: How sure it is before anything is seen: centres of lenses [px], their pixels' squareness, turn [rad], shift [m].
_CENTRE_PX, _SQUARE, _TURN_RAD, _SHIFT_M = 15.0, 0.01, math.radians(5.0), 0.15
_SIDES = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (1, 3)])


@dataclass(frozen=True, slots=True)
class LensFit:
    """A calibration, and how sure it is.

    Attributes
    ----------
    camera : DepthCamera
        Both lenses and the pose between them.
    sigma_focal_px : (float, float)
        Of the colour and the depth lens [px].
    sigma_shift_m, sigma_turn_rad : float
        Largest standard deviations of the pose between them [m, rad].
    rms_px : float
        Distance of the corners in colour from where depth says that they are [px].
    """

    camera: DepthCamera
    sigma_focal_px: tuple[float, float]
    sigma_shift_m: float
    sigma_turn_rad: float
    rms_px: float


def fit_lenses(
    views: Sequence[BoardView],
    board_m: tuple[float, float],
    colour_size: Size,
    depth_size: Size,
    colour: Pinhole | None = None,
) -> LensFit:
    """Return both lenses and the pose between them.

    Parameters
    ----------
    views : sequence of BoardView
        Of the rectangle.
    board_m : (float, float)
        Its two sides [m].
    colour : Pinhole, optional
        The colour lens where it is known; it is then left as it is, distortion included.

    Raises
    ------
    ConfigError
        If the views do not tell enough.
    """
    _check(views)
    problem = _Problem(views, board_m, colour_size, depth_size, colour)
    found = _solve(problem)
    worst_px = np.linalg.norm(problem.colour_misses(found.x), axis=-1).max(axis=1)
    good = worst_px <= max(_GOOD_PX, 3.0 * float(np.median(worst_px)))  # a hand, or the floor, at one edge
    if not good.all():
        views = [view for view, is_good in zip(views, good, strict=True) if is_good]
        _check(views)
        problem = _Problem(views, board_m, colour_size, depth_size, colour)
        found = _solve(problem)
    n_free = problem.n_measured - len(found.x)
    cov = np.linalg.pinv(found.jac.T @ found.jac) * max(1.0, 2.0 * found.cost / max(n_free, 1))
    sigma = np.sqrt(np.maximum(np.diag(cov), 0.0))
    lens, depth, turn, shift = problem.parts(found.x)
    sigma_colour = 0.0 if colour is not None else float(sigma[10:12].max()) * lens.fx
    fit = LensFit(
        DepthCamera(lens, depth, sensor_transform(_matrix(turn, shift))),
        (sigma_colour, float(sigma[:2].max()) * depth.fx),
        float(sigma[7:10].max()),
        float(sigma[4:7].max()),
        float(np.sqrt((problem.colour_misses(found.x) ** 2).sum(axis=-1).mean())),
    )
    worst = max(fit.sigma_focal_px[0] / lens.fx, fit.sigma_focal_px[1] / depth.fx)
    if worst > _MAX_FOCAL_SIGMA:
        raise ConfigError(
            f"focal lengths are uncertain by {100 * worst:.1f} %, {100 * _MAX_FOCAL_SIGMA:.0f} % are allowed: show the"
            " rectangle at more distances, turned to all sides, or leave out --board for the crop ratios alone"
        )
    return fit


def _solve(problem: _Problem) -> Any:
    return least_squares(problem.residuals, problem.start(), x_scale="jac", loss="soft_l1", f_scale=2.0)


def _check(views: Sequence[BoardView]) -> None:
    if len(views) < _MIN_VIEWS:
        raise ConfigError(
            f"the rectangle is seen whole by both cameras in {len(views)} pictures, lenses need {_MIN_VIEWS}: show it"
            " more often, or leave out --board for the crop ratios alone"
        )
    distances = np.array([view.depth_m.mean() for view in views])
    ratio = float(distances.max() / distances.min())
    if ratio < _MIN_DISTANCE_RATIO:
        raise ConfigError(
            f"the rectangle was at {distances.min():.2f} to {distances.max():.2f} m: show it nearer and farther, one"
            f" at least {_MIN_DISTANCE_RATIO:g} times the other, or leave out --board for the crop ratios alone"
        )


class _Problem:
    """The residuals. Parameters: depth lens, turn and shift of depth in colour (optical axes), colour lens.

    A lens is the logarithms of fx and fy, which stay positive, and cx, cy.
    """

    def __init__(
        self,
        views: Sequence[BoardView],
        board_m: tuple[float, float],
        colour_size: Size,
        depth_size: Size,
        colour: Pinhole | None,
    ) -> None:
        self._colour_uv = np.stack([view.colour_uv for view in views])
        self._depth_uv = np.stack([view.depth_uv for view in views])
        self._z = np.stack([view.depth_m for view in views])
        self._known = colour
        self._guess = colour or lens_of_angle(colour_size, 60.0)
        self._depth_guess = lens_of_angle(depth_size, 57.0)
        self._sides_m = self._expected_sides(board_m)
        self.n_measured = self._colour_uv.size + self._sides_m.size

    def start(self) -> Floats:
        """Return the parameters of two usual lenses at one place."""
        depth, lens = self._depth_guess, self._guess
        x = [*_numbers(depth), *np.zeros(6)]
        return np.array(x if self._known is not None else [*x, *_numbers(lens)])

    def parts(self, x: Floats) -> tuple[Pinhole, Pinhole, Floats, Floats]:
        """Return the colour lens, the depth lens, turn and shift."""
        return self._known or _lens(x[10:14]), _lens(x[:4]), x[4:7], x[7:10]

    def colour_misses(self, x: Floats) -> Floats:
        """Return where colour shows the corners, less where depth says, (K, 4, 2) [px]."""
        lens, _, turn, shift = self.parts(x)
        points = self._points(x) @ cv2.Rodrigues(turn)[0].T + shift
        flat = points.reshape(-1, 3)
        if lens.distortion:
            no_turn = np.zeros(3)
            uv, _ = cv2.projectPoints(flat, no_turn, no_turn, lens.matrix(), np.array(lens.distortion))
        else:
            uv = flat[:, :2] / flat[:, 2:] * (lens.fx, lens.fy) + (lens.cx, lens.cy)
        return self._colour_uv - np.asarray(uv).reshape(self._colour_uv.shape)

    def residuals(self, x: Floats) -> Floats:
        """Return everything in sigmas."""
        lens, depth, turn, shift = self.parts(x)
        sides = self._side_lengths(self._points(x)) - self._sides_m
        parts = [
            self.colour_misses(x).ravel() / _SIGMA_PX,
            sides.ravel() / _SIGMA_SIDE_M,
            turn / _TURN_RAD,
            shift / _SHIFT_M,
            _doubts(depth, self._depth_guess),
        ]
        return np.concatenate(parts if self._known is not None else [*parts, _doubts(lens, self._guess)])

    def _points(self, x: Floats) -> Floats:
        rays = (self._depth_uv - x[2:4]) / np.exp(x[:2])
        return np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=2) * self._z[..., None]

    def _expected_sides(self, board_m: tuple[float, float]) -> Floats:
        """Return the lengths of sides and diagonals, (K, 6); each view decides which side is which."""
        width, height = board_m
        diagonal = math.hypot(width, height)
        lying = np.array([width, height, width, height, diagonal, diagonal])
        standing = np.array([height, width, height, width, diagonal, diagonal])
        seen = self._side_lengths(self._points(self.start()))
        is_lying = np.abs(seen - lying).sum(axis=1) <= np.abs(seen - standing).sum(axis=1)
        return np.where(is_lying[:, None], lying, standing)

    @staticmethod
    def _side_lengths(points: Floats) -> Floats:
        return np.asarray(np.linalg.norm(points[:, _SIDES[:, 0]] - points[:, _SIDES[:, 1]], axis=2))


def _doubts(lens: Pinhole, guess: Pinhole) -> Floats:
    """Return how unusual a lens is, in sigmas: pixels that are not square, a centre off the middle."""
    centre = (lens.cx - guess.cx) / _CENTRE_PX, (lens.cy - guess.cy) / _CENTRE_PX
    return np.array([(lens.fx / lens.fy - 1.0) / _SQUARE, *centre])


def _numbers(lens: Pinhole) -> list[float]:
    return [math.log(lens.fx), math.log(lens.fy), lens.cx, lens.cy]


def _lens(numbers: Floats) -> Pinhole:
    fx, fy = np.exp(np.clip(numbers[:2], 0.0, 12.0)).tolist()
    return Pinhole(fx, fy, float(numbers[2]), float(numbers[3]))


def _matrix(turn: Floats, shift: Floats) -> Floats:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(turn)[0], shift
    return T
