"""Results as a file: what goes out, what comes back, and what a stranger may not send."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from trailmark.cli import main
from trailmark.errors import DataError
from trailmark.isolation import Outcome
from trailmark_bench import Cell, Index
from trailmark_bench.merge import merge_benches
from trailmark_bench.shared import read_results, shared_results


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """A bench of three cells: a result, a failure, one that has not run."""
    with Index(tmp_path / "bench", write=True) as index:
        index.enter([Cell(f"{seed:020x}", "hall", {"localizer": "klt", "seed": seed}, {}) for seed in range(3)])
        result = {"metrics": {"ate_rmse_m[se2,n=9]": 0.125}, "times": {"cpu_ms": 1.5}, "errors": True}
        outcome = Outcome("ok", wall_s=2.0, cpu_s=1.5, peak_rss_mb=90.0, load=0.5, host="somebodys-laptop")
        index.mark_finished(f"{0:020x}", outcome, result)
        index.mark_finished(f"{1:020x}", Outcome("failed", "no texture"))
        origin = {"trailmark": "0.1.0", "command": "trailmark bench /home/somebody/b.yaml", "cpu": "EPYC"}
        index.set_meta(name="hall", metrics=["ate_rmse_m"], baseline=None, provenance=origin)
    return tmp_path / "bench"


def sent(bench: Path) -> dict[str, Any]:
    with Index(bench) as index:
        document: dict[str, Any] = json.loads(shared_results(index))
    return document


def test_what_has_ended_goes_out_without_names_and_paths(bench: Path) -> None:
    document = sent(bench)

    assert [cell["state"] for cell in document["cells"]] == ["ok", "failed"]
    assert document["origin"] == {"trailmark": "0.1.0", "cpu": "EPYC"}
    assert "somebody" not in json.dumps(document)


def test_what_comes_back_is_the_same(bench: Path, tmp_path: Path) -> None:
    (tmp_path / "sent.json").write_text(json.dumps(sent(bench)))

    read_results(tmp_path / "sent.json", tmp_path / "read")

    assert sent(tmp_path / "read")["cells"][0]["result"] == sent(bench)["cells"][0]["result"]
    with Index(bench) as ours, Index(tmp_path / "read") as theirs:
        first, second, _ = ours.records()
        assert [record.coordinates for record in theirs.records()] == [first.coordinates, second.coordinates]
        assert theirs.records()[0].wall_s == first.wall_s
        assert theirs.records()[1].reason == "no texture"
        assert theirs.meta()["name"] == "hall"


def test_a_file_is_merged_like_a_folder(bench: Path, tmp_path: Path) -> None:
    with Index(tmp_path / "other", write=True) as index:
        index.enter([Cell(f"{2:020x}", "hall", {"localizer": "klt", "seed": 2}, {})])
        index.mark_finished(f"{2:020x}", Outcome("ok"), {"metrics": {"ate_rmse_m[se2,n=9]": 0.25}})
    (tmp_path / "sent.json").write_text(json.dumps(sent(tmp_path / "other")))

    lines = merge_benches([bench, tmp_path / "sent.json"], tmp_path / "both")

    with Index(tmp_path / "both") as index:
        assert index.states() == {f"{0:020x}": "ok", f"{1:020x}": "failed", f"{2:020x}": "ok"}
    assert "1 cells taken over" in lines[1]


def test_cells_of_other_code_are_told_and_not_shown(bench: Path, tmp_path: Path) -> None:
    """One machine is of a later commit, which gives cells other addresses, and has a plugin of its own besides."""
    with Index(tmp_path / "later", write=True) as index:
        names = {"b": ("klt", 0), "c": ("klt", 2), "d": ("mine", 0)}
        cells = {digit * 20: {"localizer": name, "seed": seed} for digit, (name, seed) in names.items()}
        index.enter([Cell(address, "hall", coordinates, {}) for address, coordinates in cells.items()])
        for address in cells:
            index.mark_finished(address, Outcome("ok"), {"metrics": {"ate_rmse_m[se2,n=9]": 9.0}})

    lines = merge_benches([bench, tmp_path / "later"], tmp_path / "both")

    with Index(tmp_path / "both") as index:
        shown = {(record.coordinates["localizer"], record.coordinates["seed"]): record.id for record in index.records()}
        assert len(index.records()) == 4
        assert set(index.states()) >= {"b" * 20}  # it stays
    assert shown == {("klt", 0): "0" * 20, ("klt", 1): f"{1:020x}", ("klt", 2): "c" * 20, ("mine", 0): "d" * 20}
    assert "1 are not shown: they are of other code" in lines[1]
    assert "klt" in lines[1]


def bench_of_code(folder: Path, digit: str, states: Sequence[str]) -> None:
    """Make a bench whose cells, one a seed, have the addresses of other code."""
    with Index(folder, write=True) as index:
        addresses = [digit * 19 + str(seed) for seed in range(len(states))]
        coordinates = [{"localizer": "klt", "seed": seed} for seed in range(len(states))]
        index.enter([Cell(each, "hall", at, {}) for each, at in zip(addresses, coordinates, strict=True)])
        for address, state in zip(addresses, states, strict=True):
            if state != "pending":
                index.mark_finished(address, Outcome(state), {"metrics": {}} if state == "ok" else None)


def test_an_old_failure_hides_no_result_of_mended_code(tmp_path: Path) -> None:
    bench_of_code(tmp_path / "old", "a", ["failed", "ok", "failed", "pending", "pending"])
    bench_of_code(tmp_path / "new", "b", ["ok", "failed", "failed", "failed", "pending"])

    lines = merge_benches([tmp_path / "old", tmp_path / "new"], tmp_path / "old")

    with Index(tmp_path / "old") as index:
        shown = {record.coordinates["seed"]: record.id[0] + " " + record.state for record in index.records()}
    assert shown == {0: "b ok", 1: "a ok", 2: "a failed", 3: "b failed", 4: "a pending"}
    assert "3 are not shown" in lines[0]
    assert all(f"seed {seed} (failed)" in lines[0] for seed in (0, 1, 2))


def test_several_of_one_name_that_were_merged_before_are_told(tmp_path: Path) -> None:
    """Earlier versions showed all of them."""
    with Index(tmp_path / "merged", write=True) as index:
        cells = [Cell(digit * 20, "hall", {"localizer": "klt", "seed": 0}, {}) for digit in "abc"]
        index.enter(cells)
        for cell, state in zip(cells, ("failed", "ok", "ok"), strict=True):
            index.mark_finished(cell.id, Outcome(state), {"metrics": {}} if state == "ok" else None)
    bench_of_code(tmp_path / "other", "d", ["failed"])

    lines = merge_benches([tmp_path / "merged", tmp_path / "other"], tmp_path / "merged")

    with Index(tmp_path / "merged") as index:
        assert [record.id for record in index.records()] == ["b" * 20]
        assert len(index.states()) == 4
    assert lines[0].startswith(f"{tmp_path / 'merged'}: 2 are not shown")


def test_the_commands_send_and_merge(bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["export", "json", str(bench), "--to", str(tmp_path / "a.json")],
                  ["merge", str(tmp_path / "a.json"), "--out", str(tmp_path / "merged")],
                  ["export", "csv", "--cells", str(tmp_path / "merged")]):  # fmt: skip
        with pytest.raises(SystemExit) as left:
            main(["bench", *words])
        assert not left.value.code

    assert "0.125" in capsys.readouterr().out


def changed(document: dict[str, Any], **cell: object) -> dict[str, Any]:
    return document | {"cells": [document["cells"][0] | cell]}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"id": "../../etc"}, "cell 0 has no address"),
        ({"id": 7}, "cell 0 has no address"),
        ({"state": "running"}, "no state of ok"),
        ({"coordinates": {"localizer": ["a"]}}, "coordinates are no texts"),
        ({"coordinates": "klt"}, "coordinates are no texts"),
        ({"reason": "x" * 3000}, "short texts"),
        ({"costs": {"wall_s": "long"}}, "costs are no numbers"),
        ({"result": {"metrics": {"ate_rmse_m": "small"}}}, "metrics, times, counters"),
        ({"result": {"metrics": []}}, "metrics, times, counters"),
        ({"result": 3}, "metrics, times, counters"),
    ],
)
def test_a_cell_that_cannot_be_is_refused(bench: Path, tmp_path: Path, change: dict[str, Any], said: str) -> None:
    (tmp_path / "sent.json").write_text(json.dumps(changed(sent(bench), **change)))

    with pytest.raises(DataError, match=said):
        merge_benches([tmp_path / "sent.json"], tmp_path / "out")

    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "sent.json is no file of 'trailmark bench export json': "),
        ("[]", "no file of 'trailmark bench export json'"),
        ('{"form": "trailmark bench results", "version": 2, "cells": []}', "has version 2"),
        ('{"form": "trailmark bench results", "version": 1, "cells": [3]}', "cell 0 is no cell"),
        ("[" * 100_000, "sent.json"),
        ("\xc9t\xe9", r"no text \(byte 0\)"),
    ],
)
def test_a_file_of_something_else_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "sent.json").write_text(text, encoding="latin-1")

    with pytest.raises(DataError, match=said):
        merge_benches([tmp_path / "sent.json"], tmp_path / "out")
