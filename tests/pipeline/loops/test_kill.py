"""A kill while loops are closed leaves the path and all maps as they were, or all of them as they will be."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.stores import SqlitePathStore, SqliteStoreConfig

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")

HERE = Path(__file__).parent
N_PLACES, NEVER = 84, 1_000_000

#: Forks who teaches a store or closes its loops, one for each line of its input, and is killed at a call that the line
#: names; says how that ended.
NURSERY = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import conftest, test_stores
from trailmark.stores import map_rows, sqlite

rounds = conftest.TwoRounds()
nodes = rounds.log(test_stores.N_SHORT)


def killed_at(where, name, at):
    inner, calls = getattr(where, name), [0]

    def counted(*args, **kwargs):
        calls[0] += 1
        if calls[0] == at:
            os.kill(os.getpid(), signal.SIGKILL)
        return inner(*args, **kwargs)

    setattr(where, name, counted)


places = {"keyframe": (map_rows, "add_keyframe"), "commit": (sqlite.SqlitePathStore, "commit")}
places["close"] = (sqlite.SqlitePathStore, "close")
for line in sys.stdin:
    path, what, at = line.split()
    path = Path(path)
    child = os.fork()
    if child == 0:
        if what == "teach":
            test_stores.taught(path, nodes)
        else:
            killed_at(*places[what], int(at))
            test_stores.closed(path, rounds.relating(nodes))
        os._exit(0)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


class Nursery:
    """Starts who teaches and who closes loops."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process

    def run(self, path: Path, what: str, at: int = NEVER) -> int:
        """Return how it ended: 0, or less the number of the signal."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{path} {what} {at}\n".encode())
        self._process.stdin.flush()
        return int(self._process.stdout.readline())


def stored(path: Path) -> list[list[Pose2]]:
    """Return where the waypoints of a store and the keyframes of all its maps lie."""
    store = SqlitePathStore(SqliteStoreConfig(path=str(path), access="read"))
    store.start(Session())
    try:
        way = store.path()
        assert way is not None
        maps = [store.localizer_map(who).keyframes() for who in ("laser", "stranger")]
        return [[one.pose_map_base for one in rows] for rows in (way.waypoints, *maps)]
    finally:
        store.close()


@pytest.fixture(scope="module")
def nursery() -> Iterator[Nursery]:
    command = [sys.executable, "-c", NURSERY, str(HERE)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        yield Nursery(process)
        assert process.stdin is not None
        process.stdin.close()


@pytest.fixture(scope="module")
def old_and_new(
    nursery: Nursery, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, list[list[Pose2]], list[list[Pose2]]]:
    """A taught store, and where its path and maps lie before and after its loops are closed."""
    folder = tmp_path_factory.mktemp("stores")
    taught, whole = folder / "taught.trail", folder / "whole.trail"
    assert nursery.run(taught, "teach") == 0
    shutil.copy(taught, whole)
    assert nursery.run(whole, "close") == 0
    old, new = stored(taught), stored(whole)
    assert all(before != after for before, after in zip(old, new, strict=True))
    return taught, old, new


@pytest.mark.parametrize(
    ("what", "at", "is_closed"),
    [("keyframe", at, False) for at in (1, 2, 40, N_PLACES, N_PLACES + 1, 130, 2 * N_PLACES + 1, 3 * N_PLACES)]
    + [("commit", 1, False), ("close", 2, True)],  # `start` closes what was open
)
def test_a_kill_leaves_the_old_or_the_new(
    nursery: Nursery, old_and_new: Any, tmp_path: Path, what: str, at: int, is_closed: bool
) -> None:
    taught, old, new = old_and_new
    path = tmp_path / "killed.trail"
    shutil.copy(taught, path)
    assert nursery.run(path, what, at) == -signal.SIGKILL
    assert stored(path) == (new if is_closed else old)


def test_what_a_kill_left_open_is_closed_by_the_next(nursery: Nursery, old_and_new: Any, tmp_path: Path) -> None:
    taught, _, new = old_and_new
    path = tmp_path / "killed.trail"
    shutil.copy(taught, path)
    assert nursery.run(path, "keyframe", 100) == -signal.SIGKILL
    assert nursery.run(path, "close") == 0
    assert stored(path) == new
