"""Whether anything on the ground holds a motion along its grain: the ends of streaks, pores, what crosses them.

Streaks that are longer than the way between two pictures look the same wherever along them they are compared. The
search finds a place all the same, in noise, at the rim of a shadow or of a mark, and its minimum is as narrow as any.
So where both pictures share little but a grain, one is compared with the other all along it, in second differences
along the grain, which streaks do not have. What was found is held by the ground if the pictures are clearly more alike
there than at any other place; else the covariance spans the places that are as like.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from trailmark.arrays import Bools, Float32s, Floats, Grey16
from trailmark.kernels import float_kernel
from trailmark_ground_vo.filters import SMOOTH_SCALE
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.regular_grid import N_SIDE
from trailmark_ground_vo.weak_axis import mean_square_within

__all__ = ["AlongGrain", "Grain"]

#: Distance of the pixels that tell whether there is a grain, from each other and from the rim, and of the two beside
#: each of them that tell its slope [px].
_STEP_PX, _RIM_PX, _SLOPE_PX = 8, 8, 2

#: Pixels at the rim that are not compared [px].
_OUTER_PX = 3

#: Product of both pictures' slopes along the grain over that across, up to which there is one: wood and metal have up
#: to 0.25 where the motion is right, tiles 0.57 and more.
_MOST_ALONG = 0.3

#: Farthest place along the grain that is compared, the distance between two of them, and between lines across [px].
_FARTHEST_PX, _BETWEEN_PX, _ACROSS_PX = 40, 2, 4
_N_SIDE = _FARTHEST_PX // _BETWEEN_PX

#: Lines at most, bands of lines, and pieces of each: the parts that are asked separately.
_MOST_LINES, _N_BANDS, _N_PIECES = 200, 8, 4

#: Pixels that a part needs to be asked, and parts that are needed.
_LEAST_PIXELS, _LEAST_PARTS = 40, 4

#: Half the length of the second differences, in places.
_REACH = 4

#: What was found is the best within so many places; a best that is farther away than this is another motion [px].
_NEAR, _LEAST_OFF_PX = 2, 1.0

#: Beyond so many places nothing says how far it goes on: what is as like there may be anywhere.
_ANYWHERE = 6

#: Standard deviations by which pictures must be more alike where they belong together. Of motions off by more than 3 px
#: one in twenty was ahead by so much, of right ones on made streaks and two floors of wood nine in ten; in low light
#: and among things that pass one in three.
_LEAST_LEAD = 4.0

#: Standard deviations of a rival's place: of forty places of noise one is two or three above the median.
_LEAST_SUMMIT = 6.0

#: Slopes and differences are cut off here, so that single edges have no more say than the ground [grey levels].
_MOST_LEVELS = 12.0

#: Standard deviation over median absolute deviation of a normal distribution, and that of a median over that of a mean.
_SIGMA_OVER_MEDIAN, _SIGMA_OF_MEDIAN = 1.4826, 1.2533


@dataclass(frozen=True, slots=True)
class Grain:
    """What two pictures say about a motion along the grain of the ground.

    Attributes
    ----------
    direction : (float, float)
        Of the grain in the later picture, a unit vector (u, v).
    variance : float
        Mean square of the places that are as like as what was found; 0 where it stands out [px^2].
    rival : ImageMotion or None
        Motion by which the pictures are clearly more alike than by what was found, in most of their parts.
    """

    direction: tuple[float, float]
    variance: float
    rival: ImageMotion | None

    def widened(self, information: Floats) -> Floats:
        """Return the information (3, 3) of the motion (u, v, turn), less along the grain by this variance."""
        if self.variance == 0.0:
            return information
        held = information @ np.array([*self.direction, 0.0])
        along = float(held[:2] @ self.direction)
        return np.asarray(information - np.outer(held, held) / (1.0 / self.variance + along), np.float64)


class AlongGrain:
    """Compares pictures of one size along the grain of the ground.

    Parameters
    ----------
    size : (int, int)
        Width and height of the pictures [px].
    aspect : float
        Metres per pixel along v over those along u.
    """

    def __init__(self, size: tuple[int, int], aspect: float) -> None:
        self._aspect = aspect
        self._closed = np.zeros((size[1], size[0]), np.bool_)

    def ignore(self, closed: Bools | None) -> None:
        """Compare no pixel where something is fixed to the lens, (H, W) bool; None: compare all."""
        self._closed = np.zeros_like(self._closed) if closed is None else closed

    def warm_up(self) -> None:
        """Compile what a first grain needs: random stripes have nothing else."""
        stripes = np.random.default_rng(0).integers(0, 256 * SMOOTH_SCALE, self._closed.shape[1], np.uint16)
        picture = np.tile(stripes, (self._closed.shape[0], 1))
        self.compare(picture, picture, ImageMotion(0.0, 0.0, 0.0))

    def compare(self, before: Grey16, now: Grey16, motion: ImageMotion) -> Grain | None:
        """Return what smoothed pictures (see `filters.smooth`) say of a motion of the content; None without a grain."""
        moved = (motion.u, motion.v, motion.turn_rad)
        own, shared = _slope_products(before, now, self._closed, moved, self._aspect)
        grain, along = _grain_of(own, shared)
        if along > _MOST_ALONG:
            return None  # nothing is shared, or more than a grain
        direction = _direction_after((float(grain[0]), float(grain[1])), motion.turn_rad, self._aspect)
        likeness = _likeness(self._sums(before, now, motion, grain))
        near = _N_SIDE - _NEAR + int(np.argmax(likeness[_N_SIDE - _NEAR : _N_SIDE + _NEAR + 1]))
        variance = _variance_of(likeness > likeness[near] - _LEAST_LEAD, near, _summit_px(likeness, near))
        best = int(np.argmax(likeness))
        if likeness[best] < max(_LEAST_SUMMIT, likeness[near] + _LEAST_LEAD):
            return Grain(direction, variance, None)
        shift = (best - _N_SIDE) * _BETWEEN_PX
        rival = ImageMotion(motion.u + shift * direction[0], motion.v + shift * direction[1], motion.turn_rad)
        return Grain(direction, variance, rival)

    def _sums(self, before: Grey16, now: Grey16, motion: ImageMotion, grain: Floats) -> Floats:
        """Return what `_sums_along` does, of lines along the grain through both pictures."""
        height, width = before.shape
        centre = np.array([(width - 1) / 2.0, (height - 1) / 2.0])
        reach = math.hypot(width, height)
        length, n_lines = int(reach / _BETWEEN_PX), min(_MOST_LINES, int(reach / _ACROSS_PX))
        steps = np.array([_BETWEEN_PX * grain, reach / n_lines * np.array([-grain[1], grain[0]])]).T
        from_middle = steps @ np.array([[1.0, 0.0, -(length - 1) / 2.0], [0.0, 1.0, -(n_lines - 1) / 2.0]])
        cos, sin = math.cos(motion.turn_rad), math.sin(motion.turn_rad)
        turned = np.array([[cos, sin * self._aspect], [-sin / self._aspect, cos]]) @ from_middle
        is_open = np.zeros_like(self._closed)  # not at the rim, where what is between its pixels is not known
        inner = slice(_OUTER_PX, -_OUTER_PX)
        is_open[inner, inner] = ~self._closed[inner, inner]
        from_middle[:, 2] += centre
        turned[:, 2] += centre + motion.array()[:2]
        lines = [
            _second_differences(*_pixels_on_lines(picture, is_open, to, (length, n_lines)))
            for picture, to in ((before, from_middle), (now, turned))
        ]
        return _sums_along(lines[0][0], lines[1][0], lines[0][1], lines[1][1])


def _pixels_on_lines(picture: Grey16, is_open: Bools, to: Floats, size: tuple[int, int]) -> tuple[Float32s, Bools]:
    """Return a picture along lines, and which of their pixels are open in it; `to` maps lines to the picture."""
    how = cv2.WARP_INVERSE_MAP
    values = cv2.warpAffine(picture, to, size, flags=how | cv2.INTER_LINEAR)
    opened = cv2.warpAffine(is_open.view(np.uint8), to, size, flags=how | cv2.INTER_NEAREST)
    return values.astype(np.float32), opened.astype(np.bool_)


def _second_differences(values: Float32s, is_open: Bools) -> tuple[Float32s, Float32s]:
    """Return second differences along lines, 0 where they are not known, and 1 where they are."""
    first, middle, last = (slice(k * _REACH, values.shape[1] - (2 - k) * _REACH) for k in range(3))
    bent = 2.0 * values[:, middle] - values[:, first] - values[:, last]
    known = (is_open[:, first] & is_open[:, middle] & is_open[:, last]).astype(np.float32)
    most = np.float32(_MOST_LEVELS * SMOOTH_SCALE)
    return np.asarray(np.clip(bent, -most, most) * known, np.float32), known


def _grain_of(own: Floats, shared: Floats) -> tuple[Floats, float]:
    """Return the direction of the grain, and what the pictures share along it over what they share across it.

    Each part of the picture counts as much as another, and the median one decides: the edge of a shadow, which moves
    as it likes, lies in few of them. Where nothing is shared across the grain the ratio is infinite.
    """
    traces = own[:, 0, 0] + own[:, 1, 1]
    seen = traces > 0.0
    if not seen.any():
        return np.array([1.0, 0.0]), math.inf
    axes = np.linalg.eigh((own[seen] / traces[seen, None, None]).sum(axis=0))[1]
    along, across = (float(np.median(axis @ shared[seen] @ axis)) for axis in axes.T)
    return axes[:, 0], along / across if across > 0.0 else math.inf


def _likeness(sums: Floats) -> Floats:
    """Return how much more alike the pictures are at each place than at the median one, in standard deviations, (n,).

    The median part of the picture decides: what passes along the grain, and the edge of a shadow, lie in few. A grain
    that does not lie quite as it was measured is alike at all places, and what is found in noise scatters from place to
    place: both are taken from the places themselves.
    """
    n = sums[:, :, 0]
    correlation = sums[:, :, 3] / np.sqrt(np.maximum(sums[:, :, 1] * sums[:, :, 2], 1.0))
    seen = n >= _LEAST_PIXELS
    parts = np.count_nonzero(seen, axis=0)
    if parts.min() < _LEAST_PARTS:
        return np.zeros(n.shape[1])
    middle = np.nanmedian(np.where(seen, correlation, np.nan), axis=0)
    apart = (middle - np.median(middle)) * np.sqrt(np.where(seen, n, 0.0).sum(axis=0)) / _SIGMA_OF_MEDIAN
    return np.asarray(apart / max(1.0, _SIGMA_OVER_MEDIAN * float(np.median(np.abs(apart)))), np.float64)


def _summit_px(likeness: Floats, place: int) -> float:
    """Return how far from what was found the summit near a place lies, by a parabola through three places [px]."""
    below, top, above = likeness[place - 1 : place + 2]
    bend = below - 2.0 * top + above
    beside = 0.5 * (below - above) / bend if bend < 0.0 else 0.0
    return _BETWEEN_PX * (place - _N_SIDE + float(np.clip(beside, -0.5, 0.5)))


def _variance_of(is_like: Bools, near: int, summit_px: float) -> float:
    """Return the mean square of the places that are as like as the best one near what was found [px^2].

    Where that one alone is: 0, or the square of how far away its summit is.
    """
    places = np.flatnonzero(is_like)
    below, above = near - int(places.min(initial=near)), int(places.max(initial=near)) - near
    off = summit_px**2 if abs(summit_px) > _LEAST_OFF_PX else 0.0
    if max(below, above) <= _NEAR:
        return off
    if max(below, above) > _ANYWHERE:
        below = above = _N_SIDE
    return max(off, _BETWEEN_PX**2 * mean_square_within(float(below), float(above)))


def _direction_after(direction: tuple[float, float], turn_rad: float, aspect: float) -> tuple[float, float]:
    """Return where a direction in the earlier picture points in the later one, as a unit vector."""
    cos, sin = math.cos(turn_rad), math.sin(turn_rad)
    u = cos * direction[0] + sin * aspect * direction[1]
    v = cos * direction[1] - sin / aspect * direction[0]
    length = math.hypot(u, v)
    return u / length, v / length


@float_kernel
def _slope_products(
    before: Grey16, now: Grey16, closed: Bools, motion: tuple[float, float, float], aspect: float
) -> tuple[Floats, Floats]:
    """Return sums of products of the earlier picture's slopes, and of those with the later one's, (16, 2, 2) each."""
    height, width = before.shape
    cos, sin = math.cos(motion[2]), math.sin(motion[2])
    from_x, from_y = (width - 1) / 2.0, (height - 1) / 2.0
    to_x, to_y = from_x + motion[0] + 0.5, from_y + motion[1] + 0.5
    most = _MOST_LEVELS * SMOOTH_SCALE
    own, shared = np.zeros((N_SIDE * N_SIDE, 2, 2)), np.zeros((N_SIDE * N_SIDE, 2, 2))
    for v in range(_RIM_PX, height - _RIM_PX, _STEP_PX):
        for u in range(_RIM_PX, width - _RIM_PX, _STEP_PX):
            dx, dy = u - from_x, v - from_y
            i = math.floor(cos * dx + sin * aspect * dy + to_x)
            j = math.floor(cos * dy - sin / aspect * dx + to_y)
            if i < _RIM_PX or j < _RIM_PX or i >= width - _RIM_PX or j >= height - _RIM_PX:
                continue
            if closed[v, u] or closed[j, i]:
                continue
            part = v * N_SIDE // height * N_SIDE + u * N_SIDE // width
            before_u = float(before[v, u + _SLOPE_PX]) - float(before[v, u - _SLOPE_PX])
            before_v = float(before[v + _SLOPE_PX, u]) - float(before[v - _SLOPE_PX, u])
            now_u = float(now[j, i + _SLOPE_PX]) - float(now[j, i - _SLOPE_PX])
            now_v = float(now[j + _SLOPE_PX, i]) - float(now[j - _SLOPE_PX, i])
            cut_before = min(1.0, most / max(1.0, math.hypot(before_u, before_v)))
            cut = cut_before * min(1.0, most / max(1.0, math.hypot(now_u, now_v)))
            own[part, 0, 0] += cut_before * cut_before * before_u * before_u
            own[part, 0, 1] += cut_before * cut_before * before_u * before_v
            own[part, 1, 1] += cut_before * cut_before * before_v * before_v
            shared[part, 0, 0] += cut * before_u * now_u
            shared[part, 0, 1] += cut * 0.5 * (before_u * now_v + before_v * now_u)
            shared[part, 1, 1] += cut * before_v * now_v
    own[:, 1, 0], shared[:, 1, 0] = own[:, 0, 1], shared[:, 0, 1]
    return own, shared


@float_kernel
def _sums_along(before: Float32s, now: Float32s, seen_before: Float32s, seen_now: Float32s) -> Floats:
    """Return the pixels at each place along the lines, and the sums of squares and products, (parts, n, 4)."""
    n_lines, length = before.shape
    out = np.zeros((_N_BANDS * _N_PIECES, 2 * _N_SIDE + 1, 4), np.float64)
    for place in range(2 * _N_SIDE + 1):
        shift = place - _N_SIDE
        for line in range(n_lines):
            for piece in range(_N_PIECES):
                first = max(piece * length // _N_PIECES, -shift)
                last = max(first, min((piece + 1) * length // _N_PIECES, length - shift))
                a, b = before[line, first:last], now[line, first + shift : last + shift]
                is_a, is_b = seen_before[line, first:last], seen_now[line, first + shift : last + shift]
                n, aa, bb, ab = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
                for k in range(last - first):
                    n += is_a[k] * is_b[k]
                    aa += a[k] * a[k] * is_b[k]
                    bb += b[k] * b[k] * is_a[k]
                    ab += a[k] * b[k]
                part = line * _N_BANDS // n_lines * _N_PIECES + piece
                out[part, place, 0] += n
                out[part, place, 1] += aa
                out[part, place, 2] += bb
                out[part, place, 3] += ab
    return out
