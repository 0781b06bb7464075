"""Cells: isolated, accounted for, run once, and the same each time."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from trailmark_bench import Index, run_bench
from trailmark_bench.executors.config import LocalConfig
from trailmark_bench.executors.local import LocalExecutor

TOY = Path(__file__).with_name("toy_plugin.py")

#: How localizers end, what the bench must say of it.
ENDS: dict[str, tuple[str, str]] = {
    "drive": ("ok", ""),
    "segfault": ("crashed", "ended by SIGSEGV"),
    "hang": ("timeout", "not done after"),
    "memory": ("failed", "MemoryError"),
    "raise": ("failed", "RuntimeError: the toy broke"),
    "exit": ("crashed", "left with code 0 without a result"),
    "disk": ("failed", "File too large"),
    "silent": ("failed", "never said where it is"),
    "lost": ("failed", "never said where it is"),
}


def torture(n_seeds: int, n_good: int, flag: Path | None = None) -> dict[str, Any]:
    """Return a matrix in which one localizer after the other goes wrong, with good ones between them."""
    localizers: dict[str, Any] = {f"good_{i}": {"plugin": "toy", "scale": 1 + 0.01 * i} for i in range(n_good)}
    for index, how in enumerate(ENDS):
        more = {"flag": str(flag)} if flag is not None else {}
        if how == "hang":
            more["limits"] = {"timeout_s": HANG_S}
        localizers[f"{how}_{index}"] = {"plugin": "toy", "does": how, **more}
    names = sorted(localizers, key=lambda name: name.rpartition("_")[2])
    return {"localizers": {name: localizers[name] for name in names}, "seeds": n_seeds}


#: Cells that hang have a limit of their own: on a machine with much to do the others must not run into it.
LIMITS = {"timeout_s": 300.0, "memory_mb": 2500.0, "file_mb": 20.0}
HANG_S = 10.0


def check_torture(bench_of, run_cells, folder: Path, n_seeds: int, n_good: int) -> None:
    flag = folder / "misbehave"
    flag.touch()
    bench = bench_of(torture(n_seeds, n_good, flag), limits=LIMITS, metrics=["ate_rmse_m"])

    run_cells(bench, folder / "bench")

    with Index(folder / "bench") as index:
        records = {record.label: record for record in index.records()}
        tails = {record.label: index.stderr(record.id) for record in index.records()}
    for label, record in records.items():
        how = label.partition("_")[0]
        state, reason = ENDS.get(how, ("ok", ""))
        assert (record.state, reason in record.reason) == (state, True), (label, record.state, record.reason)
        assert record.attempts == 1
        if state == "ok":
            assert record.result["metrics"], label
            assert record.cpu_s > 0
            assert record.peak_rss_mb > 20
    assert "most recent call first" in next(tail for label, tail in tails.items() if label.startswith("hang"))
    assert "Segmentation fault" in next(tail for label, tail in tails.items() if label.startswith("segfault"))

    good = {label: record.result["metrics"] for label, record in records.items() if record.state == "ok"}
    flag.unlink()  # from here on most of them drive as they should
    again = run_cells(bench, folder / "bench", retry=["failed"])
    with Index(folder / "bench") as index:
        after = {record.label: record for record in index.records()}
    for label, record in after.items():
        how = label.partition("_")[0]
        assert again[label] == ("failed" if how in ("silent", "lost") else "ok"), (label, record.reason)
        assert record.attempts == (1 if label in good else 2)
        if label in good:
            assert record.result["metrics"] == good[label]


def test_no_cell_touches_another(bench_of, run_cells, tmp_path: Path) -> None:
    check_torture(bench_of, run_cells, tmp_path, n_seeds=1, n_good=11)


@pytest.mark.long
def test_two_hundred_cells_go_wrong_in_every_way(bench_of, run_cells, tmp_path: Path) -> None:
    check_torture(bench_of, run_cells, tmp_path, n_seeds=10, n_good=11)


def test_two_runs_give_the_same_bytes_but_for_times(bench_of, run_cells, tmp_path: Path) -> None:
    bench = bench_of({"localizers": ["toy"], "seeds": 2, "perturbations": {"clean": {}, "gaps": {"dropped": 0.3}}})

    for name in ("one", "two"):
        run_cells(bench, tmp_path / name)

    for cell in bench.cells:
        one, two = (tmp_path / name / "cells" / cell.id / "run" for name in ("one", "two"))
        for file in ("metrics.json", "estimates.csv", "config.yaml", "trajectories/toy.tum", "trajectories/fused.tum"):
            assert (one / file).read_bytes() == (two / file).read_bytes()


def test_a_finished_cell_is_never_run_twice(bench_of, run_cells, tmp_path: Path) -> None:
    few = bench_of({"localizers": ["toy"], "seeds": 1})
    more = bench_of({"localizers": ["toy", "odometry"], "seeds": 2})
    run_cells(few, tmp_path)
    started: list[str] = []

    run_cells(more, tmp_path, on_progress=lambda p: started.extend(cell.label for cell in p.running))

    assert set(started) == {"toy, seed 1", "odometry, seed 0", "odometry, seed 1"}
    with Index(tmp_path) as index:
        assert [record.attempts for record in index.records()] == [1, 1, 1, 1]


def test_the_folders_are_the_record_and_the_index_can_be_made_anew(bench_of, run_cells, tmp_path: Path) -> None:
    bench = bench_of({"localizers": {"good": "toy", "bad": {"plugin": "toy", "does": "raise"}}})
    before = run_cells(bench, tmp_path)
    with Index(tmp_path) as index:
        told = {record.label: (record.reason, record.result) for record in index.records()}
    (tmp_path / "index.sqlite").unlink()
    started: list[str] = []

    after = run_cells(bench, tmp_path, on_progress=lambda p: started.extend(cell.label for cell in p.running))

    assert started == []
    assert after == before == {"good, seed 0": "ok", "bad, seed 0": "failed"}
    with Index(tmp_path) as index:
        assert {record.label: (record.reason, record.result) for record in index.records()} == told


def test_what_fits_no_sensor_is_skipped_with_the_reason(bench_of, run_cells, tmp_path: Path) -> None:
    sources = {"wheels": {"plugin": "toy_wheels"}, "lamp": {"plugin": "toy_wheels", "kind": "other"}}
    bench = bench_of({"sources": sources, "localizers": ["toy"], "seeds": 3}, run={"sources": {}})

    states = run_cells(bench, tmp_path, jobs=1)

    assert states == {f"{s}, toy, seed {i}": e for s, e in (("wheels", "ok"), ("lamp", "skipped")) for i in range(3)}
    with Index(tmp_path) as index:
        lamp = index.records()[3:]
    assert all("no sensor of kind odometry for 'wheels'" in record.reason for record in lamp)
    assert [record.attempts for record in lamp] == [1, 0, 0]  # another seed would not bring a sensor


def test_a_cell_is_taught_first_in_a_store_of_its_own(bench_of, run_cells, tmp_path: Path) -> None:
    bench = bench_of({"localizers": ["toy_fixer"], "teach": {}})

    assert run_cells(bench, tmp_path) == {"toy_fixer, seed 0": "ok"}

    folder = tmp_path / "cells" / bench.cells[0].id
    metrics = json.loads((folder / "run" / "metrics.json").read_text())
    assert any(name.startswith("lateral_") for name in metrics["trajectories"]["fused"]["metrics"])
    assert (folder / "teach" / "run.json").is_file()
    assert not (folder / "place.trail").exists()  # keep_stores is off


def test_cells_that_are_to_run_alone_do(bench_of, run_cells, tmp_path: Path) -> None:
    cells = [
        {"name": "any", "localizers": ["toy"], "seeds": 3},
        {"name": "timed", "localizers": {"twin": {"plugin": "toy", "scale": 1.1}}, "seeds": 2, "alone": True},
    ]
    counts: list[list[str]] = []

    run_cells(bench_of(cells), tmp_path, jobs=3, on_progress=lambda p: counts.append([c.matrix for c in p.running]))

    assert not any({"any", "timed"} <= set(running) for running in counts)
    assert max(running.count("any") for running in counts) == 3
    assert max(running.count("timed") for running in counts) == 1


def test_threads_are_pinned_and_load_is_recorded(bench_of, run_cells, tmp_path: Path) -> None:
    run_cells(bench_of({"localizers": ["toy"]}), tmp_path)

    with Index(tmp_path) as index:
        (record,) = index.records()
    assert record.load is not None
    assert record.host == os.uname().nodename


def test_a_bench_that_has_ended_leaves_one_file(bench_of, run_cells, tmp_path: Path) -> None:
    run_cells(bench_of({"localizers": ["toy"]}), tmp_path)

    assert sorted(path.name for path in tmp_path.glob("index*")) == ["index.sqlite"]


def test_only_one_bench_works_in_a_folder(bench_of, run_cells, tmp_path: Path) -> None:
    from trailmark.errors import ConfigError

    with Index(tmp_path, write=True), pytest.raises(ConfigError, match="another bench is at work in"):
        run_cells(bench_of({"localizers": ["toy"]}), tmp_path)


def test_the_bench_itself_costs_little(bench_of, tmp_path: Path) -> None:
    """Time of this process, which starts, watches and writes down: below 50 ms a cell."""
    bench = bench_of({"localizers": ["toy"], "seeds": 6})
    with Index(tmp_path, write=True) as index:
        began_s = time.process_time()
        run_bench(bench.cells, index, LocalExecutor(LocalConfig(jobs=2)))
        cost_s = (time.process_time() - began_s) / 6

        assert {record.state for record in index.records()} == {"ok"}
    assert cost_s < 0.05


CONFIG = """
sources: {{robot: {{plugin: toy_wheels}}}}
bench:
  code: version
  cells:
    localizers: {{good: {{plugin: toy}}, slow: {{plugin: toy, does: sleep}}}}
    seeds: {seeds}
