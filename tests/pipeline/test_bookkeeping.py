"""Counters, timing, random numbers, mailboxes, provenance."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trailmark.estimates import Belief
from trailmark.frames import Frame, Image, Scalar, Scan
from trailmark.pipeline.instruments import EXACT_CALLS, Counters, StageTimes
from trailmark.pipeline.lifecycle import part_rng
from trailmark.pipeline.localizers.mailbox import Mailbox
from trailmark.pipeline.outputs.provenance import git_describe, provenance


def test_percentiles_are_those_of_every_call() -> None:
    times = StageTimes()
    stage = times.stage("estimator")
    for ms in range(1, 101):
        stage.append(ms * 1_000_000)
    times.stage("never ran")

    row = times.table()["estimator"]

    assert row == {"n": 100, "mean_ms": 50.5, "p50_ms": 50.5, "p95_ms": 95.05, "p99_ms": 99.01, "max_ms": 100.0}
    assert list(times.table()) == ["estimator"]


def test_many_calls_need_no_more_memory_and_lose_hardly_anything() -> None:
    rng = np.random.default_rng(5)
    calls = np.exp(rng.normal(13.0, 1.5, 5 * EXACT_CALLS)).astype(np.int64)  # 0.4 ms, a factor of 4.5 either way
    times = StageTimes()
    stage = times.stage("localizer.floor")
    largest = 0
    for part in np.array_split(calls, 40):
        stage.extend(part.tolist())
        times.fold()
        largest = max(largest, len(stage))

    row = times.table()["localizer.floor"]

    assert largest <= EXACT_CALLS
    assert row["n"] == len(calls)
    assert row["mean_ms"] == pytest.approx(calls.mean() / 1e6, abs=1e-6)
    assert row["max_ms"] == pytest.approx(calls.max() / 1e6, abs=1e-6)
    for percent in (50, 95, 99):
        assert row[f"p{percent}_ms"] == pytest.approx(np.percentile(calls, percent) / 1e6, rel=0.006)
    assert times.table()["localizer.floor"] == row


def test_a_stage_of_equal_calls_has_no_percentile_above_its_maximum() -> None:
    times = StageTimes()
    times.stage("store").extend([1_000_003] * (EXACT_CALLS + 1))
    times.fold()

    row = times.table()["store"]

    assert row["p50_ms"] <= row["max_ms"] == 1.000003
    assert row["p50_ms"] == pytest.approx(1.0, rel=0.006)


def test_counters_of_parts_stand_below_their_own_name() -> None:
    counters = Counters()
    counters.add("frames", 3)
    counters.add("source.cam.skipped")

    merged = counters.merged({"source.cam": {"skipped": 2, "retries": 1}})

    assert merged == {"frames": 3, "source.cam.retries": 1, "source.cam.skipped": 3}
    assert counters["frames"] == 3
    assert counters["nothing"] == 0


def test_random_numbers_depend_on_seed_kind_and_name_alone() -> None:
    numbers = {
        (seed, kind, name): part_rng(seed, kind, name).random()
        for seed in (0, 1)
        for kind in ("localizer", "source")
        for name in ("floor", "floor_map")
    }

    assert len(set(numbers.values())) == 8
    assert part_rng(0, "localizer", "floor").random() == numbers[0, "localizer", "floor"]
    # The same on every machine and in every process: a changed digest would change every recorded result.
    assert part_rng(0, "localizer", "floor").integers(1 << 32) == 1902808673


class TestMailbox:
    @staticmethod
    def frame(sensor: str, stamp_s: float) -> Frame:
        payload = {"cam": Image(np.zeros((1, 1), np.uint8)), "laser": Scan(np.zeros(2), 0.0, 0.1), "light": Scalar(0.0)}
        return Frame(sensor, stamp_s, payload[sensor])

    @pytest.mark.parametrize(
        ("keeps_all", "overwrites", "waiting"),
        [(False, [False, False, False, True, True, True], [3, 4, 5]), (True, [False] * 6, [0, 1, 2, 3, 4, 5])],
    )
    def test_it_keeps_the_newest_of_every_sensor_or_all(
        self, keeps_all: bool, overwrites: list[bool], waiting: list[int]
    ) -> None:
        mailbox = Mailbox(keeps_all)
        put = [("cam", 0), ("light", 1), ("laser", 2), ("cam", 3), ("light", 4), ("laser", 5)]

        overwritten = [mailbox.put(self.frame(sensor, stamp), Belief(stamp)) for sensor, stamp in put]

        assert overwritten == overwrites
        taken = [mailbox.take() for _ in range(len(waiting) + 1)]
        assert [letter and letter[0].stamp_s for letter in taken] == [*waiting, None]

    @settings(max_examples=50, deadline=None)
    @given(st.lists(st.sampled_from(["cam", "laser", "light"]), max_size=30))
    def test_what_waits_comes_out_in_order_and_nothing_is_lost_unseen(self, sensors: list[str]) -> None:
        mailbox = Mailbox()
        n_overwritten = sum(mailbox.put(self.frame(s, i), Belief(float(i))) for i, s in enumerate(sensors))

        letters = []
        while (letter := mailbox.take()) is not None:
            letters.append(letter)

        stamps = [frame.stamp_s for frame, _ in letters]
        assert stamps == sorted(stamps)
        assert len(letters) + n_overwritten == len(sensors)
        assert all(belief.stamp_s == frame.stamp_s for frame, belief in letters)


class TestProvenance:
    def test_a_folder_outside_of_a_repository_has_no_version(self, tmp_path: Path) -> None:
        assert git_describe(tmp_path) is None
        assert git_describe(tmp_path / "missing") is None

    def test_a_changed_repository_says_so(self, tmp_path: Path) -> None:
        git = ["git", "-C", str(tmp_path), "-c", "user.name=t", "-c", "user.email=t@example.org"]
        (tmp_path / "config.yaml").write_text("mode: track\n")
        for arguments in (["init", "-q"], ["add", "."], ["commit", "-qm", "one"], ["tag", "v1"]):
            subprocess.run([*git, *arguments], check=True)
        assert git_describe(tmp_path) == "v1"

        (tmp_path / "config.yaml").write_text("mode: teach\n")

        assert git_describe(tmp_path, dirty=True) == "v1-dirty"
        assert git_describe(tmp_path) == "v1"  # not looked at where nobody's code is run

    def test_it_names_what_a_reader_needs_to_repeat_the_run(self) -> None:
        facts = provenance()

        assert facts["packages"]["numpy"] == np.__version__
        assert "pytest" not in facts["packages"]  # not needed at run time
        assert facts["cpu"]
        assert facts["git"]["config"] is None


@pytest.mark.parametrize("module", ["trailmark.pipeline", "trailmark.api", "trailmark.estimation.dead_reckoning"])
def test_the_pipeline_imports_nothing_heavy(module: str) -> None:
    heavy = ("cv2", "numba", "sklearn", "scipy", "filterpy", "matplotlib", "trailmark.evaluation")
    code = f"import sys, {module}; print([name for name in {heavy} if name in sys.modules])"

    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert done.stdout.strip() == "[]"
