"""Cells that are forked from a process that has imported what they need: quicker, and otherwise as programs."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from trailmark.isolation.launching import ForkedProcess
from trailmark.isolation.outcome import Outcome
from trailmark.isolation.warm_parent import WarmParent
from trailmark_bench import Index, run_bench
from trailmark_bench.executors.config import LocalConfig
from trailmark_bench.executors.local import LocalExecutor
from trailmark_bench.process import CELL_MODULE, cell_process, run_to_end

pytestmark = pytest.mark.skipif(not WarmParent.is_possible(), reason="processes are forked so on Linux")

FILES = ("metrics.json", "estimates.csv", "config.yaml", "trajectories/toy.tum", "trajectories/fused.tum")
LIBRARIES = {"trailmark", "trailmark_bench", "numpy", "scipy", "numba", "cv2", "pydantic"}


@pytest.fixture
def parent() -> Any:
    parent = WarmParent(CELL_MODULE, 1)
    yield parent
    parent.close()


def run_one(bench: Any, folder: Path, parent: WarmParent | None) -> tuple[Outcome, bool]:
    folder.mkdir()
    process = cell_process(bench.cells[0].request, folder, parent)
    return run_to_end(process, folder), process.was_warm


def test_warm_cells_say_the_same_byte_by_byte(bench_of, tmp_path: Path) -> None:
    bench = bench_of({"localizers": ["toy"], "perturbations": {"gaps": {"dropped": 0.3}}})

    for name, is_warm in {"warm": True, "cold": False}.items():
        with Index(tmp_path / name, write=True) as index:
            run_bench(bench.cells, index, LocalExecutor(LocalConfig(warm=is_warm)))

    for cell in bench.cells:
        warm, cold = (tmp_path / name / "cells" / cell.id / "run" for name in ("warm", "cold"))
        assert [(warm / file).read_bytes() for file in FILES] == [(cold / file).read_bytes() for file in FILES]


def test_what_a_cell_uses_hangs_on_no_neighbour(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is prepared is there for the first cell; what a neighbour has imported is there for none."""
    (tmp_path / "large.py").write_text("held = bytearray(b'x' * 150_000_000)\n")
    (tmp_path / "prepared.py").write_text("")
    (tmp_path / "kind.py").write_text(
        "import pathlib, sys\n\n"
        "def prepare(arguments):\n    import prepared\n\n"
        "def main(arguments):\n    folder = pathlib.Path(arguments[0])\n"
        "    (folder / 'there').write_text(str([name in sys.modules for name in ('prepared', 'large')]))\n"
        "    if folder.name == 'second':\n        import large\n    return 0\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    parent = WarmParent("kind", 1)
    peaks = {}

    for name in ("first", "second", "third"):
        (tmp_path / name).mkdir()
        process = ForkedProcess(parent, tmp_path / name, tmp_path / name, {})
        assert select.select([process.stderr], [], [], 60.0)[0]
        assert not os.read(process.stderr, 1000)
        peaks[name] = process.reap().peak_rss_mb
        process.close()
        assert (tmp_path / name / "there").read_text() == "[True, False]"
    parent.close()

    assert peaks["second"] > 150.0
    assert abs(peaks["third"] - peaks["first"]) < 20.0


def test_cells_import_nothing_that_is_not_prepared(bench_of, tmp_path: Path) -> None:
    """Processor time of cells holds no imports of Trailmark and of numeric libraries, not of the first either."""
    folder = tmp_path / "cell"
    folder.mkdir()
    (folder / "cell.json").write_text(json.dumps(bench_of({"localizers": ["toy"]}).cells[0].request))
    code = (
        "import os, sys; from trailmark_bench.child import main, prepare; told = [sys.argv[1], str(os.getppid())]\n"
        "prepare(told); before = set(sys.modules); left = main(told)\n"
        "print(left, *sorted({name for name in set(sys.modules) - before}))"
    )

    done = subprocess.run(
        [sys.executable, "-c", code, str(folder)], cwd=tmp_path, capture_output=True, text=True, check=True
    )

    left, *imported = done.stdout.split()
    assert left == "0"
    assert [name for name in imported if name.split(".")[0] in LIBRARIES] == []


@pytest.mark.slow
def test_a_cell_that_is_forked_is_watched_and_ended_like_any(bench_of, parent: WarmParent, tmp_path: Path) -> None:
    bench = bench_of({"localizers": {"toy": {"plugin": "toy", "does": "litter"}}}, limits={"disk_mb": 20})

    outcome, was_warm = run_one(bench, tmp_path / "cell", parent)

    assert was_warm
    assert (outcome.state, outcome.reason) == ("failed", "left more than 20 MB on disk")
    assert parent.is_idle


def test_a_cell_that_crashes_warm_is_run_again_as_a_program(
    bench_of, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Were the warm process to blame, the cell would be good alone."""
    tried: list[bool] = []

    def crash_if_warm(process: Any, folder: Path) -> Outcome:
        outcome = run_to_end(process, folder)
        tried.append(process.was_warm)
        return Outcome("crashed", "ended by SIGSEGV") if process.was_warm else outcome

    monkeypatch.setattr("trailmark_bench.executors.local.run_to_end", crash_if_warm)
    with Index(tmp_path, write=True) as index:
        run_bench(bench_of({"localizers": ["toy"]}).cells, index, LocalExecutor(LocalConfig()))
        (record,) = index.records()

    assert tried == [True, False]
    assert record.state == "ok"


@pytest.mark.slow
def test_cells_whose_parent_is_killed_are_run_as_programs(
    bench_of, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lose_the_parent(self: WarmParent, pid: int) -> Any:
        os.kill(self._pid, signal.SIGKILL)
        return reap(self, pid)

    reap: Callable[..., Any] = WarmParent.reap
    monkeypatch.setattr(WarmParent, "reap", lose_the_parent)
    with Index(tmp_path, write=True) as index:
        run_bench(bench_of({"localizers": ["toy"], "seeds": 2}).cells, index, LocalExecutor(LocalConfig()))
        states = [record.state for record in index.records()]

    assert states == ["ok", "ok"]


@pytest.mark.slow
def test_a_process_with_threads_is_not_forked(bench_of, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "threaded.py").write_text(
        "import threading, time\nthreading.Thread(target=time.sleep, args=[60]).start()\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    parent = WarmParent("threaded", 1)

    outcome, was_warm = run_one(bench_of({"localizers": ["toy"]}), tmp_path / "cell", parent)
    parent.close()

    assert outcome.state == "ok"
    assert not was_warm
