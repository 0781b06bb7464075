"""A run that ended well and is worth nothing is warned of, with what to do; a good run is not."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from trailmark.evaluation import evaluate_run, read_run, run_warnings
from trailmark.geometry import Trajectory

Write = Callable[..., Path]


def row(stamp: float, source: str, kind: str, status: str, reason: str = "") -> str:
    numbers = "0,0,0,1,0,0,1,0,1" if kind != "lost" else ",,,,,,,,"
    return f"{stamp},{source},{kind},,{stamp},{numbers},{status},,,{reason},"


def told(folder: Path) -> list[str]:
    return [str(warning) for warning in run_warnings(read_run(folder))]


def test_a_good_run_is_not_warned_of(write_run: Write, straight: Trajectory) -> None:
    rows = [row(t, "cam", "fix", "accepted") for t in straight.stamps_s.tolist()]
    rows[3] = row(0.3, "cam", "lost", "unused", "dark")

    assert told(write_run({"cam": straight, "fused": straight}, estimates=rows)) == []


def test_a_localizer_that_was_lost_all_the_time_is_named_with_its_reason(
    write_run: Write, straight: Trajectory
) -> None:
    rows = [row(t, "cam", "lost", "unused", f"no match: error {t} of 22") for t in (0.1, 0.2, 0.3)]
    rows += [row(t, "wheels", "fix", "accepted") for t in (0.1, 0.2)]

    (warning,) = told(write_run({"cam": straight, "wheels": straight}, estimates=rows))

    assert warning.startswith("cam: was lost all the time, 3 of 3 (no match: error 0.1 of 22)")


@pytest.mark.parametrize("n_bad", [5, 6])
def test_more_than_a_twentieth_of_refused_estimates_is_told(write_run: Write, straight: Trajectory, n_bad: int) -> None:
    rows = [row(0.1 * k, "cam", "fix", "refused" if k < n_bad else "accepted", "equal stamp") for k in range(100)]

    found = told(write_run({"cam": straight}, estimates=rows))

    assert [text.partition(";")[0] for text in found] == (
        ["cam: 6 of 100 estimates were refused (equal stamp)"] if n_bad == 6 else []
    )


def test_late_estimates_are_told_with_what_to_do(write_run: Write, straight: Trajectory) -> None:
    rows = [row(0.1 * k, "cam", "fix", "late" if k < 20 else "accepted", "older than the history") for k in range(100)]

    (warning,) = told(write_run({"cam": straight}, estimates=rows))

    assert "20 of 100 estimates were late" in warning
    assert "make it faster" in warning


@pytest.mark.parametrize(("n_gated", "n_told"), [(30, 0), (60, 1)])
def test_a_localizer_that_contradicts_the_belief_most_of_the_time_is_told(
    write_run: Write, straight: Trajectory, n_gated: int, n_told: int
) -> None:
    rows = [row(0.1 * k, "tags", "fix", "gated" if k < n_gated else "accepted", "NIS 99 of 3 dof") for k in range(100)]

    found = told(write_run({"tags": straight}, estimates=rows))

    assert len(found) == n_told
    assert all(text.startswith("tags: 60 of 100 estimates were gated") and "mounting" in text for text in found)


def test_a_run_that_used_nothing_says_so(write_run: Write, straight: Trajectory) -> None:
    rows = [row(0.1 * k, "cam", "fix", "unused") for k in range(10)]

    assert any("no estimate was used" in text for text in told(write_run({"cam": straight}, estimates=rows)))


def test_a_localizer_that_never_spoke_is_named(write_run: Write, straight: Trajectory) -> None:
    rows = [row(0.1 * k, "cam", "fix", "accepted") for k in range(10)]
    nothing = Trajectory([], np.empty((0, 3)))

    (warning,) = told(write_run({"cam": straight, "divs": nothing}, estimates=rows))

    assert warning.startswith("divs: said nothing in the whole run")


@pytest.mark.parametrize(("n_looks", "n_told"), [(7, 0), (0, 1)])
def test_a_localizer_that_remembers_need_not_speak_while_a_path_is_taught(
    write_run: Write, straight: Trajectory, n_looks: int, n_told: int
) -> None:
    rows = [row(0.1 * k, "cam", "motion", "accepted") for k in range(10)]
    folder = write_run({"cam": straight, "divs": Trajectory([], np.empty((0, 3)))}, estimates=rows)
    counters = {"localizer.divs.looks": n_looks, "localizer.cam.accepted": 10}
    (folder / "run.json").write_text(json.dumps({"status": "done", "mode": "teach", "counters": counters}))

    assert len([text for text in told(folder) if text.startswith("divs")]) == n_told


@pytest.mark.parametrize(
    ("stamps", "poses", "fact"),
    [
        (1.0, (1000.0, 1.0), "it drives 1e+03 m/s"),  # millimetres
        (1000.0, (1.0, 1.0), "its poses are 100 s apart"),  # stamps in milliseconds
        (1e9, (1.0, 1.0), "its poses are 1e+08 s apart"),  # in nanoseconds
        (1e-3, (1.0, 1.0), "it drives 1e+03 m/s"),  # stamps in kiloseconds
    ],
)
def test_units_that_cannot_be_are_told(
    write_run: Write, straight: Trajectory, stamps: float, poses: tuple[float, float], fact: str
) -> None:
    odd = Trajectory(straight.stamps_s * stamps, straight.poses * [poses[0], poses[0], poses[1]])

    (warning,) = told(write_run({"cam": odd}))

    assert warning.startswith(f"cam: {fact}")


def test_degrees_for_radians_are_told(write_run: Write, figure_eight: Trajectory) -> None:
    headings = np.degrees(np.unwrap(figure_eight.headings))
    odd = Trajectory(figure_eight.stamps_s, np.column_stack([figure_eight.positions, headings]))

    assert any("look for degrees" in text for text in told(write_run({"cam": odd})))


@pytest.mark.parametrize(("scale", "is_odd"), [(0.4, True), (4e-4, False), (4e-7, True)])
def test_a_picture_that_shows_200_m_of_ground_is_told(
    write_run: Write, straight: Trajectory, scale: float, is_odd: bool
) -> None:
    folder = write_run({"cam": straight})
    sensors = {"floor": {"size": [512, 480], "calibration": {"metres_per_pixel": [scale, scale]}}, "wheels": None}
    (folder / "run.json").write_text(json.dumps({"status": "done", "sensors": sensors}))

    assert [text.partition(":")[0] for text in told(folder)] == (["floor"] if is_odd else [])


def told_of_ways(write_run: Write, ways: dict[str, Trajectory], fixes: tuple[str, ...] = ()) -> list[str]:
    """Return what is said of localizers that tell the same stretch, by motions but for those named."""
    kinds = {name: "fix" if name in fixes else "motion" for name in ways}
    rows = [row(t, name, kinds[name], "accepted") for name in ways for t in (0.1, 0.2, 0.3)]
    rows += [row(0.4, name, "lost", "unused", "dark") for name in ways]
    return [text for text in told(write_run(ways, estimates=rows)) if "(metres_per_pixel, depth_factor)" in text]


def seen_as(way: Trajectory, scale: float = 1.0, yaw: float = 0.0) -> Trajectory:
    """Return what a sensor tells whose scale, or whose yaw, is not what the localizer believes."""
    turned = way.poses[:, 0] + 1j * way.poses[:, 1]
    turned = scale * turned * np.exp(1j * (yaw + 0.3))  # its frame is its own
    return Trajectory(way.stamps_s, np.column_stack([turned.real, turned.imag, way.headings + 0.3]))


@pytest.mark.parametrize("scale", [5.0, 0.2, 1000.0, 0.001])
def test_a_scale_that_no_other_motion_shares_is_told(write_run: Write, figure_eight: Trajectory, scale: float) -> None:
    way = Trajectory(figure_eight.stamps_s, figure_eight.poses * [100.0, 100.0, 1.0])  # 1000th of it is 1 m and more

    (warning,) = told_of_ways(write_run, {"floor": seen_as(way, scale), "wheels": way})

    assert warning.startswith(f"floor: it comes {scale:.3g} times as far as 'wheels'; one of the two is wrong: look at")
    assert "metres_per_pixel" in warning


@pytest.mark.parametrize(("yaw_deg", "shown"), [(180.0, "180"), (90.0, "90"), (-90.0, "-90")])
def test_a_camera_that_is_mounted_another_way_round_is_told(
    write_run: Write, figure_eight: Trajectory, yaw_deg: float, shown: str
) -> None:
    turned = seen_as(figure_eight, yaw=np.radians(yaw_deg))

    (warning,) = told_of_ways(write_run, {"floor": turned, "wheels": figure_eight})

    assert f"its forward is turned by {shown} deg against that of 'wheels'" in warning.replace("-180", "180")
    assert "yaw_deg" in warning


def test_of_three_the_one_that_contradicts_both_is_named(write_run: Write, figure_eight: Trajectory) -> None:
    ways = {"wheels": figure_eight, "floor": seen_as(figure_eight, 5.0), "laser": seen_as(figure_eight, 1.02)}

    (warning,) = told_of_ways(write_run, ways)

    assert warning.startswith("floor: it comes 4.9 times as far as 'laser' and 'wheels'")
    assert "one of the two" not in warning


@pytest.mark.parametrize("scale", [1.0, 1.5, 0.7])
def test_ways_of_about_the_same_length_are_none_of_it(write_run: Write, figure_eight: Trajectory, scale: float) -> None:
    assert told_of_ways(write_run, {"floor": seen_as(figure_eight, scale), "wheels": figure_eight}) == []


def test_one_that_stands_still_is_not_taken_for_a_scale(
    write_run: Write, figure_eight: Trajectory, static: Trajectory
) -> None:
    still = Trajectory(figure_eight.stamps_s, 0.0 * figure_eight.poses)

    assert told_of_ways(write_run, {"floor": still, "wheels": figure_eight}) == []


@pytest.mark.parametrize("with_heading", [True, False])
@pytest.mark.parametrize("sigma_m", [0.02, 0.1, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("every", [1, 4, 20])  # of a pose each 0.05 s
def test_fixes_do_not_contradict_wheels_however_they_scatter(
    write_run: Write,
    figure_eight: Trajectory,
    noisy: Callable[..., Trajectory],
    sigma_m: float,
    every: int,
    with_heading: bool,
) -> None:
    thinned = Trajectory(figure_eight.stamps_s[::every], figure_eight.poses[::every] * [1.0, 1.0, with_heading])
    ways = {"wheels": figure_eight, "satellites": noisy(thinned, sigma_m, 0.05 * with_heading)}

    assert told_of_ways(write_run, ways, fixes=("satellites",)) == []


def test_motions_between_fixes_are_not_compared(write_run: Write, figure_eight: Trajectory) -> None:
    ways = {"wheels": figure_eight, "marks": seen_as(figure_eight, 5.0)}
    rows = [row(t, name, "motion", "accepted") for name in ways for t in (0.1, 0.2)]
    rows.append(row(0.3, "marks", "fix", "accepted"))

    assert told(write_run(ways, estimates=rows)) == []


def test_warnings_stand_in_the_document_of_the_run(write_run: Write, straight: Trajectory) -> None:
    rows = [row(t, "cam", "lost", "unused", "dark") for t in (0.1, 0.2)]

    document = evaluate_run(write_run({"cam": straight}, estimates=rows))

    assert document["warnings"][0]["about"] == "cam"
    assert document["sources"]["cam"]["lost_reasons"] == {"dark": 2}


@pytest.mark.parametrize(("n", "fact"), [(0, None), (1, "the robot touched something;"), (3, "something 3 times;")])
def test_a_robot_that_touched_something_has_not_come_through(
    write_run: Write, straight: Trajectory, n: int, fact: str | None
) -> None:
    folder = write_run({"fused": straight})
    (folder / "run.json").write_text(json.dumps({"counters": {"source.robot.collisions": n, "frames": 9}}))

    found = told(folder)

    assert [fact in text for text in found] == ([] if fact is None else [True])


@pytest.mark.parametrize(("counters", "n"), [({"estimator.overlaps.vo": 28}, 1), ({"estimator.overlaps": 3}, 0)])
def test_motions_that_overlap_are_told_at_the_end_by_the_localizers_name(
    write_run: Write, straight: Trajectory, counters: dict[str, int], n: int
) -> None:
    """Stamps that are not exact make short overlaps, which are counted and not told."""
    folder = write_run({"fused": straight})
    (folder / "run.json").write_text(json.dumps({"counters": counters}))

    found = told(folder)

    assert len(found) == n
    assert all(text.startswith("vo: 28 of its motions began before another one ended") for text in found)


@pytest.mark.parametrize(("n", "n_told"), [(5, 0), (6, 1), (1900, 1)])
def test_readings_that_a_busy_localizer_never_saw_are_told(
    write_run: Write, straight: Trajectory, n: int, n_told: int
) -> None:
    rows = [row(0.1 * k, "cam", "motion", "accepted") for k in range(100)]
    folder = write_run({"cam": straight}, estimates=rows)
    (folder / "run.json").write_text(json.dumps({"counters": {"localizer.cam.overwritten": n}}))

    found = told(folder)

    assert len(found) == n_told
    assert all(text.startswith(f"cam: {n} of {n + 100} readings were overwritten") for text in found)


@pytest.mark.parametrize("rate_hz", [5.0, 20.0, 50.0, 100.0, 400.0])
@pytest.mark.parametrize("unit", [1e3, 1e9])
def test_stamps_in_other_units_are_told_at_every_rate(write_run: Write, rate_hz: float, unit: float) -> None:
    stamps_s = np.arange(200) / rate_hz
    driven = Trajectory(stamps_s * unit, np.column_stack([0.5 * stamps_s, np.zeros((200, 2))]))

    (warning,) = told(write_run({"wheels": driven}))

    assert "stamps are seconds: are these milli- or nanoseconds?" in warning


@pytest.mark.parametrize("interval_s", [0.02, 0.5, 2.0, 10.0])
@pytest.mark.parametrize("sigma_m", [0.0, 0.005, 0.1])
def test_a_robot_that_rests_or_is_rarely_seen_has_no_wrong_stamps(
    write_run: Write, noisy: Callable[..., Trajectory], interval_s: float, sigma_m: float
) -> None:
    stamps_s = interval_s * np.arange(101)
    rests = noisy(Trajectory(stamps_s, np.tile([2.0, -1.0, 0.5], (101, 1))), sigma_m)
    drives = Trajectory(stamps_s, np.column_stack([0.05 * stamps_s, np.zeros((101, 2))]))

    assert told(write_run({"rests": rests, "drives": drives})) == []


@pytest.mark.parametrize("key", ["source.robot.repeated", "source.robot.own.repeated"])
@pytest.mark.parametrize(("n", "n_told"), [(5, 0), (6, 1), (100, 1)])
def test_readings_of_equal_stamps_are_told(
    write_run: Write, straight: Trajectory, key: str, n: int, n_told: int
) -> None:
    folder = write_run({"fused": straight})
    (folder / "run.json").write_text(json.dumps({"counters": {key: n, "source.robot.frames": 100}}))

    found = told(folder)

    assert len(found) == n_told
    assert all(text.startswith(f"robot: {n} of {n + 100} readings had the stamp of the one before") for text in found)
