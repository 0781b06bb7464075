"""What a cell may use: beyond it the cell fails, and nothing of it stays behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from trailmark_bench import Index

TOY = Path(__file__).with_name("toy_plugin.py")


def reason_of(folder: Path, state: str = "failed") -> str:
    with Index(folder) as index:
        (record,) = index.records()
    assert record.state == state, record
    return record.reason


def command_lines() -> list[str]:
    """Return the command line of every process that there is."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            found.append((process / "cmdline").read_bytes().replace(b"\0", b" ").decode("utf-8", "replace"))
        except OSError:
            continue
    return found


def test_many_small_files_are_too_much_together(bench_of, run_cells, tmp_path: Path, monkeypatch) -> None:
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)

    run_cells(bench_of({"localizers": {"toy": {"plugin": "toy", "does": "litter"}}}, limits={"disk_mb": 20}), tmp_path)

    assert reason_of(tmp_path) == "left more than 20 MB on disk"
    assert list(here.iterdir()) == []  # not even in the folder where the bench was started
    left = sum(file.stat().st_size for file in (tmp_path / "cells").rglob("*") if file.is_file())
    assert left < 20e6


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="processes are found through /proc")
def test_a_cell_may_not_start_processes_without_end(bench_of, run_cells, tmp_path: Path) -> None:
    began_s = time.monotonic()

    run_cells(bench_of({"localizers": {"toy": {"plugin": "toy", "does": "fork"}}}, limits={"processes": 8}), tmp_path)

    assert reason_of(tmp_path) == "had more than 8 processes"
    assert time.monotonic() - began_s < 30
    assert not any(line.startswith("sleep 300") for line in command_lines())


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="processes are found through /proc")
def test_a_process_in_a_session_of_its_own_ends_with_its_cell(bench_of, run_cells, tmp_path: Path) -> None:
    run_cells(bench_of({"localizers": {"toy": {"plugin": "toy", "does": "daemon"}}}), tmp_path)

    assert reason_of(tmp_path, "ok") == ""
    assert not any("298765" in line for line in command_lines())


CONFIG = """
sources: {robot: {plugin: toy_wheels}}
bench:
  code: version
  cells:
    localizers: {slow: {plugin: toy, does: sleep}}
    seeds: 4
"""


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "trailmark.cli", "--plugin", str(TOY), "bench", *map(str, arguments)]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_bench_that_is_told_to_end_keeps_what_is_done_and_leaves_no_process(tmp_path: Path, number: int) -> None:
    (tmp_path / "b.yaml").write_text(CONFIG)
    arguments = command(tmp_path / "b.yaml", "--out", tmp_path / "out", "--no-report")
    listen = partial(signal.signal, number, signal.SIG_DFL)
    bench = subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True, preexec_fn=listen)
    assert bench.stderr is not None
    for line in bench.stderr:
        if line.startswith("1/4"):
            break
    bench.send_signal(number)
    _, last = bench.communicate(timeout=30)

    assert bench.returncode == 128 + number
    assert "what is finished is kept" in last
    assert "Traceback" not in last
    with Index(tmp_path / "out") as index:
        states = [record.state for record in index.records()]
    assert set(states) == {"ok", "pending"}
    assert not (tmp_path / "out" / "cells" / ".work").exists()
    assert not any(str(tmp_path) in line for line in command_lines())


def test_a_hangup_that_is_ignored_stays_ignored(tmp_path: Path) -> None:
    """As under nohup."""
    (tmp_path / "b.yaml").write_text(CONFIG.replace("seeds: 4", "seeds: 2"))
    arguments = command(tmp_path / "b.yaml", "--out", tmp_path / "out", "--no-report")
    ignore = partial(signal.signal, signal.SIGHUP, signal.SIG_IGN)
    bench = subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True, preexec_fn=ignore)
    assert bench.stderr is not None
    for line in bench.stderr:
        if line.startswith("1/2"):
            bench.send_signal(signal.SIGHUP)
    assert bench.wait(timeout=60) == 0
    bench.stderr.close()


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are text elsewhere")
def test_a_folder_whose_name_is_no_utf_8_is_a_folder(tmp_path: Path) -> None:
    (tmp_path / "b.yaml").write_text(CONFIG.replace("seeds: 4", "seeds: 1").replace("does: sleep", "does: drive"))
    out = os.fsencode(tmp_path) + b"/caf\xe9"

    for last in (b"--jobs=2", b"--list"):
        command_line = [os.fsencode(word) for word in command(tmp_path / "b.yaml", "--out")] + [out, last]
        done = subprocess.run(command_line, capture_output=True, check=False)
        assert done.returncode == 0, done.stderr.decode("utf-8", "replace")

    assert os.path.isfile(out + b"/report.html")
    shown = subprocess.run([os.fsencode(word) for word in command("show")] + [out], capture_output=True, check=False)
    assert shown.returncode == 0, shown.stderr
    assert b"1 cells: 1 ok" in shown.stdout
