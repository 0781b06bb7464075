"""Parts of a drive that contradict each other: slow and fast turns, slow and fast ways."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.calibration.conftest import BELIEVED, RIGHT, pairs_from

from trailmark_calibration.checking import calibrate
from trailmark_calibration.contradicting import contradictions_of_rates
from trailmark_calibration.fitting import fit
from trailmark_calibration.model import TURN, TURN_PER_M, WAY
from trailmark_calibration.simulating import SimulatedDrive, simulate
from trailmark_calibration.wording import line_of

ASKED = (WAY, TURN, TURN_PER_M)


def slipping(drive: SimulatedDrive, wrong: Callable[[float, float], tuple[float, float]]) -> SimulatedDrive:
    """Return a drive whose wheels tell factors too much, which depend on speed and rate of turn."""
    said = []
    for motion in drive.wheels:
        length_s, pose = motion.stamp_s - motion.since_s, motion.pose_since_now
        way, turn = wrong(abs(pose.x) / length_s, abs(pose.theta) / length_s)
        said.append(replace(motion, pose_since_now=replace(pose, x=way * pose.x, theta=turn * pose.theta)))
    return replace(drive, wheels=said)


@pytest.mark.parametrize("seed", [300, 302, 305])
def test_wheels_that_slip_in_fast_turns_alone_are_not_told_as_a_mean(seed: int) -> None:
    """10 % above 0.5 rad/s, in both halves of the drive: there is no one scale of turns."""
    drive = simulate(np.random.default_rng(seed), RIGHT, BELIEVED, duration_s=120.0)
    pairs, known = pairs_from(slipping(drive, lambda speed, rate: (1.0, 1.1 if rate > 0.5 else 1.0)))

    found = calibrate(pairs, known, ASKED)

    assert list(found.contradictions) == [TURN]
    assert found.contradictions[TURN].parts == "slow and fast turns"
    for right in (RIGHT[TURN], RIGHT[TURN] / 1.1):
        assert abs(found.fit.values[TURN] - right) < 3.0 * found.fit.sigmas[TURN]
    assert "slow and fast turns contradict each other" in line_of(found, TURN)
    assert "turn more" not in line_of(found, TURN)
    assert "contradict" not in line_of(found, WAY)
    assert found.fit.is_told[[WAY, TURN_PER_M]].all()


def test_wheels_that_slip_on_fast_ways_alone_are_not_told_as_a_mean() -> None:
    drive = simulate(np.random.default_rng(11), RIGHT, BELIEVED, duration_s=120.0)
    pairs, known = pairs_from(slipping(drive, lambda speed, rate: (1.05 if speed > 0.5 else 1.0, 1.0)))

    found = calibrate(pairs, known, ASKED)

    assert list(found.contradictions) == [WAY]
    assert found.contradictions[WAY].parts == "slow and fast ways"
    for right in (RIGHT[WAY], RIGHT[WAY] / 1.05):
        assert abs(found.fit.values[WAY] - right) < 3.0 * found.fit.sigmas[WAY]
    assert "slow and fast ways contradict each other" in line_of(found, WAY)


@pytest.mark.parametrize("seed", [600, 608])
def test_wheels_that_do_not_slip_contradict_nothing(seed: int) -> None:
    drive = simulate(np.random.default_rng(seed), RIGHT, BELIEVED, duration_s=120.0)

    assert not calibrate(*pairs_from(drive), ASKED).contradictions


def test_what_a_part_does_not_tell_is_no_contradiction(straight: SimulatedDrive) -> None:
    pairs, known = pairs_from(straight)

    assert not contradictions_of_rates(pairs, known, fit(pairs, known))
