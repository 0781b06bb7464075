"""Whether depth lies on colour as the calibration says: edges of depth are looked for in the colour picture.

A depth picture that belongs to another lens gives every landmark the depth of its neighbour. On a wall this is a wrong
scale of the whole world, on which all landmarks agree: no residual shows it. The outlines of things do, since they are
edges in both pictures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from trailmark.arrays import Depth, Float32s, Floats, Grey8

__all__ = ["Registration", "RegistrationCheck", "State", "find_registration"]

#: What is known of a registration.
State = Literal["unknown", "as given", "measured"]

_SCALES = np.arange(0.84, 1.161, 0.02)
_RIGHT_PX, _DOWN_PX = np.arange(-24.0, 25.0, 4.0), np.arange(-8.0, 9.0, 4.0)
_FINE_SCALES, _FINE_PX = np.arange(-0.01, 0.011, 0.005), np.arange(-4.0, 5.0)
_JUMP_SHARE, _JUMP_M = 0.08, 0.05  # a step in depth that is an outline, not a slope
_MIN_EDGES, _MAX_EDGES = 300, 600  # fewer say one thing's place at most; more say nothing new
_CLEAR = 0.9  # a registration that lies elsewhere must score less than this share of the best
_LEAST_SCORE = 0.5  # contrast under the outlines; on noise it is a tenth, on the edges of things more than one
_ELSEWHERE_PX, _SAME_PX = 8.0, 3.0
_AS_GIVEN_PX = 3.0  # edges of colour and depth differ by so much where all is well
_NEAR_M, _FAR_M = 0.3, 8.0
_N_AGREE = 3
_APART_S = 0.15
_WIDTH_PX = 640.0  # the constants above are for pictures of this width


@dataclass(frozen=True, slots=True)
class Registration:
    """Where depth pixels lie in the colour picture: ``centre + scale (pixel - centre) + (right_px, down_px)``.

    Attributes
    ----------
    scale : float
        Factor about the centre of the picture.
    right_px, down_px : float
        Shift of the depth picture [px].
    """

    scale: float = 1.0
    right_px: float = 0.0
    down_px: float = 0.0

    def offset_px(self, other: Registration, size: tuple[int, int]) -> float:
        """Return the root mean square distance between where two registrations put pixels, over a picture [px]."""
        spread = (size[0] ** 2 + size[1] ** 2) / 12.0
        turned = (self.scale - other.scale) ** 2 * spread
        return math.sqrt(turned + (self.right_px - other.right_px) ** 2 + (self.down_px - other.down_px) ** 2)

    def share(self, size: tuple[int, int]) -> float:
        """Return by what share depths of a slanting surface are off without it: offset by distance from the axis."""
        return self.offset_px(Registration(), size) / math.sqrt((size[0] ** 2 + size[1] ** 2) / 12.0)

    def array(self) -> Floats:
        """Return scale, right_px and down_px, (3,)."""
        return np.array([self.scale, self.right_px, self.down_px])

    def apply(self, depth_m: Depth) -> Depth:
        """Return depth as the colour camera sees it, NaN where the depth camera does not look."""
        height, width = depth_m.shape
        centre = np.array([(width - 1) / 2.0, (height - 1) / 2.0])
        to_colour = np.array(
            [
                [self.scale, 0.0, (1.0 - self.scale) * centre[0] + self.right_px],
                [0.0, self.scale, (1.0 - self.scale) * centre[1] + self.down_px],
            ]
        )
        warped = cv2.warpAffine(
            depth_m,
            to_colour,
            (width, height),
            flags=cv2.INTER_NEAREST,  # a mean over an outline is a depth at which nothing stands
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=math.nan,
        )
        return np.asarray(warped, dtype=np.float32)


def find_registration(grey: Grey8, depth_m: Depth) -> Registration | None:
    """Return the registration under which outlines in depth lie on edges of grey; None where that is not clear.

    Parameters
    ----------
    grey : (H, W) uint8
        Colour picture in grey.
    depth_m : (H, W) float32
        Depth, as it is said to be registered, NaN where unknown [m].
    """
    if depth_m.shape != grey.shape:
        return None
    uv = _outlines(depth_m)
    if len(uv) < _MIN_EDGES:
        return None
    uv = uv[np.linspace(0, len(uv) - 1, min(len(uv), _MAX_EDGES)).astype(np.intp)]
    contrast = _edge_contrast(grey)
    ratio = grey.shape[1] / _WIDTH_PX
    right, down = ratio * _RIGHT_PX, ratio * _DOWN_PX
    scores = _scores(contrast, uv, _SCALES, right, down)
    best = _at(scores, _SCALES, right, down)
    size = grey.shape[1], grey.shape[0]
    elsewhere = _offsets_px(best, _SCALES, right, down, size) > _ELSEWHERE_PX * ratio
    if not scores.max() > _LEAST_SCORE or scores[elsewhere].max() > _CLEAR * scores.max():
        return None
    scales, near_px = best.scale + _FINE_SCALES, ratio * _FINE_PX
    right, down = best.right_px + near_px, best.down_px + near_px
    return _at(_scores(contrast, uv, scales, right, down), scales, right, down)


class RegistrationCheck:
    """Measures the registration in the first pictures, until several agree.

    A camera that turns shows colour and depth of different times, which looks like a shift: only pictures that were
    taken at rest or on a straight way are asked.

    Attributes
    ----------
    state : {"unknown", "as given", "measured"}
        ``as given``: outlines lie where they should. ``measured``: they lie elsewhere, at `found`.
    found : Registration or None
        What depth needs, where it is not as given.
    """

    def __init__(self) -> None:
        self.state: State = "unknown"
        self.found: Registration | None = None
        self._votes: list[Registration] = []
        self._next_s = -math.inf

    def look(self, stamp_s: float, grey: Grey8, depth_m: Depth, is_steady: bool) -> bool:
        """Take a picture; return True when the registration has just been found to be another than given."""
        if self.state != "unknown" or not is_steady or stamp_s < self._next_s:
            return False
        self._next_s = stamp_s + _APART_S
        vote = find_registration(grey, depth_m)
        if vote is None:
            return False
        size = grey.shape[1], grey.shape[0]
        ratio = size[0] / _WIDTH_PX
        if self._votes and vote.offset_px(self._votes[-1], size) > _SAME_PX * ratio:
            self._votes = []
        self._votes.append(vote)
        if len(self._votes) < _N_AGREE:
            return False
        mean = Registration(*np.mean([one.array() for one in self._votes], axis=0).tolist())
        if mean.offset_px(Registration(), size) <= _AS_GIVEN_PX * ratio:
            self.state = "as given"
            return False
        self.take(mean)
        return True

    def take(self, found: Registration) -> None:
        """Take a registration that was measured earlier."""
        self.state, self.found = "measured", found


def _outlines(depth_m: Depth) -> Floats:
    """Return pixels at the near side of steps in depth, (N, 2), row by row."""
    known = np.isfinite(depth_m) & (depth_m > _NEAR_M) & (depth_m < _FAR_M)
    depth = np.where(known, depth_m, np.float32(0.0)).astype(np.float32)
    surrounded = cv2.erode(known.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    square = np.ones((3, 3), np.uint8)
    near, far = cv2.erode(depth, square), cv2.dilate(depth, square)
    step = far - near
    is_outline = surrounded & (step > _JUMP_SHARE * near + _JUMP_M) & (depth - near < 0.3 * step)
    v, u = np.nonzero(is_outline)
    return np.stack([u, v], axis=1).astype(np.float64)


def _edge_contrast(grey: Grey8) -> Float32s:
    """Return how much of an edge each pixel is, compared with its surroundings; mean 0, (H, W)."""
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.5).astype(np.float32)
    steep = cv2.magnitude(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1))
    local = np.minimum(steep / (cv2.boxFilter(steep, -1, (61, 61)) + 4.0), 3.0)
    contrast = cv2.GaussianBlur(local, (0, 0), 1.5)
    return np.asarray(contrast - contrast.mean(), dtype=np.float32)


def _scores(contrast: Float32s, uv: Floats, scales: Floats, right_px: Floats, down_px: Floats) -> Floats:
    """Return the mean contrast under the outlines for every registration, (K, R, D)."""
    height, width = contrast.shape
    centre = np.array([(width - 1) / 2.0, (height - 1) / 2.0])
    spread = scales[:, None, None] * (uv - centre) + centre  # (K, N, 2)
    u = np.rint(spread[:, None, :, 0] + right_px[:, None]).astype(np.intp)  # (K, R, N)
    v = np.rint(spread[:, None, :, 1] + down_px[:, None]).astype(np.intp)  # (K, D, N)
    bordered = np.pad(contrast, 1)  # what leaves the picture scores nothing
    u, v = np.clip(u + 1, 0, width + 1), np.clip(v + 1, 0, height + 1)
    return np.asarray(bordered[v[:, None, :, :], u[:, :, None, :]].mean(axis=3), dtype=np.float64)


def _at(scores: Floats, scales: Floats, right_px: Floats, down_px: Floats) -> Registration:
    k, r, d = np.unravel_index(int(scores.argmax()), scores.shape)
    return Registration(float(scales[k]), float(right_px[r]), float(down_px[d]))


def _offsets_px(best: Registration, scales: Floats, right_px: Floats, down_px: Floats, size: tuple[int, int]) -> Floats:
    """Return how far each registration is from the best, (K, R, D) [px]."""
    squared = (scales - best.scale)[:, None, None] ** 2 * ((size[0] ** 2 + size[1] ** 2) / 12.0)
    squared = squared + (right_px - best.right_px)[None, :, None] ** 2 + (down_px - best.down_px)[None, None, :] ** 2
    return np.asarray(np.sqrt(squared))
