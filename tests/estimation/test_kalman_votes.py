"""Two motions that agree beat one that differs, however sure it says it is; where nobody can tell, both are covered."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from trailmark.estimates import Motion, information_from_sigmas
from trailmark.estimation.kalman.agreement import Tolerance, agreeing_groups, disagreement_within
from trailmark.estimation.kalman.clock_offsets import ClockOffsets, TimeOffset
from trailmark.estimation.kalman.diagnosis import DetectedFault, FaultDiagnosis, LastingDoubt, MotionSum, RivalFilter
from trailmark.estimation.kalman.lasting_doubts import doubts_of
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman.votes import with_votes
from trailmark.estimation.kalman.windows import with_new_anchor
from trailmark.geometry import Pose2

from .conftest import kalman, pose_of

DT_S = 0.05
SIGMAS = {"wheels": (2e-3, 1e-3, 4e-3), "camera": (6e-4, 6e-4, 6e-4), "laser": (3e-4, 3e-4, 3e-4)}


@dataclass
class Told:
    """What became of a drive, four times a second."""

    errors_m: list[float] = field(default_factory=list)
    sigmas: list[float] = field(default_factory=list)
    health: list[set[str]] = field(default_factory=list)
    scaled: set[str] = field(default_factory=set)

    def named(self) -> set[str]:
        """Return who was ever named."""
        return set().union(*self.health)


def drive(
    speed_mps: float,
    *,
    drift_mps: float,
    names: tuple[str, ...] = tuple(SIGMAS),
    until_s: float = 20.0,
    slip_mps: float = 0.0,
    has_stopped: bool = False,
) -> Told:
    """Drive on a winding way; from 5 s on the laser, whose motion is surest, drifts ahead.

    From 15 s on the wheels may slip; a fourth localizer may stop at 3 s.
    """
    rng, estimator, told = np.random.default_rng(11), kalman(), Told()
    pose, before = Pose2(), Pose2()
    for i in range(1, round(until_s / DT_S) + 1):
        t = DT_S * i
        speed = speed_mps * (1.0 + 0.3 * math.sin(0.9 * t))
        step = Pose2.exp(speed * DT_S, 0.0, 0.4 * math.sin(0.57 * t) * DT_S)
        pose = pose @ step
        for name in ("wheels", "camera"):
            dx, dy, turn = (rng.normal(size=3) * SIGMAS[name]).tolist()
            slip = slip_mps * DT_S if name == "wheels" and t > 15.0 else 0.0
            said = Pose2(step.x + dx + slip, step.y + dy, step.theta + turn)
            if name in names:
                estimator.apply(name, Motion(t - DT_S, t, said, information_from_sigmas(*SIGMAS[name])))
        if has_stopped and t <= 3.0:
            estimator.apply("second", Motion(t - DT_S, t, step, information_from_sigmas(*SIGMAS["wheels"])))
        if i % 2 == 0:
            moved, before = before.between(pose), pose
            dx, dy, turn = (rng.normal(size=3) * SIGMAS["laser"]).tolist()
            ahead = drift_mps * 2.0 * DT_S if t > 5.0 else 0.0
            said = Pose2(moved.x + dx + ahead, moved.y + dy, moved.theta + turn)
            estimator.apply("laser", Motion(t - 2.0 * DT_S, t, said, information_from_sigmas(*SIGMAS["laser"])))
        if i % 5 == 0:
            belief = estimator.belief(t)
            assert belief.covariance is not None
            told.errors_m.append(pose_of(belief).distance_to(pose))
            told.sigmas.append(told.errors_m[-1] / math.sqrt((belief.covariance[0, 0] + belief.covariance[1, 1]) / 2))
            told.health.append(set(belief.health))
    told.scaled = set(estimator.noise_scales())
    return told


def test_a_sure_motion_that_drifts_is_outvoted_by_two() -> None:
    told = drive(0.1, drift_mps=0.02)

    assert told.health[-1] == {"laser"}
    assert "camera" not in told.scaled
    assert np.quantile(told.sigmas, 0.95) < 4.0
    assert max(told.errors_m) < 0.05


def test_one_that_has_stopped_holds_up_no_votes() -> None:
    told = drive(0.1, drift_mps=0.02, until_s=12.0, has_stopped=True)

    assert told.health[-1] == {"laser", "second"}
    assert max(told.errors_m) < 0.05


def test_a_drift_that_calibrations_may_have_is_covered_and_draws_the_belief_little() -> None:
    told = drive(0.5, drift_mps=0.02)

    assert told.health[-1] == {"laser"}
    assert "camera" not in told.scaled
    assert np.quantile(told.sigmas, 0.95) < 4.0
    assert max(told.errors_m) < 0.1


def test_a_doubt_lasts_while_it_is_asked_about_another() -> None:
    told = drive(0.5, drift_mps=0.02, until_s=18.0, slip_mps=0.3)

    assert told.health[-1] == {"wheels", "laser"}
    assert max(told.errors_m) < 0.05


def test_of_two_that_part_slowly_nobody_is_believed_more_than_the_other() -> None:
    told = drive(0.5, drift_mps=0.02, names=("camera", "laser"))

    assert told.health[-1] == {"camera", "laser"}
    assert np.quantile(told.sigmas, 0.95) < 4.0


def test_three_that_are_honest_are_left_in_peace() -> None:
    told = drive(0.5, drift_mps=0.0)

    assert not told.named()
    assert np.quantile(told.sigmas, 0.95) < 4.0


def state_of(stamp_s: float, **ways_m: tuple[float, float]) -> FilterState:
    """Return a state in which each localizer has told a way with a variance."""
    sums = {
        name: MotionSum(x=way_m, position_m2=variance, turn_rad2=1e-4 * stamp_s, covered_s=stamp_s)
        for name, (way_m, variance) in ways_m.items()
    }
    return FilterState(stamp_s, None, diagnosis=FaultDiagnosis(sums=sums))


def rivals_of(state: FilterState, begun: FilterState) -> list[RivalFilter]:
    """Return the hypotheses that the laser lies, and that the camera does."""
    fault = DetectedFault(state.stamp_s, "it lies")
    return [
        RivalFilter(state.with_diagnosis(state.diagnosis._replace(faults={liar: fault})), -4.6, begun=begun)
        for liar in ("laser", "camera")
    ]


def test_a_noisy_motion_is_in_the_group_of_each_of_two_that_contradict_each_other() -> None:
    anchor = state_of(0.0, wheels=(0.0, 0.0), camera=(0.0, 0.0), laser=(0.0, 0.0))
    state = state_of(2.0, wheels=(0.2, 4e-4), camera=(0.2, 1e-6), laser=(0.25, 1e-6))

    groups = agreeing_groups(state, anchor, ["wheels", "camera", "laser"], Tolerance(0.0, 0.0))

    assert set(groups) == {frozenset({"wheels", "camera"}), frozenset({"wheels", "laser"})}
    assert disagreement_within(state, anchor, ["wheels", "camera"], Tolerance(0.0, 0.0)) == pytest.approx(0.0)
    assert disagreement_within(state, anchor, ["wheels", "laser"], Tolerance(0.0, 0.0)) == pytest.approx(6.23, abs=0.01)


def test_a_noisy_motion_votes_with_whom_it_agrees_better() -> None:
    anchor = state_of(0.0, wheels=(0.0, 0.0), camera=(0.0, 0.0), laser=(0.0, 0.0))
    state = state_of(2.0, wheels=(0.2, 4e-4), camera=(0.2, 1e-6), laser=(0.27, 1e-6))

    voted = with_votes(with_votes(rivals_of(state, anchor), Tolerance(0.0, 0.0)), Tolerance(0.0, 0.0))

    assert voted[0].log_weight == pytest.approx(-4.6)
    assert voted[1].log_weight == pytest.approx(-4.6 - 0.5 * 0.07**2 / 4.01e-4)


@pytest.mark.parametrize("missed_s", [0.5, 1.5])
def test_who_was_silent_when_a_question_began_does_not_hold_up_the_votes_of_others(missed_s: float) -> None:
    ways_m = {"wheels": (0.2, 4e-4), "camera": (0.2, 1e-6), "laser": (0.27, 1e-6)}
    begun = state_of(0.0, wheels=(0.0, 0.0), camera=(0.0, 0.0), laser=(0.0, 0.0))
    before, state = (
        one.with_diagnosis(
            one.diagnosis._replace(sums={**one.diagnosis.sums, "second": MotionSum(covered_s=one.stamp_s - missed_s)})
        )
        for one in (state_of(1.9, **ways_m), state_of(2.0, **ways_m))
    )
    begun = begun.with_diagnosis(begun.diagnosis._replace(sums={**begun.diagnosis.sums, "second": MotionSum()}))

    voted = with_votes(rivals_of(state, begun), Tolerance(0.0, 0.0), rivals_of(before, begun))

    assert [one.log_votes for one in voted] == [0.0, pytest.approx(-0.5 * 0.07**2 / 4.01e-4)]


def test_votes_wait_for_one_that_is_a_step_late() -> None:
    begun = state_of(0.0, wheels=(0.0, 0.0), camera=(0.0, 0.0), laser=(0.0, 0.0))
    state = state_of(2.0, wheels=(0.2, 4e-4), camera=(0.2, 1e-6), laser=(0.27, 1e-6))
    late = state.diagnosis.sums["laser"]._replace(covered_s=1.9)
    sums = {**state.diagnosis.sums, "laser": late}
    before = FilterState(1.95, None, diagnosis=FaultDiagnosis(sums={**sums}))
    rivals = rivals_of(FilterState(2.0, None, diagnosis=FaultDiagnosis(sums=sums)), begun)

    assert with_votes(rivals, Tolerance(0.0, 0.0), rivals_of(before, begun)) == rivals


def test_what_a_window_begins_with_has_no_doubts() -> None:
    doubts = {"laser": LastingDoubt(0.01, 0.0, 5.0)}
    state = with_new_anchor(FilterState(8.0, None, diagnosis=FaultDiagnosis(doubts=doubts)))

    assert state.diagnosis.doubts == doubts
    assert not any(one.diagnosis.doubts for one in (*state.diagnosis.anchors, *state.diagnosis.far_anchors))


def test_who_parts_from_two_that_agree_is_doubted_as_fast_as_it_parts() -> None:
    anchor = state_of(0.0, wheels=(0.0, 0.0), camera=(0.0, 0.0), laser=(0.0, 0.0))
    state = state_of(8.0, wheels=(4.0, 4e-4), camera=(4.0, 1e-6), laser=(4.16, 1e-6))
    state = FilterState(8.0, None, diagnosis=state.diagnosis._replace(far_anchors=(anchor,)))

    doubts = doubts_of(state, ["wheels", "camera", "laser"])

    assert list(doubts) == ["laser"]
    assert doubts["laser"].apart_mps == pytest.approx(0.02)
    assert "0.020 m/s" in str(doubts["laser"])


def test_an_offset_that_noise_may_make_is_told_when_other_rows_say_the_same() -> None:
    offsets, found = ClockOffsets(), TimeOffset("wheels", 0.05, 0.009)

    assert not offsets._is_confirmed("laser", found, 13.0)
    assert not offsets._is_confirmed("laser", found, 21.0)
    assert offsets._is_confirmed("laser", found, 27.0)
    assert offsets._is_confirmed("camera", TimeOffset("wheels", 0.2, 0.01), 13.0)
    assert not offsets._is_confirmed("laser", TimeOffset("wheels", -0.05, 0.009), 29.0)
