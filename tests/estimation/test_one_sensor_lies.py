"""One camera whose motion and poses lie alike, beside wheels and two other sensors that tell poses.

All speak at rates of their own, so that a motion of one is cut where those of others begin and end; the camera tells
poses twice as often as the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from trailmark.estimates import Estimate, Fix, Motion, information_from_sigmas
from trailmark.geometry import Pose2

from .conftest import ORIGIN, kalman, pose_of

SPEED_MPS, UNTIL_S, LIES_S = 0.4, 11.0, (5.0, 8.0)
SIGMAS = {
    "camera": (5e-5, 5e-5, 1.3e-4),
    "wheels": (3.3e-3, 3e-3, 1.5e-2),
    "camera_map": (2.3e-3, 2.3e-3, 1.2e-3),
    "laser": (0.012, 0.012, 0.005),
    "omni": (0.032, 0.032, 0.01),
    "depth": (0.6, 0.6, 0.05),
}
RATES_HZ = {"camera": 30.0, "wheels": 40.0, "camera_map": 7.5, "laser": 4.0, "omni": 4.0, "depth": 4.0}
CAMERA = ("camera", "camera_map")

Lie = Callable[[float], Pose2]


@dataclass
class Seen:
    """Errors by stamp, how many beliefs are off by more than 20 mm and 5 sigmas, and who was accused when."""

    errors_m: dict[float, float] = field(default_factory=dict)
    n_silent: int = 0
    accused: dict[str, list[float]] = field(default_factory=dict)


def at(stamp_s: float) -> Pose2:
    """Return base on a circle."""
    return Pose2.exp(SPEED_MPS * stamp_s, 0.0, 0.1 * stamp_s)


def at_once(stamp_s: float) -> Pose2:
    """Return base as a lie has it that is 1 m aside, and begins and ends at once."""
    return Pose2(0.0, float(LIES_S[0] <= stamp_s < LIES_S[1]), 0.0) @ at(stamp_s)


def for_good(stamp_s: float) -> Pose2:
    """Return base as a lie has it that is 1 m aside, and goes on."""
    return Pose2(0.0, float(stamp_s >= LIES_S[0]), 0.0) @ at(stamp_s)


def within_a_tenth(stamp_s: float) -> Pose2:
    """Return the same of one that grows over several steps."""
    until_s = (LIES_S[0], LIES_S[0] + 0.1, LIES_S[1], LIES_S[1] + 0.1)
    return Pose2(0.0, float(np.interp(stamp_s, until_s, (0.0, 1.0, 1.0, 0.0))), 0.0) @ at(stamp_s)


def too_short(stamp_s: float) -> Pose2:
    """Return base as a lie has it that tells 0.7 of the way."""
    told_s = min(max(stamp_s - LIES_S[0], 0.0), LIES_S[1] - LIES_S[0])
    return at(stamp_s) @ Pose2(-0.3 * SPEED_MPS * told_s * (stamp_s < LIES_S[1]), 0.0, 0.0)


def told_of(seed: int, liars: Sequence[str], lie: Lie) -> list[tuple[float, str, Estimate]]:
    """Return what all say in the order of time: liars have base elsewhere in the map, with motion and poses alike."""
    rng = np.random.default_rng(seed)
    told: list[tuple[float, str, Estimate]] = []
    for source, rate_hz in RATES_HZ.items():
        sigmas, place = SIGMAS[source], lie if source in liars else at
        for i in range(1, round(UNTIL_S * rate_hz) + 1):
            since_s, stamp_s = (i - 1) / rate_hz, i / rate_hz
            noise = rng.normal(size=3) * sigmas
            now = place(stamp_s)
            if source in ("camera", "wheels"):
                step = place(since_s).between(now)
                motion = Pose2.from_array(step.array() + noise)
                told.append((stamp_s, source, Motion(since_s, stamp_s, motion, information_from_sigmas(*sigmas))))
            else:
                fix = Pose2.from_array(now.array() + noise)
                told.append((stamp_s, source, Fix(stamp_s, fix, information_from_sigmas(*sigmas))))
    return sorted(told, key=lambda one: one[:2])


def drive(seed: int, liars: Sequence[str], lie: Lie) -> Seen:
    """Drive with all localizers, and look every 0.05 s."""
    estimator, seen, told = kalman(ORIGIN), Seen(), iter(told_of(seed, liars, lie))
    ahead = next(told)
    for stamp_s in np.arange(0.5, UNTIL_S - 0.1, 0.05).tolist():
        while ahead[0] <= stamp_s:
            estimator.apply(*ahead[1:])
            ahead = next(told)
        belief, true = estimator.belief(stamp_s), at(stamp_s)
        assert belief.covariance is not None
        off = pose_of(belief).array()[:2] - true.array()[:2]
        error_m = math.hypot(*off)
        sigmas_off = math.sqrt(off @ np.linalg.solve(belief.covariance[:2, :2], off))
        seen.errors_m[stamp_s] = error_m
        seen.n_silent += error_m > 0.02 and sigmas_off > 5.0
        for source, reason in belief.health.items():
            if "disagree by" not in reason:
                seen.accused.setdefault(source, []).append(stamp_s)
    return seen


@pytest.mark.parametrize("liars", [("camera",), CAMERA, ("laser",)])
def test_a_sensor_that_jumps_at_once_moves_nobody(liars: tuple[str, ...]) -> None:
    seen = drive(1, liars, at_once)

    assert max(seen.errors_m.values()) < 0.02
    assert set(seen.accused) == set(liars)
    assert min(map(min, seen.accused.values())) <= LIES_S[0] + 1.0


@pytest.mark.parametrize("seed", [1, 2])
def test_a_sensor_bears_itself_out_against_nobody(seed: int) -> None:
    seen = drive(seed, CAMERA, within_a_tenth)

    assert seen.n_silent == 0
    assert set(seen.accused) == set(CAMERA)
    assert max(seen.accused[source][0] for source in CAMERA) <= LIES_S[0] + 2.0
    assert max(error_m for at_s, error_m in seen.errors_m.items() if at_s > LIES_S[0] + 2.0) < 0.1


@pytest.fixture
def _loose_wheels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three sensors tell poses, and the wheels allow for what the camera says."""
    monkeypatch.delitem(RATES_HZ, "depth")
    precise = {"camera_map": (4e-3, 4e-3, 3e-3), "laser": (0.01, 0.01, 5e-3), "omni": (0.02, 0.02, 0.01)}
    for source, sigmas in {"camera": (1.4e-4,) * 3, "wheels": (5e-3, 5e-3, 1e-2), **precise}.items():
        monkeypatch.setitem(SIGMAS, source, sigmas)
    for source in ("camera", "wheels"):
        monkeypatch.setitem(RATES_HZ, source, 20.0)


@pytest.mark.usefixtures("_loose_wheels")
@pytest.mark.parametrize("seed", [1, 3, 4])
def test_a_sensor_that_tells_too_short_a_way_is_outvoted_by_two_that_agree(seed: int) -> None:
    seen = drive(seed, CAMERA, too_short)

    assert set(seen.accused) == set(CAMERA)
    assert max(seen.errors_m.values()) < 0.15
    assert seen.n_silent < 15


@pytest.mark.usefixtures("_loose_wheels")
def test_where_two_that_agree_are_accused_first_the_belief_covers_them() -> None:
    assert drive(2, CAMERA, too_short).n_silent < 25


@pytest.mark.usefixtures("_loose_wheels")
@pytest.mark.parametrize("liars", [("camera_map", "laser"), ("camera_map", "omni"), ("laser", "omni")])
def test_two_whose_poses_jump_alike_take_nobody_along(liars: tuple[str, ...]) -> None:
    seen = drive(1, liars, for_good)

    assert max(seen.errors_m.values()) < 0.02
    assert set(seen.accused) == set(liars)
