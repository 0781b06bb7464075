"""Processes that cells are forked from: their origin, their end, and another in the place of one that is lost."""

from __future__ import annotations

import os
import select
import signal
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from trailmark.isolation.launching import ForkedProcess
from trailmark.isolation.warm_parent import WarmParent
from trailmark_bench.executors.warm import WarmParents

pytestmark = pytest.mark.skipif(not WarmParent.is_possible(), reason="processes are forked so on Linux")


def test_parents_are_forked_from_one_that_has_imported_what_all_need(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What one kind of children needs is in no process of another kind; their origin takes them with it."""
    (tmp_path / "common.py").write_text("")
    (tmp_path / "needed.py").write_text("")
    (tmp_path / "family.py").write_text(
        "import os, pathlib, sys\n\nCOMMON = ('common',)\n\n"
        "def prepare(arguments):\n    if 'first' in arguments[0]:\n        import needed\n\n"
        "def main(arguments):\n    there = [name in sys.modules for name in ('common', 'needed')]\n"
        "    (pathlib.Path(arguments[0]) / 'there').write_text(f'{there} {os.getppid()}')\n    return 0\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    origin = WarmParent("family", 1)
    parents = {name: WarmParent("family", 1, origin) for name in ("first", "second")}

    for name, parent in parents.items():
        (tmp_path / name).mkdir()
        process = ForkedProcess(parent, tmp_path / name, tmp_path / name, {})
        assert select.select([process.stderr], [], [], 60.0)[0]
        assert process.reap().status == 0
        process.close()

    told = {name: (tmp_path / name / "there").read_text().rpartition(" ") for name in parents}
    assert {name: there for name, (there, _, _) in told.items()} == {"first": "[True, True]", "second": "[True, False]"}
    assert told["first"][2] != told["second"][2]
    origin.close()
    for parent in parents.values():
        with pytest.raises(ConnectionError):
            parent.fork(tmp_path, tmp_path, {}, 2)
        parent.close()


def test_the_process_ends_with_its_children(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The child would sleep for a minute."""
    (tmp_path / "sleeper.py").write_text(
        "import time\nfrom trailmark.isolation.child import die_with\n\n"
        "def main(arguments):\n    die_with(int(arguments[1]))\n"
        "    open(arguments[0] + '/began', 'w').close()\n    time.sleep(60)\n    return 0\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    parent = WarmParent("sleeper", 1)
    reading, said = os.pipe()
    pid = parent.fork(tmp_path, tmp_path, {}, said)
    ended = os.pidfd_open(pid)
    wait_for((tmp_path / "began").exists)

    parent.close()

    try:
        assert select.select([ended], [], [], 20.0)[0]
    finally:
        for descriptor in (ended, reading, said):
            os.close(descriptor)
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def request_of(plugin: str) -> dict[str, Any]:
    """Return what `WarmParents` looks at in the request of a cell."""
    document = {"estimator": {"plugin": plugin}}
    return {"limits": {"threads": 1}, "plugins": {}, "code": [], "document": document, "teach": None}


@pytest.fixture
def parents(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return parents of children that do nothing; what they have in common is imported once ``go`` is there."""
    (tmp_path / "common.py").write_text(
        "import pathlib, time\n\nhere = pathlib.Path(__file__).parent\n(here / 'began').write_text('')\n"
        "while not (here / 'go').exists():\n    time.sleep(0.01)\n"
    )
    (tmp_path / "idler.py").write_text("COMMON = ('common',)\n\ndef main(arguments):\n    return 0\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr("trailmark_bench.executors.warm.CELL_MODULE", "idler")
    parents = WarmParents()
    yield parents
    (tmp_path / "go").touch()
    parents.close()


def is_forked(parents: WarmParents, plugin: str, folder: Path) -> bool:
    """Return whether a child of a kind is forked."""
    parent = parents.of(request_of(plugin))
    assert parent is not None
    try:
        process = ForkedProcess(parent, folder, folder, {})
    except OSError:
        return False
    assert select.select([process.stderr], [], [], 60.0)[0]
    assert process.reap().status == 0
    process.close()
    return True


def test_each_kind_is_warm_again_after_their_origin_is_killed(parents: WarmParents, tmp_path: Path) -> None:
    (tmp_path / "go").touch()
    assert is_forked(parents, "kalman", tmp_path)
    first = parents.of(request_of("kalman"))
    assert first is not None
    both = [os.pidfd_open(process._pid) for process in (first, parents._origins[1])]
    os.kill(parents._origins[1]._pid, signal.SIGKILL)
    for ended in both:
        assert select.select([ended], [], [], 60.0)[0]
        os.close(ended)

    told = {kind: [is_forked(parents, kind, tmp_path) for _ in range(3)] for kind in ("kalman", "smoother")}

    assert told == {"kalman": [False, True, True], "smoother": [True, True, True]}


def test_a_kind_that_is_lost_again_and_again_is_begun_no_more(
    parents: WarmParents, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "idler.py").write_text("import os\n\nos._exit(1)\n")
    begun: list[WarmParent] = []
    start = WarmParent._start

    def count_and_start(self: WarmParent) -> Any:
        begun.append(self)
        return start(self)

    monkeypatch.setattr(WarmParent, "_start", count_and_start)

    told = [is_forked(parents, "kalman", tmp_path) for _ in range(12)]

    assert not any(told)
    assert len(begun) == 12  # six of the kind, each with an origin; without a bound, 24


def test_no_kind_waits_until_another_has_imported(parents: WarmParents, tmp_path: Path) -> None:
    """Which process forks a cell is said while one for the cell of another thread is being made ready."""
    with ThreadPoolExecutor(2) as threads:
        one = threads.submit(is_forked, parents, "kalman", tmp_path)
        wait_for((tmp_path / "began").exists)
        try:
            found = [threads.submit(parents.of, request_of(kind)) for kind in ("kalman", "smoother")]
            assert [each.result(20.0) is not None for each in found] == [True, True]
        finally:
            (tmp_path / "go").touch()
        assert one.result(60.0)


def wait_for(condition: Callable[[], bool]) -> None:
    until_s = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < until_s
        time.sleep(0.02)
