from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from trailmark.cli.compare import compare_command
from trailmark.cli.evaluate import evaluate_command
from trailmark.errors import DataError
from trailmark.geometry import read_tum, write_tum

Write = Callable[..., Path]


def _call(command: object, *arguments: object) -> Result:
    return CliRunner().invoke(command, [str(argument) for argument in arguments])  # type: ignore[arg-type]


def _fits(lines: Sequence[str]) -> bool:
    return max(map(len, lines)) <= 100 and not any("…" in line for line in lines)


@pytest.fixture
def ways(fake_run: Write) -> Path:
    """Trajectories of a run, as files of another program would be."""
    return fake_run(seconds=20.0) / "trajectories"


def test_evaluate_prints_a_row_for_each_trajectory(ways: Path) -> None:
    result = _call(evaluate_command, ways / "groundtruth.tum", ways / "floor.tum", ways / "klt.tum")

    assert result.exit_code == 0, result.output
    assert [line.split()[0] for line in result.output.splitlines() if line.startswith((" floor", " klt"))] == [
        "floor",
        "klt",
    ]
    assert "Alignment: se2" in result.output
    assert _fits(result.output.splitlines())


def test_evaluate_tells_everything_as_json(ways: Path) -> None:
    result = _call(evaluate_command, ways / "groundtruth.tum", ways / "fused.tum", "--json", "--align", "none")

    document = json.loads(result.output)
    fused = document["trajectories"][0]
    assert document["align"] == "none"
    assert fused["alignment"]["used"] == "none"
    assert "ate_rmse_m[none,n=400]" in fused["metrics"]
    assert fused["association"]["interpolated"] == "reference"


def test_evaluate_takes_a_tolerance(ways: Path) -> None:
    truth = read_tum(ways / "groundtruth.tum")
    write_tum(ways / "sparse.tum", truth.between(0.0, 0.1))

    wide = _call(evaluate_command, ways / "sparse.tum", ways / "floor.tum", "--json", "--max-difference", "0.01")

    assert json.loads(wide.output)["trajectories"][0]["association"]["max_difference_s"] == 0.01


def test_evaluate_names_a_trajectory_that_has_nothing_in_common_and_shows_the_others(ways: Path) -> None:
    (ways / "empty.tum").write_text("# nothing\n")

    result = _call(evaluate_command, ways / "groundtruth.tum", ways / "floor.tum", ways / "empty.tum")

    assert result.exit_code == 1
    assert "empty: the estimate has no poses; at least 2 are needed." in result.output
    assert " floor" in result.output


def test_evaluate_refuses_when_nothing_can_be_compared(ways: Path) -> None:
    (ways / "empty.tum").write_text("")

    result = _call(evaluate_command, ways / "groundtruth.tum", ways / "empty.tum")

    assert isinstance(result.exception, DataError)
    assert "empty.tum: the estimate has no poses" in str(result.exception)


def test_evaluate_names_a_ground_truth_without_poses(ways: Path) -> None:
    (ways / "empty.tum").write_text("")

    result = _call(evaluate_command, ways / "empty.tum", ways / "floor.tum")

    assert str(result.exception).startswith(str(ways / "empty.tum"))


def test_evaluate_names_a_missing_file(ways: Path) -> None:
    result = _call(evaluate_command, ways / "missing.tum", ways / "floor.tum")

    assert isinstance(result.exception, DataError)
    assert "cannot read trajectory" in str(result.exception)


def test_evaluate_tells_files_of_one_name_apart_by_their_folders(ways: Path, tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    write_tum(tmp_path / "b" / "floor.tum", read_tum(ways / "floor.tum"))

    result = _call(evaluate_command, ways / "groundtruth.tum", ways / "floor.tum", tmp_path / "b" / "floor.tum")

    assert "".join(result.output.split()).count("floor.tum") == 2


@pytest.mark.parametrize("arguments", [("--align", "sim3"), ("--max-difference", "0"), ("--max-difference", "-1")])
def test_evaluate_refuses_wrong_options(ways: Path, arguments: tuple[str, str]) -> None:
    assert _call(evaluate_command, ways / "groundtruth.tum", ways / "floor.tum", *arguments).exit_code == 2


def test_compare_shows_the_localizers_of_one_run(fake_run: Write) -> None:
    result = _call(compare_command, fake_run(seconds=20.0))

    assert result.exit_code == 0, result.output
    for words in ("floor_map", "fused", "ATE", "NIS/dof", "NEES/dof", "accepted"):
        assert words in result.output
    assert _fits(result.output.splitlines())


def test_compare_shows_several_runs_in_one_table(fake_run: Write) -> None:
    result = _call(compare_command, fake_run("first", seconds=20.0), fake_run("second", seconds=20.0, seed=3))

    rows = [line for line in result.output.splitlines() if " fused " in line]
    assert [row.split()[0] for row in rows] == ["first", "second"]
    assert _fits(result.output.splitlines())


def test_compare_never_puts_errors_and_differences_into_one_table(fake_run: Write) -> None:
    result = _call(compare_command, fake_run("with", seconds=20.0), fake_run("without", seconds=20.0, has_truth=False))

    errors, differences = result.output.split("difference", 1)
    assert "ATE" in errors
    assert "without" not in errors
    assert "differences from fused, not errors" in differences


def test_compare_tells_everything_as_json(fake_run: Write) -> None:
    folder = fake_run(seconds=20.0)

    result = _call(compare_command, folder, "--json", "--align", "origin")

    (document,) = json.loads(result.output)
    assert document["folder"] == str(folder)
    assert document["align"] == "origin"
    assert document["sources"]["floor"]["nis"]["verdict"] == "consistent"
    assert not (folder / "metrics.json").exists()


def test_compare_refuses_a_folder_that_is_no_run(tmp_path: Path) -> None:
    result = _call(compare_command, tmp_path)

    assert isinstance(result.exception, DataError)
    assert "is not the folder of a run" in str(result.exception)


def test_compare_says_what_could_not_be_read(fake_run: Write) -> None:
    folder = fake_run(seconds=10.0)
    (folder / "trajectories" / "klt.tum").write_text("1 2 3\n")

    result = _call(compare_command, folder)

    assert result.exit_code == 0
    assert "klt.tum:1: expected 8 numbers" in result.output