"""


def command(*arguments: Any) -> list[str]:
    return [sys.executable, "-m", "trailmark.cli", "--plugin", str(TOY), "bench", *map(str, arguments)]


def test_a_bench_that_is_killed_goes_on_and_leaves_no_process(tmp_path: Path) -> None:
    (tmp_path / "b.yaml").write_text(CONFIG.format(seeds=3))
    arguments = command(tmp_path / "b.yaml", "--out", tmp_path / "out", "--jobs", 2, "--no-report")
    bench = subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True)
    assert bench.stderr is not None
    for line in bench.stderr:
        if line.startswith("2/6"):
            break
    bench.send_signal(signal.SIGKILL)
    bench.wait()
    bench.stderr.close()
    with Index(tmp_path / "out") as index:
        before = {record.label: record.attempts for record in index.records() if record.state == "ok"}
    assert 2 <= len(before) < 6

    done = subprocess.run([*arguments, "--json"], capture_output=True, text=True, timeout=120, check=True)

    cells = json.loads(done.stdout)
    assert [cell["state"] for cell in cells] == ["ok"] * 6
    labels = {f"{cell['coordinates']['localizer']}, seed {cell['coordinates']['seed']}": cell for cell in cells}
    assert all(labels[label]["attempts"] == 1 for label in before)
    assert not [line for line in command_lines() if str(tmp_path) in line]


def test_ctrl_c_keeps_what_is_finished(tmp_path: Path) -> None:
    (tmp_path / "b.yaml").write_text(CONFIG.format(seeds=3))
    arguments = command(tmp_path / "b.yaml", "--out", tmp_path / "out", "--no-report")
    listen = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # tests in the background would not
    bench = subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True, preexec_fn=listen)
    assert bench.stderr is not None
    for line in bench.stderr:
        if line.startswith("2/6"):
            break
    bench.send_signal(signal.SIGINT)
    _, last = bench.communicate(timeout=30)

    assert bench.returncode == 130
    assert "Traceback" not in last
    with Index(tmp_path / "out") as index:
        states = [record.state for record in index.records()]
    assert states.count("ok") >= 2
    assert set(states) == {"ok", "pending"}


def command_lines() -> list[str]:
    """Return the command line of every process that is left."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            found.append((process / "cmdline").read_bytes().replace(b"\0", b" ").decode("utf-8", "replace"))
    return found


@pytest.mark.parametrize("localizer", ["ground_vo", "klt"])
def test_a_camera_that_does_not_look_down_is_no_failure_of_a_localizer_that_needs_it(
    bench_of, run_cells, tmp_path: Path, localizer: str
) -> None:
    world = {"plugin": "sim", "world": "corridor", "sensors": ["front"], "duration_s": 0.5}
    bench = bench_of({"localizers": [localizer]}, {"sources": {"robot": world}})

    run_cells(bench, tmp_path)

    with Index(tmp_path) as index:
        (record,) = index.records()
    assert record.state == "skipped"
    assert "the scale of a ground camera" in record.reason or "a ground camera needs its scale" in record.reason
