"""``trailmark watch``: a run from its folder, while it is being written."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from trailmark.cli.watch import watch_command
from trailmark.errors import DataError
from trailmark.pipeline.outputs.recorder import ESTIMATE_COLUMNS
from trailmark.report.live import RunWatch


def row(source: str, kind: str, stamp_s: float, status: str = "accepted", reason: str = "", **numbers: float) -> str:
    known = {"source": source, "kind": kind, "stamp_s": repr(stamp_s), "status": status, "reason": reason}
    known |= {name: repr(value) for name, value in numbers.items()}
    return ",".join(known.get(name, "") for name in ESTIMATE_COLUMNS) + "\n"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    (tmp_path / "run.json").write_text(json.dumps({"status": "running"}))
    (tmp_path / "estimates.csv").write_text(",".join(ESTIMATE_COLUMNS) + "\n")
    return tmp_path


def append(folder: Path, text: str) -> None:
    with (folder / "estimates.csv").open("a") as file:
        file.write(text)


def test_what_is_new_is_added_and_half_a_line_waits(run: Path) -> None:
    watch = RunWatch(run)
    append(run, row("floor", "motion", 0.1, x=0.3, y=0.4, theta=0.0))
    assert watch.look()
    second = row("floor", "motion", 0.2, x=0.0, y=0.5, theta=0.0)
    append(run, second[:20])
    watch.look()
    assert watch.localizers["floor"].n == 1

    append(run, second[20:] + row("map", "fix", 0.2, "gated", "too far", x=1.0, y=2.0, theta=0.0))
    watch.look()

    floor, found = watch.localizers["floor"], watch.localizers["map"]
    assert (floor.n, floor.way_m, floor.rate_hz) == (2, pytest.approx(1.0), pytest.approx(10.0))
    assert (found.outcomes["gated"], found.where, found.reason) == (1, "1.00 m, +2.000 m, +0.0°", "too far")


def test_lost_is_told_with_its_reason(run: Path) -> None:
    append(run, row("eye", "lost", 1.0, "refused", "too dark"))
    watch = RunWatch(run)
    watch.look()

    table = watch.table()

    assert [column.title for column in table.columns][:2] == ["localizer", "lost"]
    assert table.rows[0][-1] == "too dark"


def test_it_ends_when_the_run_does(run: Path) -> None:
    append(run, row("floor", "motion", 0.1, x=0.3, y=0.4, theta=0.0))

    def end() -> None:
        time.sleep(0.3)
        append(run, row("floor", "motion", 0.2, x=0.3, y=0.4, theta=0.0))
        (run / "run.json").write_text(json.dumps({"status": "done"}))

    threading.Thread(target=end).start()
    told = CliRunner().invoke(watch_command, [str(run), "--every", "0.05"])

    assert told.exit_code == 0
    assert f"{run.name}: done" in told.output
    *_, floor = (line.split() for line in told.output.splitlines() if line.strip().startswith("floor"))
    assert floor[1] == "2"  # the last time that it is told


def test_a_bench_is_watched_too(synthetic_folder: Path) -> None:
    told = CliRunner().invoke(watch_command, [str(synthetic_folder), "--once"])

    assert "1 running" in told.output
    assert "toy, seed 1" in told.output


def test_a_bench_in_which_nothing_has_begun_says_so(tmp_path: Path) -> None:
    from trailmark_bench import Index

    Index(tmp_path, write=True).close()

    told = CliRunner().invoke(watch_command, [str(tmp_path), "--once"])

    assert "no cell has begun" in told.output


@pytest.fixture
def synthetic_folder(tmp_path: Path) -> Path:
    from trailmark_bench import Cell, Index

    with Index(tmp_path, write=True) as index:
        index.enter([Cell(f"{seed:0>20}", "", {"localizer": "toy", "seed": seed}, {}) for seed in range(2)])
        index.mark_running(f"{1:0>20}")
    return tmp_path


def test_what_is_no_run_is_told(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"it has no run\.json"):
        RunWatch(tmp_path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("source,stamp_s\na,1\n", "estimates.csv is no table of estimates, or was changed by hand: no column 'kind'"),
        (",".join(ESTIMATE_COLUMNS) + "\n" + ",".join(ESTIMATE_COLUMNS) + "\n", "stamp_s is not a number: 'stamp_s'"),
    ],
)
def test_a_table_that_is_none_is_refused(run: Path, content: str, words: str) -> None:
    (run / "estimates.csv").write_text(content)

    with pytest.raises(DataError, match=words):
        RunWatch(run).look()


@pytest.mark.parametrize("content", ["[]", "3", "null"])
def test_a_status_that_is_none_is_one_that_is_being_written(run: Path, content: str) -> None:
    (run / "run.json").write_text(content)

    assert RunWatch(run).look()
