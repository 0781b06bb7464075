"""The fixed-lag smoother, told in disorder: motions that overlap, come late or leave gaps, and a clock that is set."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trailmark.arrays import Floats
from trailmark.estimates import Fix, Motion, information_from_sigmas
from trailmark.estimation.smoother.estimator import Smoother
from trailmark.estimation.smoother.health import SourceRecord, health_of
from trailmark.estimation.smoother_config import SmootherConfig
from trailmark.geometry import Pose2
from trailmark.interfaces import Session

_ORIGIN = Pose2()
_GOOD = information_from_sigmas(0.01, 0.01, 0.01)
_SPEED_MPS = 0.5


def started(start: Pose2 | None = _ORIGIN, **keys: object) -> Smoother:
    smoother = Smoother(SmootherConfig.model_validate(keys))
    smoother.start(Session("estimator", start_pose=start))
    return smoother


def straight(since_s: float, stamp_s: float) -> Motion:
    return Motion(since_s, stamp_s, Pose2(_SPEED_MPS * (stamp_s - since_s)), _GOOD)


def on_the_line(stamp_s: float) -> Fix:
    return Fix(stamp_s, Pose2(_SPEED_MPS * stamp_s), _GOOD)


def believed(smoother: Smoother, stamp_s: float | None = None) -> tuple[Pose2, Floats]:
    belief = smoother.belief(stamp_s)
    assert belief.pose_map_base is not None
    assert belief.covariance is not None
    return belief.pose_map_base, belief.covariance


@pytest.mark.parametrize("with_wheels", [False, True])
def test_a_motion_may_begin_before_the_pose_was_known(with_wheels: bool) -> None:
    smoother = started(None)
    for step in range(1, 60):
        stamp_s = step / 10
        if with_wheels:
            smoother.apply("wheels", straight(stamp_s - 0.1, stamp_s))
        if step >= 24 and step % 3 == 0:
            assert smoother.apply("fixes", on_the_line(stamp_s)).status == "accepted"
        if step % 10 == 0:
            assert smoother.apply("camera", straight(stamp_s - 1.0, stamp_s)).status == "accepted"

    belief = smoother.belief()
    assert believed(smoother)[0].distance_to(Pose2(_SPEED_MPS * belief.stamp_s)) < 1e-6
    assert belief.fix_age_m == pytest.approx(_SPEED_MPS * (belief.stamp_s - 5.7), abs=1e-9)


def test_a_motion_may_begin_before_a_pose_was_set() -> None:
    smoother = started()
    for step in range(1, 30):
        smoother.apply("wheels", straight((step - 1) / 10, step / 10))
    smoother.set_pose(Pose2(5.0, 5.0))
    part = information_from_sigmas(math.inf, 0.01, 0.01)
    smoother.apply("fixes", Fix(2.95, Pose2(5.0, 5.0), part))

    assert smoother.apply("camera", straight(2.0, 3.0)).status == "accepted"

    belief = smoother.belief()
    assert believed(smoother)[0].distance_to(Pose2(5.0 + _SPEED_MPS * 0.1, 5.0)) < 1e-9
    assert belief.fix_age_m == pytest.approx(_SPEED_MPS * 0.05)


def test_a_motion_before_the_window_leaves_what_is_known_of_its_first_pose() -> None:
    smoother = started(None)
    smoother.apply("fixes", on_the_line(2.0))
    smoother.apply("wheels", straight(2.0, 3.0))
    smoother.apply("fixes", on_the_line(3.0))
    pose, covariance = believed(smoother, 2.0)

    smoother.apply("late", Motion(0.0, 2.0, Pose2(3.0, 0.0, 1.0), _GOOD))

    pose_after, covariance_after = believed(smoother, 2.0)
    assert pose_after.distance_to(pose) < 1e-12
    np.testing.assert_allclose(covariance_after, covariance, atol=1e-12)
    assert believed(smoother)[0].distance_to(Pose2(_SPEED_MPS * 3.0)) < 1e-9


def test_a_fix_in_a_gap_is_tied_as_if_motion_had_been_told_before() -> None:
    motions = [straight(0.0, 1.0), Motion(1.9, 3.0, Pose2(0.25, 0.1, 0.2), _GOOD)]
    told = on_the_line(1.5)
    in_time, late = started(), started()

    for motion in motions:
        in_time.apply("wheels", motion)
    in_time.apply("fixes", told)
    late.apply("wheels", motions[0])
    late.apply("fixes", told)
    late.apply("wheels", motions[1])

    pose, covariance = believed(in_time)
    assert believed(late)[0].distance_to(pose) < 1e-6
    np.testing.assert_allclose(believed(late)[1], covariance, rtol=1e-6)


@pytest.mark.parametrize("sigma_m", [1.0, 100.0, 600.0, 1e5])
def test_a_vague_start_is_as_vague_after_the_most_exact_motion(sigma_m: float) -> None:
    smoother = started(None)
    exact = information_from_sigmas(1e-6, 1e-6, 1e-6)
    smoother.apply("fixes", Fix(0.0, Pose2(), information_from_sigmas(sigma_m, sigma_m, 0.1)))
    vague = information_from_sigmas(1e3 * sigma_m, 1e3 * sigma_m, 1e3)
    for step in range(1, 50):
        smoother.apply("wheels", Motion((step - 1) / 10, step / 10, Pose2.exp(0.05, 0.0, 0.02), exact))
        smoother.apply("vague", Fix(step / 10, Pose2(), vague))

    pose, covariance = believed(smoother)

    assert pose.distance_to(Pose2.exp(0.05 * 49, 0.0, 0.02 * 49)) < 0.01 * sigma_m
    np.testing.assert_allclose(np.sqrt(covariance.diagonal()[:2]), sigma_m, rtol=0.05)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_nothing_that_is_told_in_disorder_breaks_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    smoother = started(
        _ORIGIN if rng.random() < 0.5 else None,
        lag_s=float(rng.choice([2.0, 10.0])),
        gate="off" if rng.random() < 0.2 else 0.999,
        loss=str(rng.choice(["dcs", "huber", "none"])),
        motions=str(rng.choice(["independent", "intersection"])),
    )
    for source, told in disorder(rng):
        if isinstance(told, Pose2):
            smoother.set_pose(told)
        else:
            smoother.apply(source, told)
        covariance = smoother.belief().covariance
        if covariance is not None:
            np.testing.assert_array_equal(covariance, covariance.T)
            sigmas = np.sqrt(covariance.diagonal())
            assert np.linalg.eigvalsh(covariance / np.outer(sigmas, sigmas))[0] > -1e-9


def disorder(rng: np.random.Generator) -> list[tuple[str, Motion | Fix | Pose2]]:
    """Return what two odometries and a localizer of 4 s tell, in the order in which it comes."""
    begin_s, exact = rng.uniform(0.0, 1e3), 10.0 ** rng.uniform(-7.0, 0.0)
    known = information_from_sigmas(exact, exact, exact)
    told: list[tuple[float, str, Motion | Fix | Pose2]] = []
    for step in range(40):
        since_s = begin_s + 0.1 * step
        if rng.random() < 0.8:
            delay_s = rng.uniform(0.0, 3.0) if rng.random() < 0.2 else 0.0
            wheels = Motion(since_s, since_s + 0.1, Pose2(0.05, 0.0, 0.02), known)
            told.append((since_s + 0.1 + delay_s, "wheels", wheels))
        if rng.random() < 0.1:
            long_s = rng.uniform(0.2, 2.0)
            camera = Motion(since_s - long_s, since_s, Pose2(rng.uniform(0.0, 1.0)), known)
            told.append((since_s + rng.uniform(0.0, 1.0), "camera", camera))
        if rng.random() < 0.3:
            parts = np.where(rng.random(3) < 0.7, 10.0 ** rng.uniform(-5.0, 3.0, 3), math.inf)
            pose = Pose2(*rng.normal(0.0, 3.0, 3).tolist()) if rng.random() < 0.3 else Pose2(0.05 * step)
            fix = Fix(since_s + 0.05, pose, information_from_sigmas(*parts.tolist()))
            told.append((since_s + rng.exponential(0.3), "fixes", fix))
        if rng.random() < 0.02:
            told.append((since_s, "user", Pose2(*rng.normal(0.0, 2.0, 3).tolist())))
    return [(source, one) for _, source, one in sorted(told, key=lambda each: each[0])]


def set_back() -> Smoother:
    """Return one whose clock was set from 1005 s to 10 s, with two that told fixes before and wheels since."""
    smoother = started()
    for begin_s in (1000.0, 10.0):
        for step in range(1, 50):
            stamp_s = begin_s + step / 10
            smoother.apply("wheels", Motion(stamp_s - 0.1, stamp_s, Pose2(), _GOOD))
            if begin_s == 1000.0:
                smoother.apply("good", Fix(stamp_s, Pose2(), _GOOD))
                smoother.apply("bad", Fix(stamp_s, Pose2(), _GOOD))
    assert smoother.counters()["time_resets"] == 1
    return smoother


def test_who_falls_silent_when_the_clock_is_set_back_is_said_to_be() -> None:
    health = set_back().belief().health

    assert health.keys() == {"good", "bad"}
    assert health["good"].startswith("silent for 4.")


def test_who_was_never_heard_is_not_said_to_be_silent_for_ever() -> None:
    assert health_of({"good": SourceRecord()}, now_s=9.0, timeout_s=1.0) == {"good": "not heard of yet"}


def test_what_was_accepted_before_the_clock_was_set_back_supports_nobody() -> None:
    smoother = set_back()
    for step in range(50, 54):
        smoother.apply("bad", Fix(10.0 + step / 10, Pose2(30.0), _GOOD))

    belief = smoother.belief()

    assert belief.health["bad"].startswith("contradicts the belief")
    assert math.sqrt(believed(smoother)[1][0, 0]) > 3.0
