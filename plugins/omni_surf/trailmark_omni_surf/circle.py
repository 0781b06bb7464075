"""The circle that an omnidirectional picture fills: found in the picture, checked, and turned into bearings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import ShapeError
from trailmark.frames import Omni
from trailmark_omni_surf.circle_kernels import rim_coverages

__all__ = ["BearingCamera", "ImageCircle", "find_circle"]


_N_SECTORS = 180
_N_TRIALS = 1500
_N_EDGES = 2500
_MIN_RADIUS_SHARE = 0.25  # of the shorter side
_ALIGNED = math.cos(math.radians(20))  # the edge of a circle is crossed along the radius


@dataclass(frozen=True, slots=True)
class ImageCircle:
    """The rim of the mirror or lens in the picture.

    Attributes
    ----------
    centre_u, centre_v, radius_px : float
        Centre and radius [px].
    coverage : float
        Share of the rim that is seen as an edge, of what lies inside the picture (0 to 1).
    residual_px : float
        RMS distance of those edges from the circle [px].
    """

    centre_u: float
    centre_v: float
    radius_px: float
    coverage: float
    residual_px: float


def find_circle(image: npt.NDArray[np.uint8], tolerance_px: float = 1.5) -> ImageCircle | None:
    """Return the circle with the best covered rim, or None when the picture has no edges.

    Pairs of edge points propose a centre where their gradients meet; the rim that most sectors show is refined by
    least squares. Whether `coverage` is enough is the caller's to judge: a stretched picture has a low one.

    Parameters
    ----------
    image : (H, W) uint8
        Grey picture.
    tolerance_px : float
        How far an edge may lie from the rim [px].
    """
    points, directions = _edges(image)
    if len(points) < 50:
        return None
    rng = np.random.default_rng(0)  # the same picture gives the same circle
    circles = _candidates(points, directions, image.shape, rng)
    if not len(circles):
        return None
    height, width = image.shape
    coverages = rim_coverages(circles, points, directions, width, height, 2.0 * tolerance_px, _ALIGNED, _N_SECTORS)
    return _refine_circle(circles[int(coverages.argmax())], points, directions, image.shape, tolerance_px)


@dataclass(frozen=True, slots=True)
class BearingCamera:
    """Turns pixels into bearings: all that an uncalibrated omnidirectional camera needs to know, Eq. (5).

    Attributes
    ----------
    centre_u, centre_v : float
        Image centre [px].
    sign : float
        -1 where the image turns counter-clockwise with the bearing (v points down), 1 where clockwise.
    forward_rad : float
        Image direction of the sensor's forward axis, from +u towards +v [rad].
    radius_inner_px, radius_outer_px : float
        Ring that shows the surroundings [px].
    """

    centre_u: float
    centre_v: float
    sign: float
    forward_rad: float
    radius_inner_px: float
    radius_outer_px: float

    @classmethod
    def of(cls, calibration: Omni, circle: ImageCircle | None) -> BearingCamera:
        """Return what the calibration says, completed by the circle that was found.

        Raises
        ------
        ShapeError
            If neither tells the centre or the outer radius.
        """
        found = (None, None, None) if circle is None else (circle.centre_u, circle.centre_v, circle.radius_px)
        u = found[0] if calibration.centre_u is None else calibration.centre_u
        v = found[1] if calibration.centre_v is None else calibration.centre_v
        outer = found[2] if calibration.radius_outer_px is None else calibration.radius_outer_px
        if u is None or v is None or outer is None:
            raise ShapeError("the image centre is neither in the calibration nor found in the picture")
        inner = calibration.radius_inner_px
        sign = -1.0 if calibration.turns == "counterclockwise" else 1.0
        forward = math.radians(calibration.forward_deg)
        return cls(u, v, sign, forward, 0.2 * outer if inner is None else inner, outer)

    def bearings(self, uv: Floats) -> Floats:
        """Return the bearing of every pixel in sensor axes, counter-clockwise from forward, (N,) [rad]."""
        directions = np.arctan2(uv[:, 1] - self.centre_v, uv[:, 0] - self.centre_u)
        return np.asarray(np.mod(self.sign * (directions - self.forward_rad) + np.pi, 2.0 * np.pi) - np.pi)

    def distances(self, uv: Floats) -> Floats:
        """Return the distance of every pixel from the image centre, (N,) [px]."""
        return np.hypot(uv[:, 0] - self.centre_u, uv[:, 1] - self.centre_v)

    def pixels(self, bearings: Floats, shares: Floats) -> Floats:
        """Return the pixels under bearings [rad], (N, 2); shares run from the inner rim, 0, to the outer, 1."""
        inner, outer = self.radius_inner_px + 2.0, self.radius_outer_px - 2.0
        distances, directions = inner + shares * (outer - inner), self.forward_rad + self.sign * bearings
        offsets = distances * np.stack([np.cos(directions), np.sin(directions)])
        return np.asarray(offsets.T + np.array([self.centre_u, self.centre_v]))

    def is_inside(self, uv: Floats, margin_px: float = 4.0) -> npt.NDArray[np.bool_]:
        """Return which pixels lie in the ring and at least a margin from its rims."""
        distances = self.distances(uv)
        is_within_rim = distances < self.radius_outer_px - margin_px
        return np.asarray(is_within_rim & (distances > self.radius_inner_px + margin_px))


def _edges(image: npt.NDArray[np.uint8]) -> tuple[Floats, Floats]:
    """Return edge pixels (N, 2) and their gradient directions as unit vectors (N, 2)."""
    smooth = cv2.GaussianBlur(image, (0, 0), 1.5)
    gradient_u = cv2.Sobel(smooth, cv2.CV_16S, 1, 0)
    gradient_v = cv2.Sobel(smooth, cv2.CV_16S, 0, 1)
    rows, columns = np.nonzero(cv2.Canny(gradient_u, gradient_v, 25, 60))
    if len(rows) > _N_EDGES:
        chosen = np.linspace(0, len(rows) - 1, _N_EDGES).astype(int)
        rows, columns = rows[chosen], columns[chosen]
    gradients = np.stack([gradient_u[rows, columns], gradient_v[rows, columns]], axis=1).astype(np.float64)
    lengths = np.maximum(np.linalg.norm(gradients, axis=1, keepdims=True), 1e-9)
    return np.stack([columns, rows], axis=1).astype(np.float64), gradients / lengths


def _candidates(points: Floats, directions: Floats, shape: tuple[int, ...], rng: np.random.Generator) -> Floats:
    """Return circles (u, v, radius) proposed by pairs of edge points, those of a sensible size and place."""
    i, j = rng.integers(0, len(points), (2, 20 * _N_TRIALS))
    cross = directions[i, 0] * directions[j, 1] - directions[i, 1] * directions[j, 0]
    is_apart = np.abs(cross) > 0.3
    i, j, cross = i[is_apart], j[is_apart], cross[is_apart]
    between = points[j] - points[i]
    along = (between[:, 0] * directions[j, 1] - between[:, 1] * directions[j, 0]) / cross
    centres = points[i] + along[:, None] * directions[i]
    radius_i, radius_j = np.abs(along), np.linalg.norm(points[j] - centres, axis=1)
    height, width = shape
    shorter = min(height, width)
    is_sensible = (
        (np.abs(radius_i - radius_j) < 0.06 * radius_i)
        & (radius_i > _MIN_RADIUS_SHARE * shorter)
        & (radius_i < 0.75 * max(height, width))
        & (np.abs(centres[:, 0] - width / 2) < width / 4)
        & (np.abs(centres[:, 1] - height / 2) < height / 4)
    )
    circles = np.column_stack([centres, (radius_i + radius_j) / 2.0])[is_sensible]
    return np.asarray(circles[:_N_TRIALS])


def _judge(
    circle: Floats, points: Floats, directions: Floats, shape: tuple[int, ...], tolerance_px: float
) -> tuple[ImageCircle, npt.NDArray[np.bool_]]:
    """Return the circle with its coverage, and which edges lie on it."""
    away = points - circle[:2]
    distances = np.hypot(away[:, 0], away[:, 1])
    offsets = distances - circle[2]
    aligned = np.abs((away * directions).sum(axis=1)) > _ALIGNED * distances
    on_rim = (np.abs(offsets) < tolerance_px) & aligned
    angles = np.arctan2(away[on_rim, 1], away[on_rim, 0])
    sectors = np.unique(((angles + np.pi) / (2 * np.pi) * _N_SECTORS).astype(int) % _N_SECTORS)
    centres = (np.arange(_N_SECTORS) + 0.5) / _N_SECTORS * 2 * np.pi - np.pi
    rim_u, rim_v = circle[0] + circle[2] * np.cos(centres), circle[1] + circle[2] * np.sin(centres)
    visible = (rim_u > 3) & (rim_v > 3) & (rim_u < shape[1] - 4) & (rim_v < shape[0] - 4)
    n_visible = int(visible.sum())
    coverage = int(visible[sectors].sum()) / n_visible if n_visible >= _N_SECTORS // 2 else 0.0
    residual = float(np.sqrt((offsets[on_rim] ** 2).mean())) if on_rim.any() else math.inf
    found = ImageCircle(float(circle[0]), float(circle[1]), float(circle[2]), coverage, residual)
    return found, on_rim


def _refine_circle(
    circle: Floats, points: Floats, directions: Floats, shape: tuple[int, ...], tolerance_px: float
) -> ImageCircle:
    """Fit the circle to its own edges by Gauss-Newton, with a gate that closes."""
    for gate_px in (4.0, 3.0, 2.0, 2.0, 1.0, 1.0):
        _, on_rim = _judge(circle, points, directions, shape, gate_px * tolerance_px)
        if on_rim.sum() < 10:
            break
        circle = circle + _circle_step(points[on_rim], circle)
    return _judge(circle, points, directions, shape, tolerance_px)[0]


def _circle_step(points: Floats, circle: Floats) -> Any:
    away = points - circle[:2]
    distances = np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-9)
    jacobian = np.column_stack([away / distances[:, None], np.ones(len(points))])
    return np.linalg.lstsq(jacobian, distances - circle[2], rcond=None)[0]
