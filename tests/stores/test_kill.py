"""A teaching that is killed at any instant loses nothing that it had committed."""

from __future__ import annotations

import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from trailmark.stores.check import check_store

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")

HERE = Path(__file__).parent
N_KILLS = 200 if os.environ.get("TRAILMARK_TRUST") == "full" else 20  # `make trust`

#: Imports once, then forks a teacher for each line of its input, and says its process.
NURSERY = """
import os, sys
sys.path.insert(0, sys.argv[1])
from conftest import keyframe, opened, teach
from pathlib import Path
for line in sys.stdin:
    path, access, start = line.split()
    child = os.fork()
    if child == 0:
        with opened(Path(path), access) as store:
            print(os.getpid(), flush=True)
            for index in range(int(start), 100_000):
                store.localizer_map("other").add(keyframe(index))
                teach(store, 1, index)
                print(index + 1, flush=True)
        os._exit(0)
    os.waitpid(child, 0)
    print("dead", flush=True)
"""


class Nursery:
    """Starts teachers and kills them."""

    def __init__(self, process: subprocess.Popen[bytes], rng: np.random.Generator) -> None:
        self._process = process
        self._rng = rng

    def teach_and_kill(self, path: Path, access: str, start: int = 0, n_commits: int = 0) -> int:
        """Kill a teacher after so many commits and a random while; return how many waypoints it had reported."""
        self._process.stdin.write(f"{path} {access} {start}\n".encode())
        self._process.stdin.flush()
        teacher = int(self._process.stdout.readline())
        reported = start
        for _ in range(n_commits):
            reported = int(self._process.stdout.readline())
        select.select([], [], [], float(self._rng.uniform(0.0, 2e-3)))  # anywhere in a commit or between two
        os.kill(teacher, signal.SIGKILL)
        while not (line := self._process.stdout.readline()).endswith(b"dead\n"):  # a number cut off was not reported
            reported = int(line)
        return reported


@pytest.fixture(scope="module")
def nursery() -> Iterator[Nursery]:
    command = [sys.executable, "-c", NURSERY, str(HERE)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        yield Nursery(process, np.random.default_rng(7))
        process.stdin.close()


def test_a_killed_teaching_keeps_every_waypoint_it_had_reported(
    tmp_path: Path, place: SimpleNamespace, nursery: Nursery, record_property: Callable[[str, object], None]
) -> None:
    record_property("kills of a store's writer", N_KILLS)
    for attempt, n_commits in enumerate(np.random.default_rng(7).integers(1, 60, N_KILLS)):
        path = tmp_path / f"{attempt}.trail"

        n_reported = nursery.teach_and_kill(path, "create", n_commits=n_commits)

        with place.opened(path) as store:
            taught = store.path()
            n_keyframes = [len(store.localizer_map(owner).keyframes()) for owner in ("floor", "other")]
        assert len(taught) in (n_reported, n_reported + 1)  # the last one may be committed and not yet reported
        assert taught.waypoints == tuple(place.waypoint(index) for index in range(len(taught)))
        assert n_keyframes == [len(taught)] * 2  # whole transactions, nothing of an open one
        assert check_store(path).is_sound
        assert sorted(os.listdir(tmp_path)) == sorted(f"{number}.trail" for number in range(attempt + 1))


def test_a_killed_teaching_can_be_gone_on_with(tmp_path: Path, place: SimpleNamespace, nursery: Nursery) -> None:
    path, n_waypoints = tmp_path / "a.trail", 0
    for attempt in range(5):
        n_reported = nursery.teach_and_kill(path, "append" if attempt else "create", n_waypoints, n_commits=20)
        with place.opened(path, "append") as store:
            n_waypoints = len(store.path())
        assert n_waypoints in (n_reported, n_reported + 1)
    assert check_store(path).is_sound


def test_a_killed_overwriting_leaves_the_old_store_or_the_new_one(
    taught: Path, place: SimpleNamespace, nursery: Nursery
) -> None:
    kept = taught.with_suffix(".kept")
    shutil.copy(taught, kept)
    before = place.contents(kept)
    outcomes, rng = set(), np.random.default_rng(7)
    for _ in range(10):
        shutil.copy(kept, taught)
        n_reported = nursery.teach_and_kill(taught, "overwrite", n_commits=int(rng.integers(0, 3)))
        with place.opened(taught) as store:
            is_old = store.meta() == place.META
            if n_reported:
                assert not is_old
                assert len(store.path()) in (n_reported, n_reported + 1)
        if is_old:
            assert place.contents(taught) == before
        outcomes.add(is_old)
    assert outcomes == {True, False}


@contextmanager
def read_only(folder: Path) -> Iterator[None]:
    """Make a folder and its files read-only."""
    for file in folder.iterdir():
        file.chmod(0o444)
    folder.chmod(0o555)
    try:
        yield
    finally:
        folder.chmod(0o755)


#: Opens a store as somebody whom the permissions bind: root is not bound.
VISITOR = """
import os, sys
sys.path.insert(0, sys.argv[1])
import numpy.random  # while the environment can be read: it may lie in a folder of root's own
from conftest import opened
from pathlib import Path
if os.geteuid() == 0:
    os.setgid(65534)
    os.setuid(65534)
with opened(Path(sys.argv[2]), sys.argv[3]) as store:
    print(len(store.path()), len(store.localizer_map("floor").keyframes()))
"""


def visit(path: Path, access: str = "read") -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", VISITOR, str(HERE), str(path), access]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("missing", ["", "-shm"])
def test_a_killed_teaching_is_read_on_a_read_only_folder(nursery: Nursery, missing: str) -> None:
    folder = Path(tempfile.mkdtemp())
    try:
        path = folder / "a.trail"
        n_reported = nursery.teach_and_kill(path, "create", n_commits=5)
        for suffix in missing.split():
            path.with_name(path.name + suffix).unlink()
        with read_only(folder):
            before = sorted(os.listdir(folder))
            result = visit(path)
            assert sorted(os.listdir(folder)) == before
        assert result.returncode == 0, result.stderr
        n_waypoints, n_keyframes = map(int, result.stdout.split())
        assert n_waypoints == n_keyframes
        assert n_waypoints in (n_reported, n_reported + 1)
    finally:
        shutil.rmtree(folder)


def test_a_closed_store_is_read_on_a_read_only_folder_and_not_written(place: SimpleNamespace) -> None:
    folder = Path(tempfile.mkdtemp())
    try:
        path = folder / "a.trail"
        with place.opened(path, "create") as store:
            place.teach(store, 4)
        with read_only(folder):
            assert visit(path).stdout.split() == ["4", "4"]
            refused = visit(path, "append")
            assert os.listdir(folder) == ["a.trail"]
        assert "StoreError" in refused.stderr
        assert "cannot be written: its folder is read-only" in refused.stderr
    finally:
        shutil.rmtree(folder)
