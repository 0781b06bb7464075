"""What is counted of drives by the paper's own steering: first shifts after a silence, and who came back."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from trailmark.estimates import Lost, PathOffset
from trailmark.geometry import Pose2, Trajectory
from trailmark.paths import Path as TaughtPath
from trailmark.paths import Waypoint
from trailmark_papers.perroni2014.drives import AFTERNOON, Deviation
from trailmark_papers.perroni2014.own_steering import CASES, FirstShifts, SteeredDrive, _rows_of

PATH = TaughtPath(Waypoint(k, 0.5 * k, Pose2(0.5 * k, 0.0, 0.0)) for k in range(9))


def said(stamp_s: float, shift_columns: float) -> PathOffset:
    return PathOffset(stamp_s, stamp_s, 0.0, 0.0, np.eye(3), {"shift_columns": shift_columns})


def keep(*answers: PathOffset | Lost, source: str = "faithful") -> FirstShifts:
    keeper = FirstShifts()
    for answer in answers:
        keeper(SimpleNamespace(), SimpleNamespace(estimates=[SimpleNamespace(source=source, estimate=answer)]))  # type: ignore[arg-type]
    return keeper


def drive(end_m: float, sides: list[bool], arrived: bool = True) -> SteeredDrive:
    stations_m = np.linspace(0.0, 10.0, 5)
    lateral_m = np.array([0.0, 0.1, 0.1, 0.1, 0.0]) + np.array([0.0, 0.0, 0.0, 0.0, end_m])
    return SteeredDrive(Deviation(stations_m, lateral_m, np.zeros(5), arrived), sides)


def test_of_each_silence_the_first_shift_after_it_is_kept() -> None:
    keeper = keep(Lost(0.1, "turning"), said(0.2, 4.0), said(0.3, 5.0), Lost(0.4, "turning"), said(0.5, -3.0))

    assert keeper.shifts == [(0.2, 4.0), (0.5, -3.0)]
    assert keep(said(0.2, 4.0), source="wheels").shifts == []


@pytest.mark.parametrize(("shift_columns", "is_right"), [(4.0, True), (-4.0, False)])
def test_a_shift_is_of_the_right_side_where_it_has_the_sign_of_the_true_drift(
    shift_columns: float, is_right: bool
) -> None:
    """Turned to the left and left of the path, what was taught is seen farther right: a positive shift."""
    way = Trajectory.from_poses((0.5 * k, Pose2(0.5 * k, 0.2, math.radians(5.0))) for k in range(4))

    assert keep(said(1.0, shift_columns)).sides(way, PATH) == [is_right]


def test_a_view_that_is_hardly_displaced_has_no_side() -> None:
    way = Trajectory.from_poses((0.5 * k, Pose2(0.5 * k, 0.01, 0.0)) for k in range(4))

    assert keep(said(1.0, -7.0)).sides(way, PATH) == []


def test_rows_count_the_drives_that_came_back_and_the_first_shifts_of_all() -> None:
    rows = {row.item: row for row in _rows_of("x", [drive(0.1, [True, True, False]), drive(0.4, [True])])}

    assert rows["x: came back to the path"].ours == 50.0
    assert rows["x: offset at the end, max"].ours == pytest.approx(0.4)
    assert rows["x: first shift after a silence, of the right side"].ours == 75.0
    assert rows["x: first shift after a silence, of the right side"].n == 4
    assert not drive(0.1, [], arrived=False).came_back


def test_one_thing_is_changed_at_a_time() -> None:
    printed, in_peace, our_shift = CASES.values()

    assert (printed.localizer, printed.options) == ({}, AFTERNOON)
    assert (in_peace.localizer, in_peace.options) == ({}, {})
    assert set(our_shift.localizer) == {"shift", "confidence"}
    assert our_shift.options == printed.options
