"""Motion that the absolute estimates of one localizer have overruled: the belief follows them, and covers both.

One motion against the fixes of one localizer is a question that nothing decides: a slipping wheel and fixes that stand
still say the same. The filter that believes no motion explains more, so the belief goes on with it; but where motion
leads stays in the covariance, for as long as it goes on to lead elsewhere. A second localizer whose absolute estimates
fit decides, as does a pose that is set. Once motion agrees again, or tells no way, the place where it had led is that
of a belief that was moved (`moved_belief`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.agreement import is_still, motion_since
from trailmark.estimation.kalman.diagnosis import MotionSum, OverruledMotion, RivalFilter
from trailmark.estimation.kalman.gate import NOTHING_BESIDE, SHARE_UNDECIDED, threshold
from trailmark.estimation.kalman.innovation import nis_of
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.moved_belief import LASTS_S, away_from
from trailmark.estimation.kalman.state import FilterState, Gaussian, MovedBelief
from trailmark.geometry import Pose2, wrap_angle

__all__ = ["covariance_of_overruled", "overruled_by", "still_overruled"]

_SAME = 0.999
_NO_SUM = MotionSum()


def overruled_by(state: FilterState, best: RivalFilter, rivals: Sequence[RivalFilter]) -> OverruledMotion | None:
    """Return where the motion leads that a question has overruled; as before it while some motion is believed still.

    Parameters
    ----------
    state : FilterState
        That goes on as a hypothesis says.
    best : RivalFilter
        This one.
    rivals : sequence of RivalFilter
        All of the question, now.
    """
    before, faults, begun = state.diagnosis, best.state.diagnosis.faults, best.begun
    if begun is None or begun.gaussian is None or len({one.source for _, one in before.measurements}) != 1:
        return before.overruled
    accused = [
        source
        for source, one in before.sums.items()
        if source not in before.faults and not _has_open_steps(one, begun.diagnosis.sums.get(source, _NO_SUM))
    ]
    if not accused or before.sums.keys() - faults.keys():
        return before.overruled
    if before.anchors and all(_stands(state, source) for source in accused):
        return before.overruled  # who stands still while others move is suspect: that decides
    believes = next((one.state for one in rivals if _believes(one, accused)), None)
    # Each filter adds up steps in the axes of its own odometry; from now on those of the one that is left go on.
    at, adds_up = (begun, begun) if believes is None else (believes, best.state)
    assert at.gaussian is not None
    source = min(accused, key=lambda one: adds_up.diagnosis.sums.get(one, _NO_SUM).position_m2)
    pose = Pose2(*at.gaussian.x[:3].tolist())
    said = adds_up.diagnosis.sums.get(source, _NO_SUM)
    from_there, fixes = (pose, at.gaussian.covariance[:3, :3], said), before.measurements[-1][1].source
    odom_rad = adds_up.odometry.pose_odom_base.theta
    overruled = OverruledMotion(source, fixes, begun.stamp_s, from_there, pose, said, odom_rad)
    # from now on these axes are those of the odometry that is published
    return _led_on(overruled, best.state)._replace(odom_rad=state.odometry.pose_odom_base.theta)


def _has_open_steps(now: MotionSum, then: MotionSum) -> bool:
    """Return whether a step in between has not measured the way: nothing is known of where it led."""
    return now.open_ways > then.open_ways


def _stands(state: FilterState, source: str) -> bool:
    motion = motion_since(state, state.diagnosis.anchors[-1], source)
    return motion is not None and is_still(motion)


def _believes(rival: RivalFilter, motions: Sequence[str]) -> bool:
    """Return whether a hypothesis believes motions against absolute estimates."""
    diagnosis = rival.state.diagnosis
    return (
        bool(diagnosis.absolute_faults) and diagnosis.faults.keys().isdisjoint(motions) and bool(rival.state.gaussian)
    )


def still_overruled(after: FilterState, measurement: Measurement) -> FilterState:
    """Return a state after an absolute estimate, with where the motion leads that was overruled, if that is open.

    Parameters
    ----------
    after : FilterState
        With the estimate.
    measurement : Measurement
        The estimate.
    """
    overruled = after.diagnosis.overruled
    if overruled is None or after.gaussian is None:
        return after
    led = _led_on(overruled, after)
    if measurement.source != overruled.fixes and after.verdicts[-1].status == "accepted":
        x = np.concatenate([led.pose.array(), after.gaussian.x[3:]])
        if nis_of(*measurement.innovation(x), after.gaussian.covariance) > threshold(_SAME, len(measurement.root)):
            return after.with_diagnosis(after.diagnosis._replace(overruled=None))
    if led.source in after.diagnosis.faults and not _has_open_steps(led.sums, led.begun[2]):
        return after.with_diagnosis(after.diagnosis._replace(overruled=led))
    return replace(
        after.with_diagnosis(after.diagnosis._replace(overruled=None)),
        rejections=replace(after.rejections, moved=after.rejections.moved or _moved_to(after, after.gaussian, led)),
    )


def _moved_to(state: FilterState, gaussian: Gaussian, led: OverruledMotion) -> MovedBelief | None:
    """Return where the motion had led, now that it agrees again or leads on no more.

    None where its noise explains how far that is off.
    """
    covariance, away = _covariance_of(led), away_from(gaussian, led.pose)
    if float(away @ np.linalg.solve(covariance + gaussian.covariance[:3, :3], away)) < threshold(_SAME, 3):
        return None
    covariance[2], covariance[:, 2] = 0.0, 0.0  # from now on its heading wanders no more
    shift = led.pose @ Pose2(*gaussian.x[:3].tolist()).inverse()
    # from now on, not from the question on, it counts less: however long that was, the place was covered until now
    lasts_s = min(state.stamp_s - led.since_s, LASTS_S)
    since_s = state.stamp_s - lasts_s
    return MovedBelief(led.fixes, since_s, state.stamp_s, shift, led.pose, covariance, led.source, lasts_s)


def covariance_of_overruled(state: FilterState, gaussian: Gaussian) -> Floats:
    """Return what covers where the motion leads, (3, 3), that one localizer has overruled or is about to."""
    led = _led_while_undecided(state.diagnosis.rivals)
    if led is None and state.diagnosis.overruled is not None:
        now = _led_on(state.diagnosis.overruled, state)
        led = now.pose, _covariance_of(now)
    if led is None:
        return NOTHING_BESIDE
    away = away_from(gaussian, led[0])
    return np.asarray(SHARE_UNDECIDED * (np.outer(away, away) + led[1]))


def _led_while_undecided(rivals: Sequence[RivalFilter]) -> tuple[Pose2, Floats] | None:
    """Return where the one motion leads of a question that nothing decides, and its covariance."""
    for rival in rivals:
        faults, gaussian = rival.state.diagnosis.absolute_faults, rival.state.gaussian
        if gaussian is not None and faults and not all(one.is_outvoted for one in faults.values()):
            return Pose2(*gaussian.x[:3].tolist()), gaussian.covariance[:3, :3]
    return None


def _covariance_of(led: OverruledMotion) -> Floats:
    """Return how uncertain it is where the motion leads, (3, 3): its heading wanders on the way."""
    (begun, covariance, then), now = led.begun, led.sums
    lever = np.eye(3)
    lever[:2, 2] = begun.y - led.pose.y, led.pose.x - begun.x
    position_m2, turn_rad2 = now.position_m2 - then.position_m2, now.turn_rad2 - then.turn_rad2
    return np.asarray(lever @ (covariance + np.diag([position_m2, position_m2, turn_rad2])) @ lever.T)


def _led_on(overruled: OverruledMotion, state: FilterState) -> OverruledMotion:
    """Return where motion has led until now.

    Its steps are added up in the axes of odometry, which may turn otherwise while nothing measures it: since the last
    time by half of what both differ by.
    """
    now, odom_rad = state.diagnosis.sums.get(overruled.source), state.odometry.pose_odom_base.theta
    if now is None:
        return overruled
    then = overruled.sums
    turn = now.turn - then.turn
    half = 0.5 * (turn - wrap_angle(odom_rad - overruled.odom_rad))
    cos, sin = math.cos(half - overruled.odom_rad), math.sin(half - overruled.odom_rad)
    x, y = now.x - then.x, now.y - then.y
    pose = overruled.pose @ Pose2(cos * x - sin * y, sin * x + cos * y, turn)
    return overruled._replace(pose=pose, sums=now, odom_rad=odom_rad)
