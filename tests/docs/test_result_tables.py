"""Programs that make tables of pages: what is done is kept and not done again, and rows become lines."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.geometry import Trajectory


@pytest.fixture(scope="module")
def places(load_script: Callable[[str], ModuleType]) -> ModuleType:
    return load_script("benchmarks/foreign_places.py")


def test_places_that_are_done_are_summed_and_not_done_again(
    places: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = []

    def starts(name: str, *told_s: float | None) -> Callable[[], Iterator[object]]:
        def yielded() -> Iterator[object]:
            begun.append(name)
            for at_s in told_s:
                yield places.Start("street", "its own", None if at_s is None else True, at_s)
            yield places.Start("street", "another place", False, 1.0)

        return yielded

    streets = {"street 1": starts("street 1", 1.0, None), "street 2": starts("street 2", 9.0)}
    monkeypatch.setattr(places, "METHODS", {"divs": lambda is_quick: streets})
    kept = tmp_path / "kept.jsonl"

    only_one = places.summed(list(places.measured(["divs"], ["street 1"], False, kept)))
    both = places.summed(list(places.measured(["divs"], [], False, kept)))

    assert begun == ["street 1", "street 2"]
    assert only_one[0].line() == "| divs | street | its own | 1, 1 within 3 s | 0 | 2 |"
    assert [row.line() for row in both] == [
        "| divs | street | its own | 2, 1 within 3 s | 0 | 3 |",
        "| divs | street | another place | - | 2 | 2 |",
    ]


def test_a_robot_is_a_line_with_ratios_to_its_clean_run(load_script: Callable[[str], ModuleType]) -> None:
    tables = load_script("benchmarks/fusion_tables.py")
    clean = {"robot": 1, "case": "clean", "rmse_m": 0.2, "max_m": 1.0, "settled_s": 0.0, "settled_rmse_m": 0.2}
    late = clean | {"case": "late", "rmse_m": 0.3}

    assert tables.robots([clean, late]).splitlines()[-1] == "| R1 | 0.200 (0.26, 0.18) | 1.00 | 1.50 | - | - | - |"


def test_only_what_was_measured_of_a_drive_stands_in_its_line(load_script: Callable[[str], ModuleType]) -> None:
    winding = load_script("benchmarks/divs_winding.py")
    answers = winding.Answers([0.1, 0.2, 0.3], 3)
    rows = [
        *winding._answer_rows("street, same light", "divs", answers, 0.25, 10),
        *winding._answer_rows("street, same light", "patch_ncc", answers, 0.25, 10),
        *winding._start_rows("street", [(1.0, 0.1), (2.0, 5.0), (None, 0.0), (3.0, 0.0)]),
    ]

    lines = winding.markdown(rows).splitlines()

    assert lines[2] == "| street, same light | `divs` | 0.200 | 0.290 | 100.0 % | 100.0 % | met |"
    assert lines[3].endswith("| 100.0 % | 100.0 % |  |")  # no bar is asked of a peer
    assert lines[-1] == "| street, unknown start | 50.0 % | 25.0 % | 4 |"


@pytest.fixture(scope="module")
def noise_told(load_script: Callable[[str], ModuleType]) -> ModuleType:
    return load_script("benchmarks/noise_told.py")


def test_motions_that_err_by_what_they_state_have_a_nees_of_one_over_a_second(noise_told: ModuleType) -> None:
    rng = np.random.default_rng(3)
    stamps_s = np.arange(401) / 10.0
    truth = Trajectory(stamps_s, np.column_stack([0.3 * stamps_s, np.zeros((401, 2))]))
    sigmas = np.array([0.002, 0.001, 0.003])

    def nees(errs_more: float, is_measured: tuple[int, int, int] = (1, 1, 1)) -> float:
        steps = np.array([0.03, 0.0, 0.0]) + errs_more * sigmas * rng.standard_normal((400, 3))
        return float(noise_told.chained_nees(motions_table(stamps_s, steps, np.diag(is_measured / sigmas**2)), truth))

    assert nees(1.0) == pytest.approx(1.0, abs=0.4)
    assert nees(3.0) == pytest.approx(9.0, abs=3.0)
    assert nees(1.0, (0, 0, 1)) == pytest.approx(1.0, abs=0.5)  # of one degree of freedom, not of three
    assert math.isnan(noise_told.chained_nees(motions_table(stamps_s[:1], np.empty((0, 3)), np.eye(3)), truth))


def motions_table(stamps_s: Floats, steps: Floats, information: Floats) -> EstimateTable:
    """Return motions from each stamp to the next as the estimates of a run."""
    n = len(steps)
    words = {name: np.array([word] * n) for name, word in
             (("source", "wheels"), ("kind", "motion"), ("outcome", "accepted"), ("reason", ""))}  # fmt: skip
    return EstimateTable(
        arrived_s=stamps_s[1:], since_s=stamps_s[:-1], stamp_s=stamps_s[1:], numbers=steps,
        information=np.tile(information, (n, 1, 1)), nis=np.full(n, np.nan), dof=np.full(n, 3.0), **words,
    )  # fmt: skip


def test_a_localizer_is_judged_by_itself_and_with_the_scale_that_was_learned(noise_told: ModuleType) -> None:
    rows = [
        noise_told.Row("klt", "street", 1, 1, 40.0, 4.0, noise_told.Scale(2.0, False)),
        noise_told.Row("klt", "street", 2, 1, 30.0, 8.0, noise_told.Scale(1.0, True)),
        noise_told.Row("klt", "supermarket", 1, 1, 2.0, 1.0, noise_told.Scale(1.0, True)),
        noise_told.Row("omni_surf", "street", 1, 1, math.nan, math.nan, None),
        noise_told.Row("divs", "street", 1, 1, 1.0, math.nan, None),
    ]

    lines = noise_told.table(rows)

    assert lines[0] == "3 places (1 x supermarket, 2 x street, 0 x lab), 3 drives."
    assert lines[4:8] == [
        "| `klt` | supermarket | 1 | 2 | 2, 2 | 1 of 1 | 1 | 1, 1 | 1 of 1 | 1.00 | 1 | 1 of 1 |",
        "| `klt` | street | 2 | 35 | 30, 40 | 0 of 2 | 6 | 4, 8 | 1 of 2 | 1.00 to 2.00 * | 4.5 | 1 of 2 |",
        "| `omni_surf` | street | 1 |  |  |  |  |  |  |  |  |  |",
        "| `divs` | street | 1 | 1 | 1, 1 | 1 of 1 |  |  |  |  |  |  |",
    ]


def test_a_scale_that_has_just_changed_is_not_settled(noise_told: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    class Rises:
        """Learns a scale of 2 when it is told of what arrives at 18 s."""

        def __init__(self, config: object) -> None:
            self.factor = 1.0

        def start(self, session: object) -> None:
            """Begin."""

        def apply(self, source: str, arrived_s: float) -> None:
            self.factor = 2.0 if arrived_s >= 18.0 else 1.0

        def noise_scales(self) -> dict[str, float]:
            return {"klt": self.factor}

    monkeypatch.setattr(noise_told, "Kalman", Rises)

    def scale(until_s: float) -> object:
        return noise_told.learned_scale("klt", [(float(s), "klt", float(s)) for s in range(int(until_s) + 1)], None)

    assert scale(20.0) == noise_told.Scale(2.0, False)
    assert scale(30.0) == noise_told.Scale(2.0, True)


def test_only_who_has_its_sensor_takes_part(noise_told: ModuleType) -> None:
    lab = noise_told.config("lab", 1, 1, "replay")

    assert {"odometry", "imu", "laser_icp", "kinect_motion", "orb_rgbd"} <= {*lab["localizers"]}
    assert not {"ground_vo", "omni_surf", "divs"} & {*lab["localizers"]}
    assert lab["estimator"]["use"] == ["odometry", "imu", "laser_icp"]
    assert "orb_rgbd" not in noise_told.config("street", 1, 1, "teach")["localizers"]


def test_no_two_drives_have_the_same_noise(noise_told: ModuleType) -> None:
    seeds = [noise_told.config("lab", place, seed, "replay")["seed"] for place in range(1, 6) for seed in range(4)]

    assert len({*seeds}) == len(seeds)
