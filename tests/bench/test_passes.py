"""A bench in pieces: what one machine has run is known to the next by a file."""

from __future__ import annotations

import json
import lzma
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from trailmark.cli.root import ChosenPlugins, root
from trailmark.errors import DataError
from trailmark.isolation import fingerprint
from trailmark.isolation.outcome import Outcome
from trailmark.plugins import load_plugins
from trailmark_bench import Cell, Index, load_bench
from trailmark_bench.passes import going_on_from, noting_pass
from trailmark_bench.shared import read_results, write_results

TOY = Path(__file__).with_name("toy_plugin.py")
CONFIG = "sources: {robot: {plugin: toy_wheels}}\nbench: {cells: {localizers: [toy], seeds: SEEDS}}\n"


def run(*arguments: object) -> Result:
    return CliRunner().invoke(root, ["bench", *map(str, arguments)], obj=ChosenPlugins(files=(str(TOY),)))


def figures(folder: Path) -> dict[str, Any]:
    with Index(folder) as index:
        return {record.label: (record.state, record.result["metrics"]) for record in index.records()}


def test_a_fresh_clone_goes_on_from_the_file_and_adds_to_it(tmp_path: Path) -> None:
    config, file = tmp_path / "b.yaml", tmp_path / "results" / "cells.json.xz"
    config.write_text(CONFIG.replace("SEEDS", "2"))
    first = run(config, "--out", tmp_path / "one", "--results", file, "--no-report")
    known = figures(tmp_path / "one")
    shutil.rmtree(tmp_path / "one")
    config.write_text(CONFIG.replace("SEEDS", "3"))

    second = run(config, "--out", tmp_path / "two", "--results", file, "--no-report")

    assert first.exit_code == second.exit_code == 0
    assert "2 of 3 cells are known from" in second.output
    assert {label: figures(tmp_path / "two")[label] for label in known} == known
    with Index(tmp_path / "two") as index:
        assert [record.attempts for record in index.records()] == [0, 0, 1]
        assert [one["cells"] for one in index.meta()["passes"]] == [2, 1]
        assert all(one["wall_s"] > 0.0 and one["cpu_s"] > 0.0 for one in index.meta()["passes"])
    read_results(file, tmp_path / "read")
    assert figures(tmp_path / "read") == figures(tmp_path / "two")


@pytest.mark.parametrize("fewer", [("--only", "seed=1"), ("--quick",)], ids=["only", "quick"])
def test_what_a_call_does_not_ask_for_stays_in_the_file(tmp_path: Path, fewer: tuple[str, ...]) -> None:
    config, file = tmp_path / "b.yaml", tmp_path / "cells.json"
    config.write_text(CONFIG.replace("SEEDS", "2"))
    run(config, "--out", tmp_path / "one", "--results", file, "--no-report")
    cells = json.loads(file.read_text())["cells"]

    less = run(config, *fewer, "--out", tmp_path / "two", "--results", file, "--no-report")

    assert less.exit_code == 0
    assert "1 of 1 cells are known" in less.output
    assert "1 in it are not asked for: they stay" in less.output
    assert json.loads(file.read_text())["cells"] == cells
    assert len(figures(tmp_path / "two")) == 1


def test_what_is_of_other_code_is_not_taken(synthetic: Callable[..., Index], tmp_path: Path) -> None:
    with synthetic(tmp_path / "old") as index:
        write_results(index, tmp_path / "cells.json.xz")
    cells = [Cell("f" * 20, "", {"localizer": "klt", "seed": 0}, {})]

    with Index(tmp_path / "new", write=True) as index, going_on_from(index, cells, tmp_path / "cells.json.xz") as told:
        assert index.states() == {"f" * 20: "pending"}

    assert told.startswith("0 of 1 cells are known")
    assert "60 in it are of other code or config" in told


def test_what_ends_a_bench_leaves_the_file_with_what_is_finished(tmp_path: Path) -> None:
    cells = [Cell(digit * 20, "", {"seed": int(digit)}, {}) for digit in "01"]

    def end_early() -> None:
        with Index(tmp_path / "out", write=True) as index, going_on_from(index, cells, tmp_path / "cells.json"):
            index.enter(cells)
            index.mark_finished("0" * 20, Outcome("failed", "no texture"))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        end_early()

    document = json.loads((tmp_path / "cells.json").read_text())
    assert [cell["id"] for cell in document["cells"]] == ["0" * 20]


