"""How the motions of two localizers belong together: eight numbers, and what they predict.

``a`` moves base and may be wrong by two scales and a bend; ``b`` moves a sensor that sits at ``X`` on base and whose
stamps may be off. Over the same interval, with ``K`` the correction of a's twists,
``a(from + delay, to + delay) K  X = X  b(from, to)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.errors import DataError
from trailmark_calibration.rigid import adjoint_of, compose, exp_of, invert, log_of
from trailmark_calibration.tracks import ComparedTrack

__all__ = [
    "BIAS",
    "DELAY",
    "LEAST_SCALE",
    "NAMES",
    "NEUTRAL",
    "TURN",
    "TURN_PER_M",
    "WAY",
    "YAW",
    "MotionPairs",
    "X",
    "Y",
    "pairs_of",
]

#: The numbers, in the order of every vector of them.
NAMES = ("way", "turn", "turn_per_m", "x", "y", "yaw", "delay", "bias")
WAY, TURN, TURN_PER_M, X, Y, YAW, DELAY, BIAS = range(len(NAMES))
#: Nothing is wrong: factors of way and turn, turn per way [rad/m], place of the sensor [m, m, rad], delay [s], and the
#: rate that b shows at rest [rad/s].
NEUTRAL = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])

#: A scale nearer to nothing is no wheel: with none at all, what a should have said cannot be told from b.
LEAST_SCALE = 0.01
#: Less motion than this in an interval is standing still [m, rad].
_REST_M, _REST_RAD = 0.005, math.radians(0.3)
#: Fewer intervals tell nothing.
_LEAST_PAIRS = 20
_STEP = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class MotionPairs:
    """Two tracks over the same M intervals.

    Attributes
    ----------
    a, b : ComparedTrack
        Of base, and of the sensor in its own axes.
    from_s, to_s : (M,) float64
        The intervals, by the stamps of the slower one [s].
    a_is_slower : bool
        Whose stamps those are; the other one is read between its own.
    covariances_a, covariances_b : (M, 3, 3) float64
        As stated.
    track_m : float or None
        Distance of the wheels; None: not known [m].
    """

    a: ComparedTrack
    b: ComparedTrack
    from_s: Floats
    to_s: Floats
    a_is_slower: bool
    covariances_a: Floats
    covariances_b: Floats
    track_m: float | None = None

    def __len__(self) -> int:
        return len(self.from_s)

    def where(self, rows: Bools) -> MotionPairs:
        """Return some of the intervals."""
        parts = {name: getattr(self, name)[rows] for name in ("from_s", "to_s", "covariances_a", "covariances_b")}
        return replace(self, **parts)

    def matrix(self, p: Floats) -> Floats:
        """Return the (3, 3) correction of a's twists."""
        bend = p[TURN_PER_M]
        # Wheels of two sizes, whose distance is known: what bends straight ways adds way to turns.
        way_per_turn = 0.0 if self.track_m is None else self.track_m**2 * p[WAY] * bend / (4.0 * p[TURN])
        return np.array([[p[WAY], 0.0, way_per_turn], [0.0, p[WAY], 0.0], [bend, 0.0, p[TURN]]])

    def motions(self, p: Floats, *, is_corrected: bool = True) -> tuple[Floats, Floats]:
        """Return the motions of base by a, and of the sensor by b, over every interval; NaN where not known."""
        a = self.a.transform_twists(self.matrix(p)) if is_corrected else self.a
        shift_a, shift_b = (0.0, -p[DELAY]) if self.a_is_slower else (p[DELAY], 0.0)
        return (
            a.motions(self.from_s + shift_a, self.to_s + shift_a),
            self.b.motions(self.from_s + shift_b, self.to_s + shift_b),
        )

    def residuals(self, p: Floats) -> Floats:
        """Return what b says beyond what a predicts, as a small motion of the sensor at the end, (M, 3)."""
        base, sensor = self.motions(p)
        mounting = p[[X, Y, YAW]]
        predicted = compose(compose(invert(mounting), base), mounting)
        off = log_of(compose(invert(predicted), sensor))
        off[:, 2] -= p[BIAS] * (self.to_s - self.from_s)
        return off

    def reading_covariances(self, p: Floats) -> Floats:
        """Return the covariance of what is left that comes of reading one track between its stamps, (M, 3, 3).

        It is of the motion of the sensor at the end of each interval, and no factor of the stated noise.
        """
        base, sensor = self.motions(p)
        if self.a_is_slower:
            read, shift_s, moved, gain = self.b, -p[DELAY], sensor, np.eye(3)
        else:
            read, shift_s, moved, gain = self.a, p[DELAY], base, self.gain(p)
        total = np.zeros((len(self), 3, 3))
        carried = gain @ adjoint_of(invert(moved))  # what is off at the beginning, seen from the end
        for at_s, carry in ((self.from_s, np.nan_to_num(carried)), (self.to_s, gain)):
            off = carry * read.reading_errors(at_s + shift_s)[:, None, :]
            total += off @ off.transpose(0, 2, 1)
        return total

    def gain(self, p: Floats) -> Floats:
        """Return (3, 3): how a small motion of base by a moves what is predicted for the sensor."""
        return np.asarray(adjoint_of(invert(p[[X, Y, YAW]])) @ self.matrix(p))

    def sensitivities(self, p: Floats, base: Floats, rates_of_a: bool | None = None) -> Floats:
        """Return how the prediction changes with every number, (M, 3, 8), where a should have said `base` (M, 3).

        Parameters
        ----------
        p : (8,) float64
            The numbers.
        base : (M, 3) float64
            Uncorrected motions.
        rates_of_a : bool, optional
            Whose rates tell what a delay does; None: both.
        """
        twists = log_of(base)
        back = invert(_predict_motions(p, self.matrix(p), twists))
        columns = []
        for index in range(YAW + 1):
            moved = p.copy()
            moved[index] += _STEP
            columns.append(log_of(compose(back, _predict_motions(moved, self.matrix(moved), twists))) / _STEP)
        whose = (True, False) if rates_of_a is None else (rates_of_a,)
        columns.append(np.mean([self._by_delay(p, back, is_a) for is_a in whose], axis=0))
        columns.append(np.stack([0.0 * self.to_s, 0.0 * self.to_s, self.to_s - self.from_s], axis=1))
        return np.stack(columns, axis=2)

    def motions_of_a(self, p: Floats, sensor: Floats) -> Floats:
        """Return what a should have said if the sensor moved as given, (M, 3)."""
        mounting = p[[X, Y, YAW]]
        twists = log_of(compose(compose(mounting, sensor), invert(mounting)))
        return exp_of(twists @ np.linalg.inv(self.matrix(p)).T)

    def _by_delay(self, p: Floats, back: Floats, is_a: bool) -> Floats:
        """Return how a delay of one second changes the prediction: base has gone on at both ends."""
        rates = []
        for at_s in (self.from_s, self.to_s):
            if is_a:
                shift = 0.0 if self.a_is_slower else p[DELAY]
                rates.append(self.a.rates(at_s + shift) @ self.gain(p).T)
            else:
                rates.append(self.b.rates(at_s - (p[DELAY] if self.a_is_slower else 0.0)))
        begun = np.einsum("nij,nj->ni", adjoint_of(back), rates[0])
        return np.asarray(rates[1] - begun)


