"""Processes that are killed at random instants: what was committed is there, and the work goes on.

A share in each run of the tests; 200 kills with ``TRAILMARK_TRUST=full`` (`make trust`).
"""

from __future__ import annotations

import json
import os
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark.interfaces import Session
from trailmark.stores import SqlitePathStore, SqliteStoreConfig
from trailmark.stores.check import check_store
from trailmark_bench import Index

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")

IS_FULL = os.environ.get("TRAILMARK_TRUST") == "full"
N_TEACH, N_APPEND, N_REPLAY, N_BENCH = (100, 40, 40, 20) if IS_FULL else (5, 3, 3, 2)

#: Imports once; then forks a process for each line of its input, runs it as a command, and says how it ended.
NURSERY = """
import json, os, sys
from trailmark.cli import main
for line in sys.stdin:
    arguments, said = json.loads(line)
    child = os.fork()
    if child == 0:
        os.setsid()
        for number in (1, 2):
            os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_APPEND), number)
        try:
            main(arguments)
        except SystemExit as end:
            os._exit(end.code if isinstance(end.code, int) else 0)
        os._exit(0)
    print(child, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""

CONFIG = """
sources: {wheels: {plugin: csv_odometry, path: wheels.csv}}
localizers: {wheels: {plugin: odometry}}
path_store: {spacing_m: 0.02}
"""


class Nursery:
    """Runs commands and kills them."""

    def __init__(self, process: subprocess.Popen[bytes], folder: Path) -> None:
        self._process = process
        self._said = folder / "said"
        self.rng = np.random.default_rng(7)

    def run(self, *arguments: Any, kill_after_s: float = 100.0) -> tuple[int, float, str]:
        """Run a command; return how it ended, how long it took [s], and what it said. -9: it was killed."""
        self._said.unlink(missing_ok=True)
        self._process.stdin.write(json.dumps([[str(one) for one in arguments], str(self._said)]).encode() + b"\n")
        self._process.stdin.flush()
        child = int(self._process.stdout.readline())
        began_s = time.perf_counter()
        if not select.select([self._process.stdout], [], [], kill_after_s)[0]:
            os.kill(child, signal.SIGKILL)
        code = int(self._process.stdout.readline())
        return code, time.perf_counter() - began_s, self._said.read_text() if self._said.exists() else ""

    def kills(self, n: int, takes_s: float, start: Callable[[int, float], tuple[int, float, str]]) -> Iterator[str]:
        """Kill a command at `n` instants of its life, as often as that takes; yield what it had said."""
        done = 0
        for attempt in range(10 * n):
            code, took_s, said = start(attempt, float(self.rng.uniform(0.0, takes_s)))
            if code != -signal.SIGKILL:
                assert code == 0, said
                takes_s = min(takes_s, took_s)  # the first run of all may have been a slow one
            if code == -signal.SIGKILL:
                done += 1
                yield said
            if done == n:
                return
        raise AssertionError(f"{done} of {n} kills in {10 * n} attempts: it ends before it can be killed")


@pytest.fixture(scope="module")
def nursery(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Nursery]:
    command = [sys.executable, "-c", NURSERY]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        yield Nursery(process, tmp_path_factory.mktemp("nursery"))
        process.stdin.close()


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("config")
    rows = "".join(f"{0.05 * i:.2f},{0.02 * i:.2f},0,0\n" for i in range(200))
    (folder / "wheels.csv").write_text(f"t,x,y,theta\n{rows}")
    (folder / "config.yaml").write_text(CONFIG)
    return folder / "config.yaml"


def reported(said: str) -> int:
    """Return how many waypoints a teaching said that it had committed; a line cut off was not said."""
    whole = said[: said.rfind("\n") + 1].splitlines()
    return sum(json.loads(line)["committed"] for line in whole if line.startswith("{"))


def waypoints(store: Path) -> int:
    """Return how many waypoints a store holds, one after the other."""
    opened = SqlitePathStore(SqliteStoreConfig(path=str(store)))
    opened.start(Session(mode="replay"))
    path = opened.path()
    opened.close()
    numbers = [] if path is None else [waypoint.index for waypoint in path.waypoints]
    assert numbers == list(range(len(numbers)))
    return len(numbers)


_NUMBERS = count()


def teach(config: Path, store: Path, *more: str) -> list[Any]:
    out = store.with_suffix(f".run{next(_NUMBERS)}")
    return ["teach", config, "--store", store, "--out", out, "--progress", "json", "--no-report", *more]


def test_a_killed_teaching_keeps_what_it_said(
    nursery: Nursery, config: Path, tmp_path: Path, record_property: Any
) -> None:
    code, takes_s, said = nursery.run(*teach(config, tmp_path / "whole.trail"))
    assert code == 0, said
    n_kept = []

    def start(attempt: int, kill_after_s: float) -> tuple[int, float, str]:
        (tmp_path / "a.trail").unlink(missing_ok=True)
        return nursery.run(*teach(config, tmp_path / "a.trail"), kill_after_s=kill_after_s)

    for said in nursery.kills(N_TEACH, takes_s, start):
        n_reported = reported(said)
        if not (tmp_path / "a.trail").exists():
            assert n_reported == 0
            continue
        n_kept.append(waypoints(tmp_path / "a.trail"))
        assert n_kept[-1] >= n_reported
        assert check_store(tmp_path / "a.trail").is_sound
    record_property("kills of teach, into a new store", N_TEACH)
    assert not IS_FULL or (min(n_kept), max(n_kept)) > (0, 20)  # in the middle of it, not only before and after


def test_a_killed_teaching_is_gone_on_with(
    nursery: Nursery, config: Path, tmp_path: Path, record_property: Any
) -> None:
    store = tmp_path / "a.trail"
    code, takes_s, _ = nursery.run(*teach(config, store))
    assert code == 0
    before = waypoints(store)

    def start(attempt: int, kill_after_s: float) -> tuple[int, float, str]:
        return nursery.run(*teach(config, store, "--append"), kill_after_s=kill_after_s)

    for said in nursery.kills(N_APPEND, takes_s, start):
        now = waypoints(store)
        assert now >= max(before, reported(said))  # what was there already is said again
        assert check_store(store).is_sound
        before = now
    record_property("kills of teach, into a store that is there", N_APPEND)


def test_a_killed_replay_leaves_the_store_as_it_is(
    nursery: Nursery, config: Path, tmp_path: Path, record_property: Any
) -> None:
    store = tmp_path / "a.trail"
    nursery.run(*teach(config, store))
    arguments = ["replay", config, "--store", store, "--out", tmp_path / "replay", "--overwrite", "--no-report"]
    code, takes_s, said = nursery.run(*arguments)
    assert code == 0, said
    content = store.read_bytes()

    for _ in nursery.kills(N_REPLAY, takes_s, lambda _, after_s: nursery.run(*arguments, kill_after_s=after_s)):
        assert store.read_bytes() == content
        assert sorted(path.name for path in tmp_path.glob("a.trail*")) == ["a.trail"]
    code, _, said = nursery.run(*arguments)

    assert code == 0, said
    record_property("kills of replay", N_REPLAY)


def test_a_killed_bench_keeps_what_was_finished(
    nursery: Nursery, config: Path, tmp_path: Path, record_property: Any
) -> None:
    shutil.copy(config.with_name("wheels.csv"), tmp_path)
    cells = "bench: {code: version, cells: {seeds: 3, localizers: {one: {plugin: odometry}, two: {plugin: odometry}}}}"
    (tmp_path / "bench.yaml").write_text(CONFIG.replace("localizers: {wheels: {plugin: odometry}}", cells))
    arguments = ["bench", tmp_path / "bench.yaml", "--out", tmp_path / "out", "--no-report"]
    code, takes_s, said = nursery.run(*arguments[:-2], tmp_path / "whole", "--no-report")
    assert code == 0, said
    finished: dict[str, Any] = {}

    def start(attempt: int, kill_after_s: float) -> tuple[int, float, str]:
        if len(finished) == 6:  # anew
            finished.clear()
            shutil.rmtree(tmp_path / "out")
        return nursery.run(*arguments, kill_after_s=kill_after_s)

    for _ in nursery.kills(N_BENCH, 0.7 * takes_s, start):
        if (tmp_path / "out" / "index.sqlite").exists():
            with Index(tmp_path / "out") as index:
                now = {record.id: record for record in index.records() if record.state == "ok"}
            for cell, record in finished.items():
                assert now[cell].attempts == record.attempts
                assert now[cell].result == record.result
            finished.update(now)
    code, _, said = nursery.run(*arguments)

    assert code == 0, said
    with Index(tmp_path / "out") as index:
        assert [record.state for record in index.records()] == ["ok"] * 6
    record_property("kills of bench", N_BENCH)
