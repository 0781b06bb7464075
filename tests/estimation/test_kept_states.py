"""What is older than the history is not kept, but for where the longest test windows begin."""

from __future__ import annotations

import gc

from trailmark.estimates import Fix
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman.windows import APART_S, LONGEST_S
from trailmark.geometry import Pose2

from .conftest import GOOD, kalman, motion

HISTORY_S, RATE_HZ, LASTS_S = 20.0, 10.0, 55.0


def test_states_older_than_history_and_windows_are_let_go() -> None:
    gc.collect()
    before = {id(one) for one in gc.get_objects() if type(one) is FilterState}
    estimator = kalman(history_s=HISTORY_S)
    for i in range(int(LASTS_S * RATE_HZ)):
        for source in ("wheels", "vo"):
            estimator.apply(source, motion(i / RATE_HZ, (i + 1) / RATE_HZ, 0.05))
        estimator.apply("map", Fix((i + 1) / RATE_HZ, Pose2(0.05 * (i + 1)), GOOD))
        estimator.belief((i + 1) / RATE_HZ)

    gc.collect()
    ages_s = [LASTS_S - one.stamp_s for one in gc.get_objects() if type(one) is FilterState and id(one) not in before]
    assert max(ages_s) < HISTORY_S + LONGEST_S + APART_S + 1.5
    assert sum(age_s > HISTORY_S + 1.5 for age_s in ages_s) < 3 * LONGEST_S / APART_S


def test_motions_are_let_go_without_a_search_for_garbage() -> None:
    """One that refers to itself, by what it is a part of, waits for the collector with all of its parts."""
    estimator = kalman(history_s=1.0)
    gc.collect()
    gc.disable()
    try:
        for i in range(200):
            estimator.apply("wheels", motion(i / RATE_HZ, (i + 1) / RATE_HZ, 0.05))
        assert gc.collect() < 20
    finally:
        gc.enable()
