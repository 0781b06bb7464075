"""Few of many, evenly, and always the newest."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.geometry import Trajectory
from trailmark.watching.thinning import Thinned, every_nth


@pytest.mark.parametrize("n", [1, 2, 9, 10, 11, 12, 57, 1000])
def test_what_is_kept_is_even_and_has_the_newest(n: int) -> None:
    thinned, let_go = Thinned[int](10), []
    for item in range(n):
        let_go += thinned.add(item)

    kept = thinned.kept
    steps = np.diff(kept[:-1])
    assert sorted(kept + let_go) == list(range(n))
    assert kept[-1] == n - 1
    assert len(kept) <= 10
    assert len(kept) >= min(n, 5)
    assert len(set(steps.tolist())) <= 1
    assert kept[0] == 0


def test_a_trajectory_keeps_its_ends() -> None:
    way = Trajectory(np.arange(100.0), np.zeros((100, 3)))

    thinned = every_nth(way, 7)

    assert len(thinned) == 7
    assert thinned.stamps_s[[0, -1]].tolist() == [0.0, 99.0]
    assert every_nth(way, 100) is way
