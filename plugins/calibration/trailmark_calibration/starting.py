"""Where the fit starts: the delay by cross-correlation of turn rates, the rest in closed form."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import DataError
from trailmark_calibration.hand_eye import solve_hand_eye_and_scale
from trailmark_calibration.model import DELAY, LEAST_SCALE, NEUTRAL, TURN, WAY, YAW, MotionPairs, X, Y
from trailmark_calibration.tracks import ComparedTrack

__all__ = ["correlated_delay", "delay_peaks", "do_turns_agree", "starting_point"]

_SAMPLE_S = 0.01
#: A second peak so high beside the first, and a first peak so low, tell nothing.
_RIVAL, _LEAST_PEAK = 0.9, 0.5
#: Share of intervals that the closed form keeps: those that fit it best.
_KEPT = 0.7


def correlated_delay(a: ComparedTrack, b: ComparedTrack, longest_s: float) -> float | None:
    """Return by how much the stamps of `a` are later than those of `b`, from turn rates, between two samples too.

    The highest cross-correlation of either sign, and the top of the parabola through it and its neighbours.

    Parameters
    ----------
    a, b : ComparedTrack
        Of the same body.
    longest_s : float
        No longer delay is looked for [s].

    Returns
    -------
    float or None
        None where no peak stands out: the drive does not turn, or always in the same way [s].
    """
    heights, n_lags = _correlation(a, b, longest_s)
    if not len(heights):
        return None
    top = int(np.argmax(heights))
    if not 0 < top < len(heights) - 1 or heights[top] < _LEAST_PEAK or _has_rival(heights, top):
        return None
    left, here, right = heights[top - 1 : top + 2]
    curve = left - 2.0 * here + right
    between = 0.0 if curve >= 0.0 else 0.5 * float(left - right) / float(curve)
    return (top - n_lags + between) * _SAMPLE_S


def delay_peaks(a: ComparedTrack, b: ComparedTrack, longest_s: float) -> tuple[list[float], float]:
    """Return all delays at which turn rates correlate, with either sign, the highest peak first; and the width of it.

    Parameters
    ----------
    a, b : ComparedTrack
        Of the same body.
    longest_s : float
        No longer delay is looked for [s].

    Returns
    -------
    peaks_s : list of float
        Those at least half as high as the highest; empty without any [s].
    width_s : float
        Half the width of the highest at half its height: nearer peaks are the same [s].
    """
    heights, n_lags = _correlation(a, b, longest_s)
    if len(heights) < 3:
        return [], 0.0
    is_peak = (heights[1:-1] >= heights[:-2]) & (heights[1:-1] > heights[2:])
    tops = np.flatnonzero(is_peak & (heights[1:-1] > 0.5 * heights.max())) + 1
    tops = tops[np.argsort(-heights[tops])]
    if not len(tops):
        return [], 0.0
    low = np.flatnonzero(heights < 0.5 * heights[tops[0]])
    width = int(np.abs(low - tops[0]).min()) if len(low) else 1
    return ((tops - n_lags) * _SAMPLE_S).tolist(), width * _SAMPLE_S


def do_turns_agree(a: ComparedTrack, b: ComparedTrack, longest_s: float) -> bool:
    """Return whether turn rates correlate at any delay, so that they are no noise."""
    heights, _ = _correlation(a, b, longest_s)
    return bool(len(heights)) and float(heights.max()) >= _LEAST_PEAK


def _correlation(a: ComparedTrack, b: ComparedTrack, longest_s: float) -> tuple[Floats, int]:
    """Return how much turn rates agree, or contradict, at every delay, and the number of delays below 0."""
    start_s, stop_s = max(a.since_s[0], b.since_s[0]), min(a.stamp_s[-1], b.stamp_s[-1])
    n_lags = round(longest_s / _SAMPLE_S)
    grid_s = np.arange(start_s - longest_s, stop_s + longest_s, _SAMPLE_S)
    if stop_s - start_s < 4.0 * longest_s:
        return np.empty(0), n_lags
    first, second = (_clip_rates(track.rates(grid_s)[:, 2]) for track in (a, b))
    n = 1 << (2 * len(grid_s)).bit_length()
    product = np.fft.irfft(np.fft.rfft(first, n) * np.conj(np.fft.rfft(second, n)), n)
    lags = np.concatenate([product[-n_lags:], product[: n_lags + 1]])
    size = math.sqrt(float(first @ first) * float(second @ second))
    if size == 0.0:
        return np.empty(0), n_lags
    return np.asarray(np.abs(lags) / size), n_lags


def _clip_rates(rates: Floats) -> Floats:
    """Return rates without leaps: a single wrong motion must not make the peak."""
    turning = np.abs(rates[rates != 0.0])
    return rates if not len(turning) else np.clip(rates, *(np.array([-3.0, 3.0]) * np.quantile(turning, 0.9)))


def _has_rival(heights: Floats, top: int) -> bool:
    """Return whether another peak is nearly as high: outside of the valley about the highest."""
    low = top
    while low > 0 and heights[low - 1] <= heights[low]:
        low -= 1
    high = top
    while high < len(heights) - 1 and heights[high + 1] <= heights[high]:
        high += 1
    rest = np.concatenate([heights[:low], heights[high + 1 :]])
    return bool(len(rest)) and float(rest.max()) > _RIVAL * float(heights[top])


def starting_point(pairs: MotionPairs, known: Floats, delay_s: float) -> Floats:
    """Return numbers near which the fit starts: turns first, then place and way together (8,).

    Parameters
    ----------
    pairs : MotionPairs
        The motions.
    known : (3,) float64
        Place of the sensor by the config: for what the drive does not tell [m, m, rad].
    delay_s : float
        Of a [s].
    """
    p = NEUTRAL.copy()
    p[[X, Y, YAW]], p[DELAY] = known, delay_s
    base, sensor = pairs.motions(p, is_corrected=False)
    rows = np.isfinite(base).all(axis=1) & np.isfinite(sensor).all(axis=1)
    base, sensor = base[rows], sensor[rows]
    if not len(base):
        return p
    does_turn = _agrees(base[:, 2], sensor[:, 2])
    p[TURN] = _away_from_nothing(_slope(base[:, 2], sensor[:, 2])) if does_turn else 1.0
    if not (pairs.a.measures_way and pairs.b.measures_way):
        return p
    if p[TURN] < 0.0:  # ways bend to the other side
        base = pairs.motions(p)[0][rows]
    kept = np.ones(len(base), dtype=bool)
    for _ in range(4):
        p[[X, Y, YAW, WAY]] = _mounting_of_least_error(base[kept], sensor[kept], known, does_turn)
        trial = p.copy()
        trial[DELAY] = delay_s
        off = np.hypot(*pairs.residuals(trial)[rows][:, :2].T)
        kept = off <= np.quantile(off, _KEPT)
    p[WAY] = _away_from_nothing(p[WAY])
    return p


def _away_from_nothing(scale: float) -> float:
    return math.copysign(max(abs(scale), 2.0 * LEAST_SCALE), scale)


def _agrees(a: Floats, b: Floats) -> bool:
    """Return whether two kinds of turn go together, or against each other, and are no noise."""
    a, b = (np.clip(turns, *np.quantile(turns, [0.02, 0.98])) for turns in (a, b))
    size = math.sqrt(float(a @ a) * float(b @ b))
    return size > 0.0 and abs(float(a @ b)) > _LEAST_PEAK * size


def _slope(a: Floats, b: Floats) -> float:
    """Return the factor from a to b that most of the large turns agree with; 1 without any."""
    large = np.abs(a) > max(0.5 * float(np.quantile(np.abs(a), 0.9)), 1e-3)
    return float(np.median(b[large] / a[large])) if large.any() else 1.0


def _mounting_of_least_error(base: Floats, sensor: Floats, known: Floats, does_turn: bool) -> Floats:
    """Return x, y, yaw and the scale of the way; without turns, direction and length of the ways are left."""
    if does_turn:
        with suppress(DataError):
            pose, scale = solve_hand_eye_and_scale(base, sensor)
            if scale > 0.1 and math.hypot(pose.x, pose.y) < 5.0:
                return np.array([pose.x, pose.y, pose.theta, scale])
    ways_base, ways_sensor = (motions[:, 0] + 1j * motions[:, 1] for motions in (base, sensor))
    common = complex(np.vdot(ways_sensor, ways_base))
    length = float(np.sum(np.abs(ways_base) ** 2))
    return np.array([*known[:2], np.angle(common), abs(common) / length if length else 1.0])
