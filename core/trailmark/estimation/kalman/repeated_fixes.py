"""Poses that one localizer repeats to the last bit while motion says that base moves: frozen, and not used.

No reading of a moving base is the same twice but for its resolution. So the way by motion since the first of equal
poses is compared with what the localizer states, once for each motion that is believed: all of them must say that it
is clearly longer. A frozen pose agrees with itself, and so it would outvote any motion that it is asked about.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.diagnosis import MotionSum, RepeatedPose
from trailmark.estimation.kalman.gate import NOTHING_BESIDE, SHARE_UNDECIDED
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.state import FilterState, Gaussian, Verdict
from trailmark.estimation.kalman.windows import without_windows
from trailmark.geometry import Pose2, wrap_angle

__all__ = [
    "FROZEN",
    "MOVES_ALONE",
    "covariance_of_frozen",
    "frozen_sources",
    "remembered",
    "with_frozen_kept_out",
    "with_repetition",
]

FROZEN = "repeats one pose while base moves: frozen"
MOVES_ALONE = "its motion alone says that base moves, while absolute estimates repeat one pose: the belief covers both"

# By how many standard deviations of the localizer and of motion the way must exceed one pose: what is rounded to steps
# of three and a half of its own, as it would be if the error were that of rounding, is equal over one step.
_SIGMAS = 5.0
# What is slower since the first of equal poses is drift of a motion at rest, not a way [m/s, rad/s].
_REST_MPS, _REST_RADPS = 0.01, math.radians(0.5)
# A direction that no motion has measured [m^2, rad^2].
_OPEN = 1e6


def with_repetition(state: FilterState, measurement: Measurement) -> tuple[FilterState, RepeatedPose | None]:
    """Return a state that may hear of an absolute estimate, and the pose that it repeats.

    Parameters
    ----------
    state : FilterState
        Before the estimate.
    measurement : Measurement
        The estimate.

    Returns
    -------
    (FilterState, RepeatedPose or None)
        None if it repeats nothing. A state in which its localizer was frozen until now covers the frozen pose.
    """
    before = state.diagnosis.repeated.get(measurement.source)
    if before is None or state.gaussian is None:
        return state, None
    if before.said != measurement.said:
        return (_thawed(state, before) if before.is_frozen else state), None
    if before.is_frozen:
        return state, before
    if state.diagnosis.faults or state.diagnosis.undecided_since_s < math.inf:
        return state, before  # motions of which one is doubted are no witnesses: each may be what the other says of it
    ways = _ways_since(state, before)
    if not ways or min(_sigmas_of(way, state, measurement) for way in ways) < _SIGMAS:
        return state, before
    return state, before._replace(is_frozen=True)


def remembered(state: FilterState, measurement: Measurement, repeats: RepeatedPose | None) -> FilterState:
    """Return a state after an absolute estimate was used, which remembers what it said and where base was."""
    if state.gaussian is None or measurement.path is not None:
        return state
    diagnosis, elapsed_s = state.diagnosis, 0.0 if repeats is None else state.stamp_s - repeats.since_s
    if repeats is not None and not _is_at_rest(state, repeats, elapsed_s):
        now = repeats
    else:
        pose = Pose2(*state.gaussian.x[:3].tolist())
        now = RepeatedPose(measurement.said, state.stamp_s, state.odometry.pose_odom_base, pose, diagnosis.sums)
    return state.with_diagnosis(diagnosis.with_repeated({**diagnosis.repeated, measurement.source: now}))


def with_frozen_kept_out(state: FilterState, measurement: Measurement, repeats: RepeatedPose) -> FilterState:
    """Return the state after a frozen pose: it and the same before it speak against nobody.

    When that is found, the belief is made less certain by how far they have pulled it.
    """
    source, diagnosis, rejections = measurement.source, state.diagnosis, state.rejections
    if not diagnosis.repeated[source].is_frozen:
        assert state.gaussian is not None
        led = repeats.pose @ repeats.pose_odom_base.between(state.odometry.pose_odom_base)
        pulled = _difference(led, state.gaussian.x)
        if diagnosis.undecided_since_s == math.inf or diagnosis.undecided_since_s >= repeats.since_s:
            diagnosis = without_windows(diagnosis)
        faults = {name: one for name, one in diagnosis.faults.items() if one.since_s < repeats.since_s}
        repeated = {**diagnosis.repeated, source: repeats}
        state = replace(
            _widened(state, np.outer(pulled, pulled)),
            diagnosis=diagnosis._replace(repeated=repeated, faults=faults),
            rejections=replace(
                rejections,
                counts={name: n for name, n in rejections.counts.items() if name != source},
                measurements={name: some for name, some in rejections.measurements.items() if name != source},
                shares={name: share for name, share in rejections.shares.items() if name != source},
            ),
        )
    verdict = Verdict("gated", None, len(measurement.root), FROZEN)
    return replace(state, verdicts=(*state.verdicts, verdict))


def frozen_sources(state: FilterState) -> Mapping[str, bool]:
    """Return the localizers that are frozen, and whether one motion alone says so."""
    return {
        source: _rests_on_one(state, source, one) for source, one in state.diagnosis.repeated.items() if one.is_frozen
    }


def covariance_of_frozen(state: FilterState, gaussian: Gaussian) -> Floats:
    """Return what covers the poses that are repeated, (3, 3), where one motion alone says that base moves."""
    covariance = NOTHING_BESIDE
    for source, is_alone in frozen_sources(state).items():
        if is_alone:
            away = _difference(state.diagnosis.repeated[source].pose, gaussian.x)
            covariance = covariance + SHARE_UNDECIDED * np.outer(away, away)
    return covariance


def _ways_since(state: FilterState, repeats: RepeatedPose) -> list[MotionSum]:
    """Return what each motion that measured the way, and was believed at first, says of it."""
    elapsed_s, diagnosis = state.stamp_s - repeats.since_s, state.diagnosis
    ways = []
    for source, now in diagnosis.sums.items():
        fault = diagnosis.faults.get(source)
        if fault is not None and fault.since_s < repeats.since_s:
            continue
        way = MotionSum._make(b - a for a, b in zip(repeats.sums.get(source) or MotionSum(), now))
        if way.open_ways == 0 and way.covered_s > 0.5 * elapsed_s:
            ways.append(way)
    return ways


def _sigmas_of(way: MotionSum, state: FilterState, measurement: Measurement) -> float:
    """Return by how many standard deviations of both an equal pose contradicts a way."""
    assert state.gaussian is not None
    turn = float(state.gaussian.x[2]) - state.odometry.pose_odom_base.theta
    cos, sin = math.cos(turn), math.sin(turn)
    moved = np.array([cos * way.x - sin * way.y, sin * way.x + cos * way.y, wrap_angle(way.turn)])
    root = measurement.root
    own = np.diag([way.position_m2, way.position_m2, _OPEN if way.open_turns else way.turn_rad2])
    away, spread = root @ moved, root @ own @ root.T + np.eye(len(root))
    return math.sqrt(float(away @ np.linalg.solve(spread, away)))


def _is_at_rest(state: FilterState, repeats: RepeatedPose, elapsed_s: float) -> bool:
    way = repeats.pose_odom_base.between(state.odometry.pose_odom_base)
    return math.hypot(way.x, way.y) < _REST_MPS * elapsed_s and abs(way.theta) < _REST_RADPS * elapsed_s


def _rests_on_one(state: FilterState, source: str, repeats: RepeatedPose) -> bool:
    """Return whether nobody but one motion says that base moves: neither another, nor another absolute estimate."""
    heard = state.rejections.corroborations
    is_confirmed = any(other != source and one.stamp_s > repeats.since_s for other, one in heard.items())
    return not is_confirmed and len(_ways_since(state, repeats)) < 2


def _thawed(state: FilterState, repeats: RepeatedPose) -> FilterState:
    """Return a state that may be where a pose was repeated, if that was a question: what comes next decides it."""
    assert state.gaussian is not None
    covariance = covariance_of_frozen(state, state.gaussian)
    diagnosis = state.diagnosis if state.diagnosis.rivals else without_windows(state.diagnosis)
    return _widened(state, covariance).with_diagnosis(diagnosis) if covariance.any() else state


def _widened(state: FilterState, by: Floats) -> FilterState:
    assert state.gaussian is not None
    covariance = state.gaussian.covariance.copy()
    covariance[:3, :3] += by
    return replace(state, gaussian=Gaussian(state.gaussian.x, covariance, state.gaussian.lasting))


def _difference(pose: Pose2, x: Floats) -> Floats:
    return np.array([pose.x - x[0], pose.y - x[1], wrap_angle(pose.theta - float(x[2]))])
