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

from trailmark.errors import ConfigError
from trailmark.isolation import ExecutorLostError, Finished, Outcome
from trailmark_bench import Index, run_bench
from trailmark_bench.executors.config import DaskConfig, LocalConfig
from trailmark_bench.executors.dask import DaskExecutor
from trailmark_bench.executors.local import LocalExecutor
from trailmark_bench.remote import pack_request, run_packed

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
    package = pack_request(cell.request, carry_mb=1.0)
    os.unlink(tmp_path / "speed.txt")  # as on a machine that never had it

    answer = run_packed(package)

    assert answer["outcome"]["state"] == "ok", answer["outcome"]
    assert {"result.json", "run/metrics.json", "run/trajectories/fused.tum"} <= answer["files"].keys()
    assert json.loads(answer["files"]["result.json"])["metrics"]


def test_what_is_too_large_to_be_sent_must_be_there(bench_of, tmp_path: Path) -> None:
    (cell,) = recording_bench(bench_of, tmp_path).cells
    package = pack_request(cell.request, carry_mb=0.0)
    package["carried"] |= pack_request({**cell.request, "data": {}}, carry_mb=1.0)["carried"]
    (tmp_path / "speed.txt").write_text("2.0")  # another recording of the same name

    outcome = run_packed(package)["outcome"]

    assert outcome["state"] == "failed"
    assert "is not on this worker, or is another one" in outcome["reason"]


def test_a_worker_with_other_code_refuses(bench_of, tmp_path: Path) -> None:
    (cell,) = recording_bench(bench_of, tmp_path).cells
    package = pack_request(cell.request, carry_mb=1.0)

    other = run_packed({**package, "trailmark": "9.9.9"})["outcome"]
    changed = {**package["request"], "code": {"trailmark_sim": "0.1.0 0123456789abcdef"}}
    digest = run_packed({**package, "request": changed})["outcome"]

    assert "the bench 9.9.9" in other["reason"]
    assert "other code of trailmark_sim" in digest["reason"]


class Moody(LocalExecutor):
    """Loses what its script says: ``cell`` the next that ends, ``all`` everything; ``away``: it does not start."""

    script: list[str]

    def start(self, workspace: Path) -> None:
        if self.script[:1] == ["away"]:
            self.script.pop(0)
            raise ConfigError("nobody answers")
        super().start(workspace)

    def wait(self, timeout_s: float) -> list[Finished]:
        found = list(super().wait(timeout_s))
        if found and self.script[:1] == ["all"]:
            self.script.pop(0)
            raise ExecutorLostError("the scheduler is lost")
        for place, finished in enumerate(found):
            if self.script[:1] == ["cell"]:
                self.script.pop(0)
                found[place] = Finished(finished.id, Outcome("crashed", "its worker was lost"), is_lost=True)
        return found


def run_moody(bench, folder: Path, script: list[str], patience_s: float = 5.0):
    executor = Moody(LocalConfig(jobs=1))
    executor.script = script
    try:
        with Index(folder, write=True) as index:
            return run_bench(bench.cells, index, executor, patience_s=patience_s)
    finally:
        assert not (folder / "cells" / ".work").exists()


def states(folder: Path) -> list[tuple[str, int]]:
    with Index(folder) as index:
        return [(record.state, record.attempts) for record in index.records()]


@pytest.mark.parametrize("script", [["cell"], ["all"], ["all", "away"], ["cell", "all", "away", "away"]])
def test_what_is_lost_is_run_again_and_is_no_failure(bench_of, tmp_path: Path, script: list[str]) -> None:
    n_lost = sum(word != "away" for word in script)

    assert run_moody(bench_of({"localizers": ["toy"], "seeds": 2}), tmp_path, list(script)) == ()

    assert [state for state, _ in states(tmp_path)] == ["ok", "ok"]
    assert sum(attempts for _, attempts in states(tmp_path)) == 2 + n_lost


