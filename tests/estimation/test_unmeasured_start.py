"""A start that nothing has measured since: it is believed for a second, and then as after a gap."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from trailmark.estimates import Belief, Fix, Lost
from trailmark.interfaces import Estimator

from .conftest import GOOD, ORIGIN, dead_reckoning, kalman, motion

_ESTIMATORS: dict[str, Callable[[], Estimator]] = {
    "kalman": kalman,
    "ukf": lambda: kalman(filter="ukf"),
    "velocity": lambda: kalman(model="velocity"),
    "dead_reckoning": dead_reckoning,
}


@pytest.fixture(params=_ESTIMATORS)
def estimator(request: pytest.FixtureRequest) -> Estimator:
    return _ESTIMATORS[request.param]()


def sigma_m(belief: Belief) -> float:
    assert belief.covariance is not None
    return math.sqrt(belief.covariance[0, 0])


@pytest.mark.parametrize("begin_s", [0.0, 1.7e9])
def test_a_start_that_nothing_measures_grows_wide(estimator: Estimator, begin_s: float) -> None:
    """A covered lens: the robot may have driven on for all that anybody knows."""
    sigmas_m = {}
    for i in range(101):
        now_s = begin_s + 0.1 * i
        estimator.apply("camera", Lost(now_s, "it is dark"))
        sigmas_m[i] = sigma_m(estimator.belief(now_s))

    assert sigmas_m[0] == sigmas_m[9] == pytest.approx(0.01, rel=1e-3)
    assert sigmas_m[50] > 1.5  # at 0.5 m/s for 4 s
    assert sigmas_m[100] > 4.0
    pose = estimator.belief(begin_s + 10.0).pose_map_base
    assert pose is not None
    assert pose.array() == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


def test_silence_alone_makes_it_wide(estimator: Estimator) -> None:
    for i in range(6):
        belief = estimator.belief(float(i))

    assert sigma_m(belief) > 1.5


def test_who_begins_within_a_second_begins_at_the_start(estimator: Estimator) -> None:
    estimator.belief(0.0)
    estimator.apply("wheels", motion(0.9, 1.0, 0.1))

    assert sigma_m(estimator.belief(1.0)) == pytest.approx(0.01, rel=0.02)


def test_who_begins_late_begins_wide_until_a_fix(estimator: Estimator) -> None:
    estimator.belief(0.0)
    estimator.apply("wheels", motion(5.0, 5.1, 0.1))
    assert sigma_m(estimator.belief(5.1)) > 1.5

    estimator.apply("laser", Fix(5.1, ORIGIN, GOOD))

    assert sigma_m(estimator.belief(5.1)) < 2e-3


def test_a_belief_that_was_asked_for_at_another_time_does_not_count(estimator: Estimator) -> None:
    """As before the first frame, whose stamp is the time of day."""
    estimator.belief(0.0)
    estimator.apply("wheels", motion(1.7e9, 1.7e9 + 0.1, 0.1))

    assert sigma_m(estimator.belief(1.7e9 + 0.1)) == pytest.approx(0.01, rel=0.02)
