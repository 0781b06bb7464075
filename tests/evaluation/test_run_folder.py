from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from trailmark.errors import DataError
from trailmark.evaluation import read_run
from trailmark.geometry import Trajectory

LOST_LATE = "12.1,b,lost,,12.0,,,,,,,,,,unused,,,dark,"


def test_trajectories_come_in_the_order_of_the_config_and_the_fused_one_last(
    write_run: Callable[..., Path], straight: Trajectory
) -> None:
    names = ("a", "fused", "m", "z")

    run = read_run(write_run(dict.fromkeys(names, straight), config="localizers:\n  z: {plugin: x}\n  a: {}\n"))

    assert list(run.trajectories) == ["z", "a", "m", "fused"]


def test_the_ground_truth_is_no_trajectory_of_a_localizer(write_run: Callable[..., Path], straight: Trajectory) -> None:
    run = read_run(write_run({"a": straight}, truth=straight))

    assert list(run.trajectories) == ["a"]
    assert run.truth is not None
    assert len(run.truth) == 101


def test_the_span_of_a_run_includes_the_time_in_which_it_was_lost(
    write_run: Callable[..., Path], straight: Trajectory
) -> None:
    assert read_run(write_run({"b": straight}, estimates=[LOST_LATE])).span_s() == (0.0, 12.0)
    assert read_run(write_run({}, name="nothing")).span_s() is None


def test_what_is_broken_is_told_and_the_rest_is_read(write_run: Callable[..., Path], straight: Trajectory) -> None:
    folder = write_run({"a": straight, "b": straight}, config="localizers: {a: [")
    (folder / "trajectories" / "b.tum").write_text("1 2 3\n")
    (folder / "timing.json").write_text('{"stages": ')
    (folder / "run.json").write_text("[]")
    (folder / "estimates.csv").write_text("t\n")

    run = read_run(folder)

    assert list(run.trajectories) == ["a"]
    assert (run.timing, run.run, run.estimates) == ({}, {}, None)
    assert len(run.problems) == 4
    assert any("b.tum:1: expected 8 numbers" in problem for problem in run.problems)
    assert any(problem.startswith("timing.json is not complete JSON") for problem in run.problems)
    assert "run.json must hold a mapping, not a list" in run.problems


def test_a_link_bears_the_name_of_what_it_points_at(
    write_run: Callable[..., Path], straight: Trajectory, tmp_path: Path
) -> None:
    folder = write_run({"a": straight})
    (tmp_path / "latest").symlink_to(folder)

    assert read_run(tmp_path / "latest").name == "run"


def test_other_folders_and_missing_ones_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is not the folder of a run"):
        read_run(tmp_path)
    with pytest.raises(DataError, match=r"no folder .*the newest is runs/latest"):
        read_run(tmp_path / "missing")


def test_the_folder_of_a_bench_is_told_what_reads_it(tmp_path: Path) -> None:
    (tmp_path / "cells").mkdir()

    with pytest.raises(DataError, match="it is a bench: 'trailmark bench show"):
        read_run(tmp_path)