def test_an_executor_that_does_not_come_back_leaves_its_cells_pending(bench_of, tmp_path: Path) -> None:
    bench = bench_of({"localizers": ["toy"], "seeds": 2})

    with pytest.raises(ExecutorLostError, match="the scheduler is lost; nobody answers; the same command goes on"):
        run_moody(bench, tmp_path, ["all", *["away"] * 9], patience_s=0.1)
    assert states(tmp_path) == [("pending", 1), ("pending", 0)]

    run_moody(bench, tmp_path, [])
    assert states(tmp_path) == [("ok", 2), ("ok", 1)]


def test_a_cell_that_is_lost_every_time_is_left_for_later(bench_of, tmp_path: Path) -> None:
    bench = bench_of({"localizers": ["toy"], "seeds": 2})

    lost = run_moody(bench, tmp_path, ["cell"] * 6)

    assert [cell.id for cell in lost] == [cell.id for cell in bench.cells]
    assert states(tmp_path) == [("pending", 3), ("pending", 3)]


class Cluster:
    """A scheduler and two workers on this machine."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self._port = free.getsockname()[1]
        self._folder = folder
        self.address = f"tcp://127.0.0.1:{self._port}"
        self.workers: list[subprocess.Popen[bytes]] = []

    def start_all(self) -> None:
        port = ("--host", "127.0.0.1", "--port", str(self._port))
        self.scheduler = self._start("dask_scheduler", *port, "--no-dashboard", "--no-jupyter")
        options = (
            "--nthreads",
            "1",
            "--no-nanny",
            "--no-dashboard",
            "--local-directory",
            str(self._folder / "scratch"),
        )
        self.workers = [self._start("dask_worker", self.address, *options) for _ in range(2)]

    def kill(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()

    def _start(self, module: str, *arguments: str) -> subprocess.Popen[bytes]:
        environment = os.environ | {"DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "60s"}
        command = [sys.executable, "-m", f"distributed.cli.{module}", *arguments]
        with (self._folder / f"{module}.log").open("ab") as log:
            return subprocess.Popen(command, stdout=log, stderr=log, env=environment, cwd=self._folder)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    """A scheduler and two workers, each a process of its own."""
    pytest.importorskip("distributed", reason="the extra [dask] is not installed")
    found = Cluster(tmp_path)
    found.start_all()
    yield found
    found.kill()


@pytest.mark.long
def test_a_cluster_loses_and_doubles_nothing_when_a_worker_is_killed(cluster: Cluster, tmp_path: Path) -> None:
    address, workers = cluster.address, cluster.workers
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


def test_a_cluster_that_is_lost_and_comes_back_goes_on(cluster: Cluster, bench_of, tmp_path: Path) -> None:
    """Its scheduler and its workers die in the middle; new ones come at the same address."""
    bench = bench_of({"localizers": {"slow": {"plugin": "toy", "does": "sleep"}}, "seeds": 4})
    is_lost = False

    def lose_it_once(status) -> None:
        nonlocal is_lost
        if status.finished is not None and not is_lost:
            is_lost = True
            cluster.kill()
            cluster.start_all()

    with Index(tmp_path / "out", write=True) as index:
        executor = DaskExecutor(DaskConfig(scheduler=cluster.address, jobs=2))
        lost = run_bench(bench.cells, index, executor, on_progress=lose_it_once)

    assert is_lost
    assert lost == ()
    assert [state for state, _ in states(tmp_path / "out")] == ["ok"] * 4
    assert max(attempts for _, attempts in states(tmp_path / "out")) == 2


@pytest.mark.long
def test_a_cluster_that_is_lost_for_good_leaves_pending_cells(cluster: Cluster, bench_of, tmp_path: Path) -> None:
    bench = bench_of({"localizers": {"slow": {"plugin": "toy", "does": "sleep"}}, "seeds": 3})

    def lose_it(status) -> None:
        if status.finished is not None:
            cluster.kill()

    executor = DaskExecutor(DaskConfig(scheduler=cluster.address, jobs=1))
    with (
        Index(tmp_path / "out", write=True) as index,
        pytest.raises(ExecutorLostError, match=r"scheduler at .* is lost"),
    ):
        run_bench(bench.cells, index, executor, on_progress=lose_it, patience_s=0.0)

    found = sorted(state for state, _ in states(tmp_path / "out"))
    assert found == ["ok", "pending", "pending"]