def test_what_is_to_be_run_is_told_from_the_file_too_and_nothing_is_written(tmp_path: Path) -> None:
    config, file = tmp_path / "b.yaml", tmp_path / "cells.json.xz"
    config.write_text(CONFIG.replace("SEEDS", "2"))
    run(config, "--out", tmp_path / "one", "--results", file, "--no-report")
    config.write_text(CONFIG.replace("SEEDS", "3"))

    told = run(config, "--list", "--json", "--out", tmp_path / "none", "--results", file)

    cells = json.loads(told.stdout)
    assert [(cell["state"], cell["estimated_s"] is not None) for cell in cells] == 2 * [("ok", True)] + [
        ("pending", True)
    ]
    assert not (tmp_path / "none").exists()


def test_a_pass_costs_what_its_cells_took_though_nobody_waited_for_them(tmp_path: Path) -> None:
    cells = [Cell(digit * 20, "", {"seed": int(digit)}, {}) for digit in "01"]
    with Index(tmp_path / "out", write=True) as index:
        index.enter(cells)
        index.mark_finished("0" * 20, Outcome("ok", cpu_s=5e3))
        with noting_pass(index):
            index.mark_finished("1" * 20, Outcome("ok", cpu_s=1e3))

        assert [(one["cells"], one["cpu_s"]) for one in index.meta()["passes"]] == [(1, 1e3)]


def test_a_pass_in_which_nothing_ran_is_not_noted(synthetic: Callable[..., Index], tmp_path: Path) -> None:
    with synthetic(tmp_path / "bench") as index:
        with noting_pass(index):
            pass

        assert "passes" not in index.meta()


def test_the_file_is_the_same_twice_and_has_the_pictures_of_one_sample(
    synthetic: Callable[..., Index], tmp_path: Path
) -> None:
    with synthetic(tmp_path / "bench", fails=0.0) as index:
        for name in ("a.json.xz", "b.json.xz"):
            write_results(index, tmp_path / name, pictured=True)
    read_results(tmp_path / "a.json.xz", tmp_path / "read")

    assert (tmp_path / "a.json.xz").read_bytes() == (tmp_path / "b.json.xz").read_bytes()
    with Index(tmp_path / "read") as index:
        pictured = {cell_id: detail for cell_id, detail, _ in index.details() if detail is not None}
        seeds = [record.coordinates["seed"] for record in index.records() if record.id in pictured]
    assert seeds == [0] * 12
    assert all(
        set(json.loads(zlib.decompress(one))) == {"ways", "errors", "stages", "sources"} for one in pictured.values()
    )


@pytest.mark.parametrize(
    "content", [lzma.compress(b"{}")[:-9], lzma.compress(b"{}" * 99)[:40], b"\xfd7zXZ\x00not packed"]
)
def test_a_damaged_file_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "cells.json.xz").write_bytes(content)

    with pytest.raises(DataError, match=r"cells.json.xz"):
        read_results(tmp_path / "cells.json.xz", tmp_path / "read")


@pytest.mark.parametrize("picture", [{"config": "/home/somebody"}, [], {"ways": "x" * (2 << 20)}])
def test_a_picture_that_cannot_be_is_refused(synthetic: Callable[..., Index], tmp_path: Path, picture: Any) -> None:
    with synthetic(tmp_path / "bench") as index:
        write_results(index, tmp_path / "cells.json")
    document = json.loads((tmp_path / "cells.json").read_text())
    document["cells"][0]["picture"] = picture
    (tmp_path / "cells.json").write_text(json.dumps(document))

    with pytest.raises(DataError, match="its picture is no small mapping"):
        read_results(tmp_path / "cells.json", tmp_path / "read")


def addresses() -> dict[str, str]:
    robot = {"plugin": "sim", "world": "ground_course", "sensors": ["floor", "wheels"]}
    document = {"sources": {"robot": robot}, "bench": {"cells": {"localizers": ["klt", "ground_vo", "odometry"]}}}
    return {cell.label: cell.id for cell in load_bench(document, plugins=load_plugins()).cells}


def test_code_that_a_cell_does_not_use_has_no_say_in_its_address(monkeypatch: pytest.MonkeyPatch) -> None:
    before, digest_of = addresses(), fingerprint.source_digest

    def changed(package: str) -> str:
        return (
            "changed" if package in ("trailmark_ground_vo", "trailmark_divs", "trailmark_bench") else digest_of(package)
        )

    monkeypatch.setattr(fingerprint, "source_digest", changed)
    after = addresses()

    assert [label for label in before if before[label] != after[label]] == ["ground_vo, seed 0"]
