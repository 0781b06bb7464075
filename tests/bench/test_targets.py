"""What the commands of a bench replace, refuse, and say of a bench without cells."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from trailmark.cli import main
from trailmark_bench import Cell, Index


@pytest.fixture(autouse=True)
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, synthetic: Callable[..., Index]) -> Path:
    """A bench in the folder where the commands are given."""
    monkeypatch.chdir(tmp_path)
    synthetic(Path("bench"), sources=2, localizers=2, seeds=2).close()
    return Path("bench")


def call(*words: str) -> int:
    with pytest.raises(SystemExit) as left:
        main(["bench", *words])
    return int(left.value.code or 0)


@pytest.mark.parametrize("form", ["markdown", "csv", "latex", "json"])
def test_an_export_replaces_a_file_only_where_that_is_asked_for(form: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("mine").write_text("hours of work")

    assert call("export", form, "bench", "--to", "mine") == 2
    assert capsys.readouterr().err == "trailmark: mine is there already; choose another --to, or --overwrite\n"
    assert Path("mine").read_text() == "hours of work"
    assert call("export", form, "bench", "--to", "mine", "--overwrite") == 0
    assert "hours of work" not in Path("mine").read_text()
    assert call("export", form, "bench", "--to", "new") == 0
    assert Path("new").read_text() == Path("mine").read_text()


def test_overwriting_standard_output_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("export", "csv", "bench", "--overwrite") == 2
    assert "--overwrite belongs to --to" in capsys.readouterr().err


@pytest.mark.parametrize("form", ["csv", "json"])
def test_what_the_shell_has_opened_is_written_to(form: str) -> None:
    reader, writer = os.pipe()

    assert call("export", form, "bench", "--to", f"/dev/fd/{writer}") == 0

    os.close(writer)
    with open(reader, encoding="utf-8") as piped:
        assert "method_1" in piped.read()


def test_a_site_is_renewed_and_other_folders_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    Path("site").mkdir()
    assert call("site", "bench", "--to", "site") == 0
    assert call("site", "bench", "--to", "site") == 0
    for name in ("index.html", "notes.txt"):
        folder = Path(f"with-{name}")
        folder.mkdir()
        (folder / name).write_text("<title>mine</title>")
        capsys.readouterr()

        assert call("site", "bench", "--to", str(folder)) == 2

        assert capsys.readouterr().err == (
            f"trailmark: {folder} is not empty, and no site of a bench; choose another --to, or --overwrite\n"
        )
        assert [path.name for path in folder.iterdir()] == [name]
        assert (folder / name).read_text() == "<title>mine</title>"
        assert call("site", "bench", "--to", str(folder), "--overwrite") == 0
        assert (folder / name).is_file()


COMMANDS = [
    ["show", "empty"],
    ["show", "empty", "--json"],
    ["show", "empty", "--state", "ok"],
    ["show", "empty", "--html"],
    ["show", "empty", "klt"],
    ["site", "empty", "--to", "out"],
    ["merge", "empty", "--out", "out"],
    ["merge", "bench", "empty", "--out", "out"],
    *(["export", form, "empty", "--to", "out"] for form in ("csv", "latex", "markdown", "json")),
    ["export", "csv", "empty", "--cells"],
]


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_a_bench_without_cells_is_refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    Index(Path("empty"), write=True).close()

    assert call(*words) == 2

    printed = capsys.readouterr()
    assert "empty holds no cell" in printed.err
    assert not printed.out
    assert not Path("out").exists()


def test_a_config_that_is_refused_leaves_no_bench(capsys: pytest.CaptureFixture[str]) -> None:
    Path("b.yaml").write_text("sources: {a: {plugin: nothing_of_this_name}}\nbench: {cells: {localizers: [klt]}}\n")

    assert call("run", "b.yaml", "--out", "empty") == 2
    assert "nothing_of_this_name" in capsys.readouterr().err
    assert not Path("empty").exists()


def test_an_index_without_tables_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    Path("cut").mkdir()
    Path("cut/index.sqlite").touch()

    assert call("show", "cut") == 2
    assert "is no index of a bench" in capsys.readouterr().err


def test_a_file_without_cells_is_no_bench_to_merge(capsys: pytest.CaptureFixture[str]) -> None:
    Path("none.json").write_text(json.dumps({"form": "trailmark bench results", "version": 1, "cells": []}))

    assert call("merge", "none.json", "--out", "out") == 2
    assert "out holds no cell" in capsys.readouterr().err


def test_what_has_not_ended_is_not_sent(capsys: pytest.CaptureFixture[str]) -> None:
    with Index(Path("begun"), write=True) as index:
        index.enter([Cell(f"{0:020x}", "", {"localizer": "klt"}, {})])

    assert call("export", "json", "begun", "--to", "out.json") == 2
    assert "no cell has ended" in capsys.readouterr().err
    assert not Path("out.json").exists()


def test_an_unknown_metric_of_cells_in_a_state_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("show", "bench", "--state", "ok", "--metric", "ate_rsme_m") == 2
    assert "no cell has a metric 'ate_rsme_m' (did you mean 'ate_rmse_m'" in capsys.readouterr().err
    assert call("show", "bench", "--state", "ok", "--metric", "nope") == 2
    assert "tracked_fraction" in capsys.readouterr().err


def test_cells_in_a_state_are_listed_with_their_figures(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("show", "bench", "--state", "ok", "--metric", "ate_rmse_m", "--metric", "wall_s") == 0

    lines = capsys.readouterr().out.splitlines()
    assert lines
    assert all("  ate_rmse_m 0.0" in line and line.endswith("  wall_s 2") for line in lines)


def test_a_metric_of_a_bench_without_results_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with Index(Path("begun"), write=True) as index:
        index.enter([Cell(f"{0:020x}", "", {"localizer": "klt"}, {})])

    assert call("show", "begun", "--state", "pending", "--metric", "nope") == 2
    assert "no cell has a metric 'nope': none has given a result" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["show", "bench", "0000", "--metric", "ate_rmse_m"], "--state and --metric are for several"),
        (["show", "bench", "0000", "--state", "ok"], "--state and --metric are for several"),
        (["show", "bench", "--state", "ok", "--baseline", "method_0"], "--baseline is for the tables"),
        (["export", "csv", "bench", "--cells", "--metric", "ate_rmse_m"], "--cells gives every figure"),
    ],
)
def test_options_without_effect_are_refused(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(*words) == 2
    assert said in capsys.readouterr().err
