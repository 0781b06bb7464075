"""What a localizer says of the motion of base, as steps that follow each other."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np

from trailmark.arrays import Bools, Floats, Indices
from trailmark.errors import DataError
from trailmark.estimates import Estimate, Fix, Motion
from trailmark_calibration.rigid import adjoint_of, between, compose, exp_of, invert, log_of

__all__ = ["UNKNOWN_VARIANCE", "ComparedTrack", "track_of"]

#: Variance of what a localizer does not measure, and the least of what it does [m^2, rad^2].
UNKNOWN_VARIANCE, _LEAST_VARIANCE = 1e4, 1e-12
#: A longer step is no step but a gap; that of a slow localizer may have so many times its usual length [s].
_LONGEST_STEP_S, _LONGEST_STEPS = 1.5, 3.0
#: Stamps that are nearer than this are the same [s].
_SLACK_S = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class ComparedTrack:
    """Steps of base in the order of time, N of them; where one does not begin at the end of the last, there is a gap.

    Attributes
    ----------
    since_s, stamp_s : (N,) float64
        From and to [s].
    twists : (N, 3) float64
        Way forward, way to the left and turn of each, as constant twists [m, m, rad].
    covariances : (N, 3, 3) float64
        Of a small motion at the end of each step, in the axes of base there.
    """

    since_s: Floats
    stamp_s: Floats
    twists: Floats
    covariances: Floats

    def __len__(self) -> int:
        return len(self.stamp_s)

    @property
    def runs(self) -> Indices:
        """Number of the stretch without a gap in which each step lies, (N,)."""
        gaps = self.since_s[1:] - self.stamp_s[:-1] > _SLACK_S
        return np.concatenate([[0], np.cumsum(gaps)])

    @property
    def period_s(self) -> float:
        """Median length of a step [s]."""
        return float(np.median(self.stamp_s - self.since_s))

    @property
    def measures_way(self) -> bool:
        """Whether most of the steps measure a way, and not the turn alone."""
        return bool(np.median(self.covariances[:, 0, 0] + self.covariances[:, 1, 1]) < 0.01 * UNKNOWN_VARIANCE)

    def transform_twists(self, matrix: Floats) -> Self:
        """Return the track with every twist multiplied by a (3, 3) matrix."""
        return type(self)(self.since_s, self.stamp_s, self.twists @ matrix.T, self.covariances)

    def seen_from(self, pose: Floats) -> Self:
        """Return the track of another point of the body, which sits at `pose` (3,) on base."""
        to_sensor = adjoint_of(invert(pose))
        return type(self)(
            self.since_s, self.stamp_s, self.twists @ to_sensor.T, to_sensor @ self.covariances @ to_sensor.T
        )

    def motions(self, from_s: Floats, to_s: Floats) -> Floats:
        """Return relative poses over intervals, (M, 3); NaN where the track does not cover one without a gap."""
        ends = np.concatenate([np.zeros((1, 3)), _chain(exp_of(self.twists))])
        start, first, is_in_first = self._at(from_s, ends, is_beginning=True)
        stop, last, is_in_last = self._at(to_s, ends, is_beginning=False)
        runs = self.runs
        is_whole = is_in_first & is_in_last & (runs[first] == runs[last])
        return np.where(is_whole[:, None], between(start, stop), np.nan)

    def rates(self, at_s: Floats) -> Floats:
        """Return twists per second at instants, (M, 3), the mean of the steps before and after; 0 where unknown."""
        rates = self.twists / (self.stamp_s - self.since_s)[:, None]
        _, before, is_before = self._at(at_s, None, is_beginning=False)
        _, after, is_after = self._at(at_s, None, is_beginning=True)
        return np.asarray(
            0.5 * (np.where(is_before[:, None], rates[before], 0.0) + np.where(is_after[:, None], rates[after], 0.0))
        )

    def reading_errors(self, at_s: Floats) -> Floats:
        """Return how wrong a reading between two stamps may be, one sigma, (M, 3) [m, m, rad]; nothing at a stamp.

        A step is read as if its rates were constant. Where they change evenly by ``c`` over a step of length ``h``, a
        reading at its share ``s`` is off by ``s (1 - s) h c / 2``, and by up to ``s (1 - s) h c`` where they leap. What
        changes from the step before and what changes to the step after are added as squares, and both twice: errors of
        neighbouring intervals go together, and delays came out too sure.
        """
        lengths_s = self.stamp_s - self.since_s
        rates = self.twists / lengths_s[:, None]
        is_joined = np.diff(self.runs) == 0
        leaps = np.where(is_joined[:, None], np.diff(rates, axis=0), 0.0)
        none = np.zeros((1, 3))
        changes = np.hypot(np.concatenate([none, leaps]), np.concatenate([leaps, none]))
        _, index, _ = self._at(at_s, None, is_beginning=True)
        shares = np.clip((at_s - self.since_s[index]) / lengths_s[index], 0.0, 1.0)
        return np.asarray(math.sqrt(0.5) * (shares * (1.0 - shares) * lengths_s[index])[:, None] * changes[index])

    def interval_covariances(self, from_s: Floats, to_s: Floats) -> Floats:
        """Return the covariance of the motion over each interval at its end, (M, 3, 3)."""
        ends = _chain(exp_of(self.twists))
        found = np.empty((len(from_s), 3, 3))
        for index, (start_s, end_s) in enumerate(zip(from_s.tolist(), to_s.tolist())):
            part = slice(np.searchsorted(self.stamp_s, start_s, "right"), np.searchsorted(self.since_s, end_s, "left"))
            low, high = np.maximum(self.since_s[part], start_s), np.minimum(self.stamp_s[part], end_s)
            shares = np.clip((high - low) / (self.stamp_s[part] - self.since_s[part]), 0.0, 1.0)
            carried = adjoint_of(between(ends[part][-1:], ends[part])) if len(shares) else np.zeros((0, 3, 3))
            found[index] = np.einsum("n,nij,njk,nlk->il", shares, carried, self.covariances[part], carried)
        return found

    def _at(self, at_s: Floats, ends: Floats | None, *, is_beginning: bool) -> tuple[Floats, Indices, Bools]:
        """Return the pose at instants, the step in which each lies, and whether it does lie in one."""
        if is_beginning:
            index = np.searchsorted(self.stamp_s, at_s + _SLACK_S, "right")
        else:
            index = np.searchsorted(self.since_s, at_s - _SLACK_S, "left") - 1
        index = np.clip(index, 0, len(self) - 1)
        share = (at_s - self.since_s[index]) / (self.stamp_s[index] - self.since_s[index])
        slack = _SLACK_S / (self.stamp_s[index] - self.since_s[index])
        is_inside = (share >= -2.0 * slack) & (share <= 1.0 + 2.0 * slack)
        if ends is None:
            return np.empty(0), index, is_inside
        return compose(ends[index], exp_of(share[:, None] * self.twists[index])), index, is_inside


def track_of(name: str, estimates: Iterable[Estimate]) -> ComparedTrack:
    """Return the track of what a localizer said: its motions, or, where it gives none, from fix to fix.

    Parameters
    ----------
    name : str
        Of the localizer, for messages.
    estimates : iterable of Estimate
        In any order.

    Raises
    ------
    DataError
        If it said nothing that tells a motion.
    """
    said = sorted(estimates, key=lambda estimate: estimate.stamp_s)
    motions = [one for one in said if isinstance(one, Motion) and _is_finite(one.information)]
    if motions:
        return _track(_without_overlaps(motions))
    fixes = [one for one in said if isinstance(one, Fix) and _measures_all(one.information)]
    steps = [_step_between(a, b) for a, b in pairwise(fixes) if b.stamp_s > a.stamp_s]
    if not steps:
        kinds = ", ".join(sorted({type(one).__name__ for one in said})) or "nothing"
        raise DataError(f"{name!r} tells no motion on this drive: neither Motion nor whole Fixes, but {kinds}")
    return _track(steps)


def _is_finite(information: Floats) -> bool:
    return bool(np.isfinite(information).all())


def _measures_all(information: Floats) -> bool:
    return _is_finite(information) and float(np.linalg.eigvalsh(information)[0]) > 1.0 / UNKNOWN_VARIANCE


def _without_overlaps(motions: Sequence[Motion]) -> list[Motion]:
    """Leave out what begins before the last one ended: it would count twice."""
    kept: list[Motion] = []
    for motion in motions:
        if not kept or motion.since_s >= kept[-1].stamp_s - _SLACK_S:
            kept.append(motion)
    return kept


def _step_between(a: Fix, b: Fix) -> Motion:
    """Return the motion from fix to fix, with the error of both: turned into the axes of the first."""
    step = a.pose_map_base.between(b.pose_map_base)
    cov = np.linalg.inv(a.information) + np.linalg.inv(b.information)
    cos, sin = np.cos(a.pose_map_base.theta), np.sin(a.pose_map_base.theta)
    R = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return Motion(a.stamp_s, b.stamp_s, step, np.linalg.inv(R @ cov @ R.T))


def _track(motions: Sequence[Motion]) -> ComparedTrack:
    lengths_s = np.array([motion.stamp_s - motion.since_s for motion in motions])
    longest_s = max(_LONGEST_STEP_S, _LONGEST_STEPS * float(np.median(lengths_s)))
    motions = [motion for motion, length_s in zip(motions, lengths_s) if length_s <= longest_s]
    poses = np.array([motion.pose_since_now.array() for motion in motions])
    values, vectors = np.linalg.eigh(np.array([motion.information for motion in motions]))
    variances = 1.0 / np.clip(values, 1.0 / UNKNOWN_VARIANCE, 1.0 / _LEAST_VARIANCE)
    in_since = vectors * variances[:, None, :] @ vectors.transpose(0, 2, 1)
    turned = np.zeros_like(poses)
    turned[:, 2] = -poses[:, 2]
    to_end = adjoint_of(turned)
    return ComparedTrack(
        since_s=np.array([motion.since_s for motion in motions]),
        stamp_s=np.array([motion.stamp_s for motion in motions]),
        twists=log_of(poses),
        covariances=to_end @ in_since @ to_end.transpose(0, 2, 1),
    )


def _chain(steps: Floats) -> Floats:
    """Return the pose after every step, (N, 3), the heading not wrapped on the way."""
    heading = np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    cos, sin = np.cos(heading[:-1]), np.sin(heading[:-1])
    x = np.cumsum(cos * steps[:, 0] - sin * steps[:, 1])
    y = np.cumsum(sin * steps[:, 0] + cos * steps[:, 1])
    return np.stack([x, y, heading[1:]], axis=1)