def _predict_motions(p: Floats, matrix: Floats, twists: Floats) -> Floats:
    mounting = p[[X, Y, YAW]]
    return compose(compose(invert(mounting), exp_of(twists @ matrix.T)), mounting)


def pairs_of(a: ComparedTrack, b: ComparedTrack, interval_s: float, track_m: float | None = None) -> MotionPairs:
    """Return the intervals in which at least one of two tracks moves and both are known.

    Parameters
    ----------
    a, b : ComparedTrack
        The two localizers' tracks.
    interval_s : float
        Length of an interval [s].
    track_m : float or None
        Distance of the wheels; None: not known [m].

    Returns
    -------
    MotionPairs
        Motions of both over the intervals.

    Raises
    ------
    DataError
        If there are too few of them.
    """
    slower = a if a.period_s > b.period_s else b
    knots_s = _knots(slower, interval_s)
    from_s, to_s = knots_s[:-1], knots_s[1:]
    moved_a, moved_b = a.motions(from_s, to_s), b.motions(from_s, to_s)
    is_known = np.isfinite(moved_a).all(axis=1) & np.isfinite(moved_b).all(axis=1)
    is_moving = _moves(moved_a, a.measures_way) | _moves(moved_b, b.measures_way)
    rows = is_known & is_moving
    if int(rows.sum()) < _LEAST_PAIRS:
        raise DataError(
            f"the drive is too short: {int(is_known.sum())} intervals of {interval_s:g} s in which both tell a motion,"
            f" the robot moves in {int(rows.sum())}; {_LEAST_PAIRS} are needed, some hundred are good"
        )
    from_s, to_s = from_s[rows], to_s[rows]
    of_a, of_b = (track.interval_covariances(from_s, to_s) for track in (a, b))
    return MotionPairs(a, b, from_s, to_s, slower is a, of_a, of_b, track_m)


def _knots(track: ComparedTrack, interval_s: float) -> Floats:
    """Return stamps of a track that are `interval_s` apart, or a step where that is longer."""
    knots = [float(track.since_s[0])]
    for since_s, stamp_s in zip(track.since_s.tolist(), track.stamp_s.tolist()):
        if since_s - knots[-1] > interval_s:  # behind a gap
            knots.append(since_s)
        if stamp_s - knots[-1] >= interval_s - 1e-3:
            knots.append(stamp_s)
    return np.array(knots)


def _moves(motions: Floats, measures_way: bool) -> Bools:
    turns = np.abs(motions[:, 2]) > _REST_RAD
    return np.asarray(turns | (np.hypot(motions[:, 0], motions[:, 1]) > _REST_M) if measures_way else turns)
