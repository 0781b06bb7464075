"""Stamps of one localizer against another's: found where the drive tells them, and not told where it does not."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.estimates import Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.clock_offsets import ClockOffsets, TimeOffset
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.geometry import Pose2
from trailmark.interfaces import Session

GOOD = information_from_sigmas(0.01, 0.01, 0.01)


@cache
def drive(winding: float) -> Floats:
    """Stamps, x, y, heading and way of a drive whose turn rate and speed change with `winding`."""
    stamps = np.arange(-1.0, 25.0, 1e-3)
    heading = winding * (0.8 * np.sin(0.7 * stamps) + 0.3 * np.sin(1.9 * stamps))
    step_m = 1e-3 * (0.5 + 0.11 * winding * np.cos(1.1 * stamps))
    x, y = np.cumsum(step_m * np.cos(heading)), np.cumsum(step_m * np.sin(heading))
    return np.array([stamps, x, y, heading, np.cumsum(step_m)])


def truth(t: float, winding: float = 1.0) -> Pose2:
    stamps, x, y, heading, _ = drive(winding)
    return Pose2(float(np.interp(t, stamps, x)), float(np.interp(t, stamps, y)), float(np.interp(t, stamps, heading)))


def motion(since_s: float, stamp_s: float, late_s: float, rng: np.random.Generator, winding: float = 1.0) -> Motion:
    step = truth(since_s - late_s, winding).between(truth(stamp_s - late_s, winding))
    noise = rng.normal(size=2) * [5e-4, 1e-3]
    return Motion(since_s, stamp_s, Pose2(step.x + noise[0], step.y, step.theta + noise[1]), GOOD)


def found(
    late_s: float, *, fixes: bool = False, winding: float = 1.0, seed: int = 0, gyro_bias: float = 0.0
) -> TimeOffset | None:
    """Return what is certain after 20 s of wheels at 20 Hz and a second localizer."""
    rng, offsets = np.random.default_rng(seed), ClockOffsets()
    for i in range(1, 400):
        since_s, stamp_s = (i - 1) / 20, i / 20
        offsets.observe("wheels", motion(since_s, stamp_s, 0.0, rng, winding))
        if fixes:
            pose = truth(stamp_s - late_s, winding)
            dx, dy, turn = rng.normal(size=3) * 0.01
            noisy = Pose2(pose.x + dx, pose.y + dy, pose.theta + turn)
            if i % 4 == 0:
                offsets.observe("laser", Fix(stamp_s, noisy, GOOD))
        else:
            told = motion(since_s, stamp_s, late_s, rng, winding)
            biased = told.pose_since_now @ Pose2(0.0, 0.0, gyro_bias / 20)
            offsets.observe("camera", Motion(since_s, stamp_s, biased, GOOD))
    return offsets.certain.get("laser" if fixes else "camera")


@pytest.mark.parametrize("late_s", [0.03, 0.08, 0.2, 0.4, -0.05, -0.2])
@pytest.mark.parametrize("seed", range(3))
def test_late_motions_are_found_to_some_milliseconds(late_s: float, seed: int) -> None:
    offset = found(late_s, seed=seed)
    assert offset is not None
    assert offset.late_s == pytest.approx(late_s, abs=0.006)
    assert abs(offset.late_s - late_s) < 4.0 * offset.sigma_s
    assert offset.against == "wheels"


@pytest.mark.parametrize("late_s", [0.1, 0.2, -0.1])
def test_late_fixes_are_found_by_where_they_lie(late_s: float) -> None:
    offset = found(late_s, fixes=True)
    assert offset is not None
    assert abs(offset.late_s - late_s) < 4.0 * offset.sigma_s
    assert abs(offset.late_s - late_s) < 0.03


@pytest.mark.parametrize("fixes", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_right_stamps_are_let_be(fixes: bool, seed: int) -> None:
    assert found(0.0, fixes=fixes, seed=seed) is None


@pytest.mark.parametrize("seed", range(8))
def test_a_way_that_drifts_as_it_says_is_not_taken_for_a_late_laser(seed: int) -> None:
    """At 2 m/s wheels drift by a metre in the window: a shift of 50 ms to 100 ms fits it better than none."""
    rng, offsets, told = np.random.default_rng(seed), ClockOffsets(), []
    information = information_from_sigmas(2e-3, 1e-3, 4e-3)
    for i in range(1, 500):
        since_s, stamp_s = (i - 1) / 20, i / 20
        step = fast(since_s).between(fast(stamp_s)) @ Pose2(*(rng.normal(size=3) * (2e-3, 1e-3, 4e-3)).tolist())
        told += offsets.observe("wheels", Motion(since_s, stamp_s, step, information))
        if i % 5 == 0:
            pose = fast(stamp_s)
            dx, dy, turn = (rng.normal(size=3) * (0.02, 0.02, 0.01)).tolist()
            fix = Fix(
                stamp_s, Pose2(pose.x + dx, pose.y + dy, pose.theta + turn), information_from_sigmas(0.02, 0.02, 0.01)
            )
            told += offsets.observe("laser", fix)

    assert not told


def fast(t: float) -> Pose2:
    pose = truth(t)
    return Pose2(4.0 * pose.x, 4.0 * pose.y, pose.theta)


def test_who_is_forgotten_is_compared_with_nobody() -> None:
    rng, offsets = np.random.default_rng(0), ClockOffsets()
    for i in range(1, 480):
        since_s, stamp_s = (i - 1) / 20, i / 20
        offsets.observe("wheels", motion(since_s, stamp_s, 0.0, rng))
        offsets.forget("camera")
        offsets.observe("camera", motion(since_s, stamp_s, 0.2, rng))

    assert not offsets.certain


@pytest.mark.parametrize("fixes", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_an_even_drive_tells_nothing(fixes: bool, seed: int) -> None:
    assert found(0.2, fixes=fixes, winding=0.0, seed=seed) is None


def test_a_biased_gyro_is_not_taken_for_a_late_one() -> None:
    assert found(0.0, gyro_bias=0.1) is None


def test_localizers_alone_and_one_that_knows_no_heading_tell_nothing() -> None:
    offsets = ClockOffsets()
    position = np.diag([1.0, 1.0, 0.0])
    for i in range(400):
        assert not offsets.observe("gps", Fix(i / 10, Pose2(0.05 * i), position))
    assert not offsets.certain


def test_it_says_how_late_against_whom() -> None:
    assert str(TimeOffset("wheels", 0.182, 0.006)) == "its stamps are 182 +- 6 ms late against wheels"
    assert str(TimeOffset("wheels", -0.05, 0.004)) == "its stamps are 50 +- 4 ms early against wheels"


@pytest.mark.parametrize("mode", ["use", "tell", "off"])
def test_the_filter_tells_late_fixes_and_corrects_them(mode: str, caplog: pytest.LogCaptureFixture) -> None:
    rng, kalman = np.random.default_rng(3), Kalman(KalmanConfig(clock_offsets=mode))
    kalman.start(Session(start_pose=truth(0.0)))
    misses_s = []
    for i in range(1, 400):
        stamp_s = i / 20
        kalman.apply("wheels", motion(stamp_s - 0.05, stamp_s, 0.0, rng))
        if i % 4 == 0:
            pose = truth(stamp_s - 0.2)
            dx, dy, turn = rng.normal(size=3) * 0.01
            kalman.apply("laser", Fix(stamp_s, Pose2(pose.x + dx, pose.y + dy, pose.theta + turn), GOOD))
        believed, true = kalman.belief(stamp_s).pose_map_base, truth(stamp_s)
        assert believed is not None
        behind = believed.between(true)
        misses_s.append(behind.x / 0.5)
    late_s = float(np.median(misses_s[300:]))
    health = kalman.belief(19.95).health
    if mode == "off":
        assert "late against" not in caplog.text
    else:
        assert "localizer 'laser': its stamps are" in caplog.text
        assert "time_offset_s" in caplog.text
        assert "laser" in health
    assert (abs(late_s) < 0.03) == (mode == "use")


@pytest.mark.parametrize("wrong_s", [1e6, math.inf, math.nan])
def test_a_stamp_that_is_refused_ends_no_learning(wrong_s: float) -> None:
    rng, kalman = np.random.default_rng(4), Kalman(KalmanConfig())
    kalman.start(Session(start_pose=truth(0.0)))
    for i in range(1, 400):
        stamp_s = i / 20
        kalman.apply("wheels", motion(stamp_s - 0.05, stamp_s, 0.0, rng))
        kalman.apply("late", motion(stamp_s - 0.05, stamp_s, 0.15, rng))
        if i == 5:
            refused = kalman.apply("laser", Fix(wrong_s, Pose2(), GOOD))
            assert refused.status == "refused"

    assert kalman.clock_offsets()["late"].late_s == pytest.approx(0.15, abs=0.02)


def test_offsets_are_learned_after_the_clock_went_back() -> None:
    rng, kalman = np.random.default_rng(5), Kalman(KalmanConfig(time_jump="reset"))
    kalman.start(Session(start_pose=truth(0.0)))
    for begin_s in (1000.0, 0.0):
        for i in range(1, 400):
            stamp_s = i / 20
            for name, late_s in (("wheels", 0.0), ("late", 0.15 if begin_s == 0.0 else 0.0)):
                told = motion(stamp_s - 0.05, stamp_s, late_s, rng)
                kalman.apply(name, replace(told, since_s=told.since_s + begin_s, stamp_s=told.stamp_s + begin_s))

    assert kalman.clock_offsets()["late"].late_s == pytest.approx(0.15, abs=0.02)
