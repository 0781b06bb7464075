"""Kernels of scan matching that leave out work: they choose and refine as those that leave out none."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from trailmark.geometry import Pose2
from trailmark_omni_surf import ScanMap, SearchWindow
from trailmark_omni_surf.laser.kernels import cheapest_starts, score_starts
from trailmark_omni_surf.laser.matching import FINE_GATES_M, refine_all

Points = npt.NDArray[np.float64]


@pytest.fixture(scope="module")
def scan() -> Points:
    side = np.linspace(-2.0, 2.0, 60)
    walls = [(side, np.full(60, -1.5)), (side, np.full(60, 1.5)), (np.full(60, -2.0), side * 0.75)]
    return np.concatenate([np.stack(wall, axis=1) for wall in walls])


@pytest.fixture(scope="module")
def room(scan: Points) -> ScanMap:
    return ScanMap.from_scans([scan], [Pose2()])


@pytest.mark.parametrize("n_best", [1, 12, 10_000])
def test_the_cheapest_starts_are_those_of_all_costs(room: ScanMap, scan: Points, n_best: int) -> None:
    starts = SearchWindow().offsets() + np.array([0.31, -0.12, 0.07])
    raster = (room.origin, room.cell_m, room.distance_m, room.reach_m)

    rows = cheapest_starts(scan, starts, *raster, n_best)

    np.testing.assert_array_equal(rows, np.argsort(score_starts(scan, starts, *raster), kind="stable")[:n_best])


def test_of_equal_starts_the_first_is_kept(room: ScanMap, scan: Points) -> None:
    starts = np.tile(np.array([[0.4, 0.0, 0.0], [0.0, 0.0, 0.0]]), (3, 1))

    rows = cheapest_starts(scan, starts, room.origin, room.cell_m, room.distance_m, room.reach_m, 4)

    assert rows.tolist() == [1, 3, 5, 0]


def test_poses_are_refined_as_each_alone(room: ScanMap, scan: Points) -> None:
    starts = np.array([[0.1, 0.05, 0.03], [-0.08, 0.1, -0.05], [40.0, 0.0, 0.0]])

    together = refine_all(room, scan, starts, FINE_GATES_M, True)

    alone = [refine_all(room, scan, start[np.newaxis], FINE_GATES_M, True)[0] for start in starts]
    np.testing.assert_array_equal(together, alone)
    np.testing.assert_allclose(together[:2], 0.0, atol=5e-3)
    np.testing.assert_array_equal(together[2], starts[2])  # nothing of the map is near: it stays


def test_offsets_are_shared_and_cannot_be_changed() -> None:
    offsets = SearchWindow().offsets()

    assert SearchWindow().offsets() is offsets
    with pytest.raises(ValueError, match="read-only"):
        offsets[0] = 0.0
