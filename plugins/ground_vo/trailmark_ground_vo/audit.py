"""An audit of a motion, by pixels that had no part in finding it.

Reference pixels are the steepest ones, wherever they are. A regular grid of others is asked what they make of the
motion: whether they look as in the picture before, whether the light around them has changed, and whether all of the
picture, or a part of it, would rather have moved otherwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Float32s, Floats, Grey16, Int64s
from trailmark.kernels import float_kernel, kernel
from trailmark_ground_vo.closed_places import is_at
from trailmark_ground_vo.few_numbers import median_of, solve_symmetric
from trailmark_ground_vo.filters import SMOOTH_SCALE
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.regular_grid import N_SIDE, regular_grid

__all__ = ["Audit", "MotionAudit"]

#: A pixel differs when it does so by more robust standard deviations, and more than so far a shift would explain [px].
_OUT_SIGMAS, _OUT_PX = 6.0, 0.5

#: Differences are clipped here where shading is fitted; the most that a lens changes between pictures at its edge [1].
_CLIP, _MOST_SHADING = 10.0 * SMOOTH_SCALE, 0.06

#: Residuals count fully up to this [robust standard deviations] (Huber).
_HUBER_SIGMAS = 2.0

#: Slopes count fully up to this, of the mean: what is steeper than all the rest, a mark on the lens, has no more say.
_STEEP = 2.0

#: A part of the picture has a say with so many pixels, and with own errors below this [px].
_LEAST_PIXELS, _LEAST_OWN_PX = 40, 0.02

#: Standard deviation over median absolute deviation of a normal distribution.
_SIGMA_OVER_MEDIAN = 1.4826

# Limits. In good light the grid says at most, on three floors they were chosen on (wood_floor, tiles_1k,
# asphalt_cracked_1k), blurred and with noise of up to 12 levels: 0.0003 of the pixels out, 0.42 of the noise, light
# 0.5 sigmas, 0.11 px, 0.03 deg, parts 2.7 sigmas.
#: Share of the pixels that may differ.
_MOST_OUT = 0.003
#: Spread of the differences, over the noise of the picture: smoothing leaves about 0.39 of it.
_MOST_SPREAD = 0.6
#: Change of light in a part of the picture [robust standard deviations].
_MOST_LIGHT_SIGMAS = 3.0
#: What the whole picture, and a part of it, would correct, beyond so many own standard deviations [px], [rad].
_MOST_SHIFT_PX, _MOST_TURN_RAD, _SIGMAS, _PART_SIGMAS = 0.1, math.radians(0.01), 5.0, 5.0
#: By how much a picture grows or shrinks where the camera heaves, by a millimetre of a quarter of a metre, and how many
#: other parts must tell.
_MOST_ZOOM, _LEAST_OTHERS = 0.004, 6
#: Own standard deviation of a turn between two pictures from which on it can be wrong by what matters, 0.05 deg.
_MOST_TURN_SIGMA_RAD = math.radians(0.01)
#: Slope along the axis that the ground holds least, over the noise of the picture, that noise alone has, and standard
#: errors beyond that: along a perfect grain 0.145, on dark wood 0.163. Steep pixels are steep by noise there.
_SLOPE_OF_NOISE, _SLOPE_SIGMAS, _LEAST_NOISE = 0.145, 2.0, 0.3


@dataclass(frozen=True, slots=True)
class Audit:
    """What the grid says of a motion.

    Attributes
    ----------
    spread : float
        Robust standard deviation of the differences [grey levels].
    n_out, n : int
        Pixels that differ, and that were asked.
    light_sigmas : float
        Largest change of light in a part of the picture, in `spread`.
    shift_sigmas, turn_sigmas : float
        What the whole picture would correct, over what is usual.
    turn_sigma_rad : float
        Standard deviation of that turn [rad].
    part_sigmas : float
        Largest shift of a part of the picture against the others, over its own standard deviation. Of that is left out
        what all parts move outwards or inwards.
    least_slope : float
        Root mean square slope along the axis where it is least [grey levels/px].
    """

    spread: float
    n_out: int
    n: int
    light_sigmas: float
    shift_sigmas: float
    turn_sigmas: float
    turn_sigma_rad: float
    part_sigmas: float
    least_slope: float

    def reason_suspected(self, noise: float) -> str:
        """Return why the motion must be confirmed by another search; empty when it need not.

        Parameters
        ----------
        noise : float
            Noise of the picture (see `filters.noise_level`) [grey levels].
        """
        if self.n == 0 or self.n_out > _MOST_OUT * self.n:
            return f"{self.n_out} of {self.n} pixels differ"
        if self.spread > _MOST_SPREAD * max(noise, 1.0):
            return f"differences of {self.spread:.1f} grey levels with noise of {noise:.1f}"
        if self.light_sigmas > _MOST_LIGHT_SIGMAS:
            return f"the light changes by {self.light_sigmas:.1f} standard deviations"
        if max(self.shift_sigmas, self.turn_sigmas) > _SIGMAS:
            return f"the whole picture moves otherwise, by {max(self.shift_sigmas, self.turn_sigmas):.1f} sigmas"
        if self.part_sigmas > _PART_SIGMAS:
            return f"a part of the picture moves otherwise, by {self.part_sigmas:.1f} sigmas"
        if self.turn_sigma_rad > _MOST_TURN_SIGMA_RAD:
            return f"noise turns it by {math.degrees(self.turn_sigma_rad):.3f} deg"
        of_noise = _SLOPE_OF_NOISE * (1.0 + _SLOPE_SIGMAS / math.sqrt(self.n)) * max(noise, _LEAST_NOISE)
        if self.least_slope < of_noise:
            return f"no slope but that of noise along one axis, {self.least_slope:.2f} grey levels/px"
        return ""


class MotionAudit:
    """Asks a regular grid of pixels.

    Parameters
    ----------
    size : (int, int)
        Width and height of the pictures [px].
    aspect : float
        Metres per pixel along v over those along u.
    """

    def __init__(self, size: tuple[int, int], aspect: float) -> None:
        self._grid = regular_grid(size)
        self._part_px = size[0] / N_SIDE, size[1] / N_SIDE
        self._aspect = aspect
        self._closed: Bools | None = None

    def ignore(self, closed: Bools | None) -> None:
        """Leave out the pixels of `spread` where something is fixed to the lens, (H, W) bool; None: leave out none."""
        self._closed = closed

    def audit(self, before: Grey16, now: Grey16, motion: ImageMotion) -> Audit:
        """Compare two smoothed pictures (see `filters.smooth`) after a motion of the content."""
        moved = (motion.u, motion.v, motion.turn_rad)
        samples = _samples(before, now, self._grid.places, self._grid.centre, moved, self._aspect)
        if samples.shape[1] == 0:
            return Audit(0.0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        spread = _spread(samples)
        parts, whole, n_out = _equations(samples, self._grid.parts, spread)
        light, shift, turn, turn_sigma, part = _decide(parts, whole, spread, self._part_px)
        slope = _least_slope(whole) / math.sqrt(samples.shape[1]) / SMOOTH_SCALE
        return Audit(spread / SMOOTH_SCALE, n_out, samples.shape[1], light, shift, turn, turn_sigma, part, slope)

    def spread(self, before: Grey16, now: Grey16, motion: ImageMotion) -> float:
        """Return `Audit.spread` alone, in a part of the time [grey levels]; ``inf`` where nothing can be compared."""
        moved = (motion.u, motion.v, motion.turn_rad)
        samples = _samples(before, now, self._grid.places, self._grid.centre, moved, self._aspect)
        if self._closed is not None:
            samples = samples[:, self._is_open(self._closed, samples, moved)]
        return _spread(samples) / SMOOTH_SCALE if samples.shape[1] else math.inf

    def _is_open(self, closed: Bools, samples: Float32s, motion: tuple[float, float, float]) -> Bools:
        """Return which samples look at open places in both pictures, (n,) bool."""
        places = self._grid.places[:, samples[5].astype(np.int64)]
        return ~(
            is_at(closed, places, self._grid.centre, (0.0, 0.0, 0.0), self._aspect)
            | is_at(closed, places, self._grid.centre, motion, self._aspect)
        )


def _least_slope(whole: Floats) -> float:
    """Return the root of the smaller eigenvalue of the squared slopes."""
    half_sum, half_apart = (whole[0, 0] + whole[1, 1]) / 2.0, (whole[0, 0] - whole[1, 1]) / 2.0
    return math.sqrt(max(0.0, half_sum - math.hypot(half_apart, whole[0, 1])))


def _spread(samples: Float32s) -> float:
    """Return the robust standard deviation of the differences, in units of the smoothed picture."""
    sizes = np.abs(samples[0, ::2])
    middle = len(sizes) // 2
    return max(_SIGMA_OVER_MEDIAN * float(np.partition(sizes, middle)[middle]), 0.1 * SMOOTH_SCALE)


@float_kernel
def _samples(
    before: Grey16,
    now: Grey16,
    grid: Float32s,
    centre: tuple[float, float],
    motion: tuple[float, float, float],
    aspect: float,
) -> Float32s:
    """Return difference after the motion, slopes along u and v, offset from the centre and number, (6, n) float32.

    Pixels that left the picture are left out. What moves under a lens that darkens towards the corners changes by its
    brightness times a linear function of its place: that much is taken out of the differences.
    """
    height, width = before.shape
    cos = np.float32(math.cos(motion[2]))
    across, down = np.float32(math.sin(motion[2]) * aspect), np.float32(math.sin(motion[2]) / aspect)
    to_x, to_y = np.float32(centre[0] + motion[0]), np.float32(centre[1] + motion[1])
    last_x, last_y = np.float32(width - 2), np.float32(height - 2)
    half, one = np.float32(0.5), np.float32(1.0)
    out = np.empty((6, grid.shape[1]), np.float32)
    n, clip = 0, np.float32(_CLIP)
    a_xx, a_xy, a_yy, b_x, b_y = 1.0, 0.0, 1.0, 0.0, 0.0
    for k in range(grid.shape[1]):
        dx, dy = grid[0, k] - np.float32(centre[0]), grid[1, k] - np.float32(centre[1])
        x, y = cos * dx + across * dy + to_x, cos * dy - down * dx + to_y
        if x < one or y < one or x >= last_x or y >= last_y:
            continue
        u, v, i, j = int(grid[0, k]), int(grid[1, k]), int(x), int(y)
        a, b = x - np.float32(i), y - np.float32(j)
        above = np.float32(now[j, i]) + a * (np.float32(now[j, i + 1]) - np.float32(now[j, i]))
        below = np.float32(now[j + 1, i]) + a * (np.float32(now[j + 1, i + 1]) - np.float32(now[j + 1, i]))
        value = np.float32(before[v, u])
        d = above + b * (below - above) - value
        gain_x, gain_y, clipped = value * dx, value * dy, min(max(d, -clip), clip)
        a_xx, a_xy, a_yy = a_xx + gain_x * gain_x, a_xy + gain_x * gain_y, a_yy + gain_y * gain_y
        b_x, b_y = b_x + gain_x * clipped, b_y + gain_y * clipped
        out[0, n] = d
        out[1, n] = half * (np.float32(before[v, u + 1]) - np.float32(before[v, u - 1]))
        out[2, n] = half * (np.float32(before[v + 1, u]) - np.float32(before[v - 1, u]))
        out[3, n], out[4, n], out[5, n] = dx, dy, k
        n += 1
    scale = 1.0 / (a_xx * a_yy - a_xy * a_xy)
    steepest = _MOST_SHADING / max(centre[0], centre[1])
    tilt_x = np.float32(min(max((a_yy * b_x - a_xy * b_y) * scale, -steepest), steepest))
    tilt_y = np.float32(min(max((a_xx * b_y - a_xy * b_x) * scale, -steepest), steepest))
    for k in range(n):
        value = np.float32(before[int(grid[1, int(out[5, k])]), int(grid[0, int(out[5, k])])])
        out[0, k] -= value * (tilt_x * out[3, k] + tilt_y * out[4, k])
    return out if n == grid.shape[1] else out[:, :n].copy()  # one layout: what takes it is compiled once


@float_kernel
def _equations(samples: Float32s, parts: Int64s, spread: float) -> tuple[Floats, Floats, int]:
    """Return the sums over each part, (16, 10), the normal equations of the whole, (3, 4), and how many pixels differ.

    Sums of a part: n; weights w; w u, w v, w uu, w uv, w vv for slopes u, v; w d, w ud, w vd for differences d.
    """
    out, whole, n_out = np.zeros((N_SIDE * N_SIDE, 10), np.float64), np.zeros((3, 4), np.float64), 0
    limit, most, far = np.float32(_HUBER_SIGMAS * spread), np.float32(_OUT_SIGMAS * spread), np.float32(_OUT_PX)
    least, one = np.float32(1e-3), np.float32(1.0)
    total_slope = np.float32(0.0)
    for n in range(samples.shape[1]):
        total_slope += abs(samples[1, n]) + abs(samples[2, n])
    steep = max(np.float32(_STEEP) * total_slope / np.float32(max(samples.shape[1], 1)), least)
    for n in range(samples.shape[1]):
        d, u, v = samples[0, n], samples[1, n], samples[2, n]
        if abs(d) > most + far * (abs(u) + abs(v)):
            n_out += 1
        lever = min(one, steep / max(abs(u) + abs(v), least))
        w = min(one, limit / max(abs(d), least)) * lever * lever
        p = parts[int(samples[5, n])]
        wu, wv, wd = w * u, w * v, w * d
        out[p, 0] += one
        out[p, 1] += w
        out[p, 2] += wu
        out[p, 3] += wv
        out[p, 4] += wu * u
        out[p, 5] += wu * v
        out[p, 6] += wv * v
        out[p, 7] += wd
        out[p, 8] += wd * u
        out[p, 9] += wd * v
        t = u * samples[4, n] - v * samples[3, n]
        whole[0, 2] += wu * t
        whole[1, 2] += wv * t
        whole[2, 2] += w * t * t
        whole[2, 3] -= wd * t
    for p in range(out.shape[0]):
        whole[0, 0], whole[0, 1], whole[1, 1] = (
            whole[0, 0] + out[p, 4],
            whole[0, 1] + out[p, 5],
            whole[1, 1] + out[p, 6],
        )
        whole[0, 3], whole[1, 3] = whole[0, 3] - out[p, 8], whole[1, 3] - out[p, 9]
    whole[1, 0], whole[2, 0], whole[2, 1] = whole[0, 1], whole[0, 2], whole[1, 2]
    return out, whole, n_out


@kernel
def _decide(
    parts: Floats, whole: Floats, spread: float, part_px: tuple[float, float]
) -> tuple[float, float, float, float, float]:
    """Return change of light, shift, turn, sigma of the turn [rad] and shift of a part, as `Audit` has them.

    Parts are `part_px` wide and high.
    """
    (u, v, angle), (u_var, v_var, turn_var) = solve_symmetric(
        (whole[0, 0] + 1.0, whole[0, 1], whole[0, 2], whole[1, 1] + 1.0, whole[1, 2], whole[2, 2] + 1.0),
        (whole[0, 3], whole[1, 3], whole[2, 3]),
    )
    own_px, turn_sigma = spread * math.sqrt(u_var + v_var), spread * math.sqrt(turn_var)
    shift = math.hypot(u, v) / (own_px + _MOST_SHIFT_PX / _SIGMAS)
    turn = abs(angle) / (turn_sigma + _MOST_TURN_RAD / _SIGMAS)
    light, n_voting = 0.0, 0
    us, vs, own = np.empty(len(parts)), np.empty(len(parts)), np.empty(len(parts))
    xs, ys, half = np.empty(len(parts)), np.empty(len(parts)), (N_SIDE - 1) / 2.0
    for p in range(len(parts)):
        sums = parts[p]
        if sums[0] < _LEAST_PIXELS:
            continue
        solved, variances = solve_symmetric(
            (sums[1] + 1e-3, sums[2], sums[3], sums[4] + 1.0, sums[5], sums[6] + 1.0), (sums[7], sums[8], sums[9])
        )
        light = max(light, abs(solved[0]) / spread)
        us[n_voting], vs[n_voting] = -solved[1], -solved[2]
        xs[n_voting], ys[n_voting] = (p % N_SIDE - half) * part_px[0], (p // N_SIDE - half) * part_px[1]
        own[n_voting] = spread * math.sqrt(variances[1] + variances[2])
        n_voting += 1
    us, vs, own = us[:n_voting], vs[:n_voting], own[:n_voting]
    return light, shift, turn, turn_sigma, _stray(us, vs, own, xs[:n_voting], ys[:n_voting])


@kernel
def _stray(us: Floats, vs: Floats, own: Floats, xs: Floats, ys: Floats) -> float:
    """Return the largest shift of a part against the others, over its own standard deviation.

    A camera that heaves sees all parts move away from the centre, or towards it: by how much, the others tell of each.

    Parameters
    ----------
    us, vs : (n,) float64
        Shift of each part along u and v [px].
    own : (n,) float64
        Standard deviation of that shift [px].
    xs, ys : (n,) float64
        Middle of each part, from the centre of the picture [px].
    """
    if not len(us):
        return 0.0
    middle_u, middle_v, middle_x, middle_y = median_of(us), median_of(vs), median_of(xs), median_of(ys)
    outwards, squares = 0.0, 0.0
    for p in range(len(us)):
        x, y, sigma = xs[p] - middle_x, ys[p] - middle_y, own[p] + _LEAST_OWN_PX
        outwards += (x * (us[p] - middle_u) + y * (vs[p] - middle_v)) / sigma**2
        squares += (x * x + y * y) / sigma**2
    stray = 0.0
    for p in range(len(us)):
        u, v, sigma = us[p] - middle_u, vs[p] - middle_v, own[p] + _LEAST_OWN_PX
        x, y = xs[p] - middle_x, ys[p] - middle_y
        zoom, without = 0.0, squares - (x * x + y * y) / sigma**2
        if len(us) > _LEAST_OTHERS and without > 0.0:
            zoom = (outwards - (x * u + y * v) / sigma**2) / without
            zoom = min(max(zoom, -_MOST_ZOOM), _MOST_ZOOM)
        stray = max(stray, math.hypot(u - zoom * x, v - zoom * y) / sigma)
    return stray
