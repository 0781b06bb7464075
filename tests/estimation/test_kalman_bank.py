"""The parts of a question of who lies: what each hypothesis pays, and how the belief covers who is doubted."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Fix, information_from_sigmas
from trailmark.estimation.kalman.bank import log_likelihood_of_offset
from trailmark.estimation.kalman.dissent import covering_covariance
from trailmark.estimation.kalman.lasting_errors import UNAFFECTED
from trailmark.estimation.kalman.measurements import Measurement, fix_measurement
from trailmark.estimation.kalman.state import CorroboratingFix, FilterState, Gaussian, RejectedMeasurement, Rejections
from trailmark.estimation.kalman.trust import Trust
from trailmark.estimation.symmetric import diagonal
from trailmark.geometry import Pose2

SIGMA_M = 0.02
TRUST = Trust(0.999, "none", 2.0, 1.0, (1e-6, 1e-6), None)
BELIEF = FilterState(1.0, Gaussian(np.zeros(3), np.eye(3) * 1e-6, UNAFFECTED))


def fix_at(x: float, y: float) -> Measurement:
    fix = Fix(1.0, Pose2(x, y), information_from_sigmas(SIGMA_M, SIGMA_M, SIGMA_M))
    certain = SIGMA_M**-2
    return fix_measurement("laser", fix, diagonal(certain, certain, certain), TRUST)


def cost_of(offsets_m: list[float]) -> list[float]:
    """Return what a hypothesis pays for each of some fixes that are off by these along x."""
    offset, costs = None, []
    for x in offsets_m:
        log, offset = log_likelihood_of_offset(BELIEF, fix_at(x, 0.0), offset)
        costs.append(-log)
    return costs


def test_a_constant_lie_costs_next_to_nothing_from_the_second_on() -> None:
    costs = cost_of([1.0] * 10)

    assert costs[0] == 0.0
    np.testing.assert_allclose(costs[1:], [1.5 * math.log(1.0 + 1.0 / n) for n in range(1, 10)], rtol=1e-9)


def test_a_lie_that_grows_costs_more_with_every_fix() -> None:
    costs = cost_of([1.0 + 0.5 * SIGMA_M * k for k in range(8)])

    assert all(later > earlier for earlier, later in pairwise(costs[2:]))


def test_another_lie_costs_once_and_is_the_lie_from_then_on() -> None:
    costs = cost_of([1.0, 1.0, -1.0, -1.0])

    assert costs[2] > 100.0
    assert costs[3] < 2.0


def rejected(x: float, **corroborations: CorroboratingFix) -> FilterState:
    one = RejectedMeasurement(1.0, Pose2(), fix_at(x, 0.0))
    rejections = Rejections(counts={"laser": 1}, measurements={"laser": (one,)}, corroborations=corroborations)
    return FilterState(1.0, BELIEF.gaussian, rejections=rejections)


def covered(state: FilterState) -> Floats:
    assert state.gaussian is not None
    return covering_covariance(state, state.gaussian)


def test_the_covariance_covers_a_whole_pose_that_was_rejected() -> None:
    covariance = covered(rejected(1.0))

    assert 1.0 / math.sqrt((covariance[0, 0] + covariance[1, 1]) / 2.0) < 4.0
    assert covariance[1, 1] == 1e-6


def test_it_does_not_where_another_supports_the_belief() -> None:
    supported = rejected(1.0, beacons=CorroboratingFix(0.5, np.eye(3)))

    np.testing.assert_array_equal(covered(supported), np.eye(3) * 1e-6)


def test_it_covers_one_against_one_where_that_goes_on() -> None:
    one = rejected(1.0, beacons=CorroboratingFix(0.5, np.eye(3)))
    often = replace(one, rejections=replace(one.rejections, shares={"laser": 0.5}))
    two = {name: CorroboratingFix(0.5, np.eye(3)) for name in ("beacons", "radio")}
    against_two = replace(often, rejections=replace(often.rejections, corroborations=two))

    assert covered(often)[0, 0] > 0.1
    np.testing.assert_array_equal(covered(against_two), np.eye(3) * 1e-6)


def test_who_was_rejected_long_ago_is_covered_until_anybody_fits() -> None:
    alone, answered = rejected(1.0), rejected(1.0, beacons=CorroboratingFix(2.0, np.eye(3)))
    later = [FilterState(10.0, one.gaussian, rejections=one.rejections) for one in (alone, answered)]

    assert covered(later[0])[0, 0] > 0.1
    np.testing.assert_array_equal(covered(later[1]), np.eye(3) * 1e-6)
