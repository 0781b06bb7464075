"""How localizers differ from each other: known answers, and what is not compared."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.errors import DataError
from trailmark.evaluation.estimates_table import EstimateTable, table_of_rows
from trailmark.report.differences import Difference, localizer_differences

N = 400


def told(source: str, kind: str, stamps_s, numbers, sigmas=(0.01, 0.01, 0.001), *, since_s=None, status="accepted"):
    """Return rows of ``estimates.csv``: what a localizer said, with the standard deviations that it states."""
    x, y, t = (0.0 if sigma is None else sigma**-2 for sigma in sigmas)
    begin_s = since_s if since_s is not None else [""] * len(stamps_s)
    for stamp_s, begin, (a, b, c) in zip(stamps_s, begin_s, numbers, strict=True):
        row = {
            "arrived_s": stamp_s,
            "since_s": begin,
            "stamp_s": stamp_s,
            "x": a,
            "y": b,
            "theta": c,
            "nis": "",
            "dof": "",
        }
        row |= {"info_xx": x, "info_xy": 0, "info_xt": 0, "info_yy": y, "info_yt": 0, "info_tt": t}
        row |= {"source": source, "kind": kind, "status": status, "reason": ""}
        yield "a row", {name: str(value) for name, value in row.items()}


def table(*rows) -> EstimateTable:
    return table_of_rows(row for several in rows for row in several)


def motions(source: str, rate_hz: float, speed_mps: float, turn_radps: float, noise=(0.0, 0.0, 0.0), **keys):
    """Return motions of a robot on a circle."""
    rng = np.random.default_rng(len(source))
    dt = 1.0 / rate_hz
    ends = dt * np.arange(1, int(20 * rate_hz) + 1)
    radius = speed_mps / turn_radps if turn_radps else math.inf
    angle = turn_radps * dt
    step = [radius * math.sin(angle), radius * (1 - math.cos(angle)), angle] if turn_radps else [speed_mps * dt, 0, 0]
    numbers = np.array(step) + np.array(noise) * rng.standard_normal((len(ends), 3))
    return told(source, "motion", ends, numbers, since_s=ends - dt, **keys)


def only(found: list[Difference]) -> Difference:
    (one,) = found
    return one


def test_motions_of_other_rates_on_one_circle_do_not_differ() -> None:
    found = only(localizer_differences(table(motions("wheels", 40, 0.5, 0.3), motions("camera", 7, 0.5, 0.3))))

    assert (found.one, found.other, found.kind) == ("wheels", "camera", "motion")
    np.testing.assert_allclose(found.largest, 0.0, atol=2e-4)  # a circle between two readings is a line


def test_a_scale_shows_as_way_over_a_second() -> None:
    found = only(localizer_differences(table(motions("wheels", 20, 0.55, 0.0), motions("camera", 10, 0.5, 0.0))))

    np.testing.assert_allclose(found.mean, [0.05, 0.0, 0.0], atol=1e-9)


def test_who_differs_as_both_state_has_one() -> None:
    rng = np.random.default_rng(3)
    stamps_s = 0.1 * np.arange(N)
    one = rng.standard_normal((N, 3)) * [0.03, 0.03, 0.003]
    other = rng.standard_normal((N, 3)) * [0.01, 0.01, 0.001]

    found = only(
        localizer_differences(
            table(told("a", "fix", stamps_s, one, (0.03, 0.03, 0.003)), told("b", "fix", stamps_s, other))
        )
    )

    assert found.nees_per_dof == pytest.approx(1.0, abs=0.15)
    np.testing.assert_allclose(found.rms, np.sqrt([1e-3, 1e-3, 1e-5]), rtol=0.15)


def test_offsets_of_other_stamps_are_interpolated_and_headings_turn_the_short_way() -> None:
    fast_s, slow_s = 0.1 * np.arange(101), 0.05 + 0.3 * np.arange(30)
    heading = [math.pi - 0.02, -math.pi + 0.01]
    fast = [(0.5 * s, 0.02 * s, heading[k % 2]) for k, s in enumerate(fast_s)]
    slow = [(0.5 * s + 0.3, 0.02 * s - 0.1, math.pi - 0.005) for s in slow_s]

    found = only(
        localizer_differences(table(told("a", "pathoffset", fast_s, fast), told("b", "pathoffset", slow_s, slow)))
    )

    assert found.n == 30
    np.testing.assert_allclose(found.mean, [-0.3, 0.1, 0.0], atol=1e-9)


def test_what_one_does_not_measure_is_not_compared() -> None:
    stamps_s = 0.1 * np.arange(20)
    far, near = [(5.0, 0.1, 0.0)] * 20, [(0.0, 0.0, 0.0)] * 20

    found = only(
        localizer_differences(
            table(
                told("a", "pathoffset", stamps_s, far, (None, 0.1, 0.1)),
                told("b", "pathoffset", stamps_s, near, (0.1, 0.1, 0.1)),
            )
        )
    )

    assert math.isnan(found.rms[0])
    assert found.rms[1] == pytest.approx(0.1)
    assert found.document()["rms_m"] == [None, pytest.approx(0.1)]


def test_nobody_is_compared_across_a_gap_with_what_was_refused_or_with_another_kind() -> None:
    stamps_s, late_s = 0.1 * np.arange(20), 0.05 + 2.0 * np.arange(10)
    zeros = [(0.0, 0.0, 0.0)]  # of the gappy one the first alone lies between two that are near

    found = localizer_differences(
        table(
            told("a", "fix", stamps_s, zeros * 20),
            told("gappy", "fix", late_s, zeros * 10),
            told("refused", "fix", stamps_s, zeros * 20, status="refused"),
            told("offsets", "pathoffset", stamps_s, zeros * 20),
        )
    )

    assert found == []


def circle(source: str, rate_hz: float, until_s: float, sigma: float = 0.005, late_s: float = 0.0):
    """Return honest fixes on a circle of 1 m at 0.5 rad/s."""
    rng = np.random.default_rng(int(100 * rate_hz))
    stamps_s = late_s + np.arange(0.0, until_s, 1.0 / rate_hz)
    angle = 0.5 * stamps_s
    poses = np.column_stack([np.sin(angle), 1.0 - np.cos(angle), angle])
    return told(source, "fix", stamps_s, poses + sigma * rng.standard_normal(poses.shape), (sigma,) * 3)


@pytest.mark.parametrize(("rates_hz", "until_s"), [((10.0, 1.0), (300.0, 900.0)), ((10.0, 10.0 / 3.0), (200.0, 200.0))])
def test_honest_poses_of_other_rates_and_lengths_differ_as_they_say(rates_hz, until_s) -> None:
    """What lies between two poses is on an arc, and surer than either; who has more rows may speak more seldom."""
    rows = [circle(name, *of, late_s=at) for name, of, at in zip("ab", zip(rates_hz, until_s), (0.0, 0.05))]

    found = only(localizer_differences(table(*rows)))

    assert found.nees_per_dof == pytest.approx(1.0, abs=0.2)
    assert found.rms[0] < 0.008


def test_a_path_that_closes_is_not_compared_where_its_station_begins_anew() -> None:
    stamps_s = 0.1 * np.arange(300)
    along = 0.5 * stamps_s
    one = [(a % 5.0, 0.0, 0.0) for a in along]
    other = [((a + 0.03) % 5.0, 0.0, 0.0) for a in along]

    found = only(
        localizer_differences(
            table(told("a", "pathoffset", stamps_s, one), told("b", "pathoffset", stamps_s + 0.04, other))
        )
    )

    assert found.n > 280
    np.testing.assert_allclose(found.largest, [0.01, 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("sigmas", [(None, None, None), (1e200, 1e200, 1e200)])
def test_who_measures_nothing_is_compared_with_nobody(sigmas) -> None:
    stamps_s = 0.1 * np.arange(30)
    zeros = [(0.0, 0.0, 0.0)] * 30

    assert (
        localizer_differences(table(told("a", "fix", stamps_s, zeros, sigmas), told("b", "fix", stamps_s, zeros))) == []
    )


def test_motions_with_a_gap_between_each_two_are_compared() -> None:
    since_s = 2.0 * np.arange(4000)
    rows = [(0.6, 0.0, 0.0)] * len(since_s)
    both = [told(name, "motion", since_s + 1.2, rows, since_s=since_s) for name in ("a", "b")]

    assert only(localizer_differences(table(*both))).n == len(since_s)


def test_equal_stamps_are_compared_however_rare_they_are() -> None:
    stamps_s = 2.0 * np.arange(12)

    found = only(
        localizer_differences(
            table(
                told("a", "fix", stamps_s, [(1.0, 0.0, 0.0)] * 12),
                told("b", "fix", stamps_s + 4e-7, [(0.0, 0.0, 0.0)] * 12),
            )
        )
    )

    assert found.n == 12
    np.testing.assert_allclose(found.mean, [1.0, 0.0, 0.0])


def test_the_circle_about_a_landmark_counts_neither_as_a_number_nor_as_a_difference() -> None:
    """Fixes of one landmark, range and bearing: what they say of the circle is anything, and two numbers are left."""
    rng = np.random.default_rng(5)
    stamps_s = 0.1 * np.arange(N)
    rows = np.array([[-1.0, 0.0, 0.0], [0.0, -1.0 / 3.0, -1.0]])  # the landmark 3 m ahead
    information = rows.T @ np.diag([0.05**-2, 0.02**-2]) @ rows
    blind = np.array([0.0, -3.0, 1.0])
    numbers = (rng.standard_normal((N, 2)) * [0.05, 0.02]) @ np.linalg.pinv(rows).T + rng.standard_normal(
        (N, 1)
    ) * blind
    poses = table(
        told("landmark", "fix", stamps_s, numbers), told("laser", "fix", stamps_s, np.zeros((N, 3)), (1e-3, 1e-3, 1e-3))
    )
    is_landmark = poses.source == "landmark"
    poses.information[is_landmark] = information

    found = only(localizer_differences(poses))

    assert found.nees_per_dof == pytest.approx(1.0, abs=0.15)
    assert found.rms[0] == pytest.approx(0.05, rel=0.15)
    assert math.isnan(found.rms[1])
    assert math.isnan(found.rms[2])


def test_motions_that_end_elsewhere_differ_as_they_say() -> None:
    """One a second and one every 0.9 s, honest both: what lies in a window by a part counts by its share, squared."""
    rng = np.random.default_rng(9)
    noise = np.array([0.02, 0.02, 0.004])

    def of(source: str, every_s: float):
        ends = every_s * np.arange(1, int(400 / every_s))
        numbers = np.array([0.4 * every_s, 0.0, 0.0]) + noise * rng.standard_normal((len(ends), 3))
        return told(source, "motion", ends, numbers, tuple(noise), since_s=ends - every_s)

    found = only(localizer_differences(table(of("slow", 1.0), of("quick", 0.9))))

    assert found.nees_per_dof == pytest.approx(1.0, abs=0.2)


def test_a_motion_of_which_one_row_lacks_the_heading_is_compared_in_all_other_windows() -> None:
    ends = 0.1 * np.arange(1, 401)
    camera = list(told("camera", "motion", ends, [(0.05, 0.0, 0.0)] * 400, since_s=ends - 0.1))
    camera[200][1]["info_tt"] = "0"

    found = only(localizer_differences(table(camera, motions("wheels", 20, 0.5, 0.0))))

    assert found.rms[2] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("rate_hz", [5, 20])
def test_motions_with_a_gap_are_compared_on_either_side_of_it(rate_hz: float) -> None:
    """The one with the gap speaks more seldom than the other, or more often."""
    ends = 0.1 * np.arange(1, 201)
    kept = (ends < 5.0) | (ends > 8.05)
    camera = told("camera", "motion", ends[kept], [(0.05, 0.0, 0.0)] * int(kept.sum()), since_s=ends[kept] - 0.1)

    found = only(localizer_differences(table(camera, motions("wheels", rate_hz, 0.5, 0.0))))

    assert 14 <= found.n <= 16
    np.testing.assert_allclose(found.largest, 0.0, atol=1e-9)


def test_only_the_reference_is_compared_with() -> None:
    rows = table(*(motions(name, 10, 0.5, 0.0) for name in ("a", "b", "c")))

    assert [(one.one, one.other) for one in localizer_differences(rows, "b")] == [("a", "b"), ("c", "b")]
    assert len(localizer_differences(rows)) == 3
    with pytest.raises(DataError, match="no localizer 'd' said anything; there are a, b, c"):
        localizer_differences(rows, "d")
