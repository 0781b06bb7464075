"""Cells elsewhere: they carry what they need; a worker that dies loses nothing and doubles nothing."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from trailmark_bench import Index
from trailmark_bench.remote import packed, run_packed

TOY = Path(__file__).with_name("toy_plugin.py")
CONFIG = """
sources: {robot: {plugin: toy_wheels, recording: speed.txt}}
bench:
  code: version
  cells:
    localizers: {good: {plugin: toy, does: sleep}, crash: {plugin: toy, does: segfault}}
    seeds: 5
"""


def recording_bench(bench_of, folder: Path):
    (folder / "speed.txt").write_text("1.5")
    source = {"plugin": "toy_wheels", "recording": str(folder / "speed.txt")}
    return bench_of({"localizers": ["toy"]}, run={"sources": {"robot": source}})


def test_a_cell_carries_its_recordings_and_plugins(bench_of, tmp_path: Path) -> None:
    (cell,) = recording_bench(bench_of, tmp_path).cells
    package = packed(cell.request, carry_mb=1.0)
    os.unlink(tmp_path / "speed.txt")  # as on a machine that never had it

    answer = run_packed(package)

    assert answer["outcome"]["state"] == "ok", answer["outcome"]
    assert {"result.json", "run/metrics.json", "run/trajectories/fused.tum"} <= answer["files"].keys()
    assert json.loads(answer["files"]["result.json"])["metrics"]


def test_what_is_too_large_to_be_sent_must_be_there(bench_of, tmp_path: Path) -> None:
    (cell,) = recording_bench(bench_of, tmp_path).cells
    package = packed(cell.request, carry_mb=0.0)
    package["carried"] |= packed({**cell.request, "data": {}}, carry_mb=1.0)["carried"]
    (tmp_path / "speed.txt").write_text("2.0")  # another recording of the same name

    outcome = run_packed(package)["outcome"]

    assert outcome["state"] == "failed"
    assert "is not on this worker, or is another one" in outcome["reason"]


def test_a_worker_with_other_code_refuses(bench_of, tmp_path: Path) -> None:
    (cell,) = recording_bench(bench_of, tmp_path).cells
    package = packed(cell.request, carry_mb=1.0)

    other = run_packed({**package, "trailmark": "9.9.9"})["outcome"]
    changed = {**package["request"], "code": {"trailmark_sim": "0.1.0 0123456789abcdef"}}
    digest = run_packed({**package, "request": changed})["outcome"]

    assert "the bench 9.9.9" in other["reason"]
    assert "other code of trailmark_sim" in digest["reason"]


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler and two workers, each a process of its own."""
    pytest.importorskip("distributed", reason="the extra [dask] is not installed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    environment = os.environ | {"DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "60s"}

    def start(module: str, *arguments: str) -> subprocess.Popen[bytes]:
        log = (tmp_path / f"{module}.log").open("ab")
        command = [sys.executable, "-m", f"distributed.cli.{module}", *arguments]
        return subprocess.Popen(command, stdout=log, stderr=log, env=environment, cwd=tmp_path)

    scheduler = start("dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard", "--no-jupyter")
    options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(tmp_path / "scratch"))
    workers = [start("dask_worker", address, *options) for _ in range(2)]
    yield address, workers
    for process in (*workers, scheduler):
        process.kill()
        process.wait()


@pytest.mark.long
def test_a_cluster_loses_and_doubles_nothing_when_a_worker_is_killed(cluster, tmp_path: Path) -> None:
    address, workers = cluster
    (tmp_path / "b.yaml").write_text(CONFIG)
    (tmp_path / "speed.txt").write_text("1.0")
    out = tmp_path / "out"
    command = [sys.executable, "-m", "trailmark.cli", "--plugin", str(TOY), "bench", str(tmp_path / "b.yaml")]
    bench = subprocess.Popen(
        [*command, "--out", str(out), "--executor", "dask", "--scheduler", address, "--no-report", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert bench.stderr is not None
    assert bench.stdout is not None
    for line in bench.stderr:
        if line.startswith("2/10"):
            time.sleep(1.0)
            workers[0].send_signal(signal.SIGKILL)
            break
    cells = json.loads(bench.stdout.read())
    bench.stderr.read()

    assert bench.wait(timeout=30) == 0
    assert [cell["state"] for cell in cells] == ["ok"] * 5 + ["crashed"] * 5
    assert all("SIGSEGV" in cell["reason"] for cell in cells[5:])
    folders = sorted(path.name for path in (out / "cells").iterdir() if not path.name.startswith("."))
    assert folders == sorted(cell["id"] for cell in cells)

    local = subprocess.run([*command, "--out", str(tmp_path / "local"), "--jobs", "2", "--no-report", "--json"],
                           capture_output=True, text=True, check=True)  # fmt: skip
    assert [cell.get("metrics") for cell in json.loads(local.stdout)] == [cell.get("metrics") for cell in cells]
    with Index(out) as there, Index(tmp_path / "local") as here:
        assert [record.id for record in there.records()] == [record.id for record in here.records()]
    shutil.rmtree(out)
