"""One writer, many readers, many threads."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest

from trailmark.errors import StoreError
from trailmark.interfaces import LocalizerMap
from trailmark.stores.check import check_store

HERE = Path(__file__).parent

#: Takes the store, says so, and goes on when its standard input ends.
HOLDER = """
import sys
sys.path.insert(0, sys.argv[1])
from conftest import opened, teach
from pathlib import Path
with opened(Path(sys.argv[2]), sys.argv[3]) as store:
    teach(store, 3, int(sys.argv[4]))
    print("holding", flush=True)
    sys.stdin.read()
    teach(store, 3, int(sys.argv[4]) + 3)
"""


@pytest.mark.parametrize(("theirs", "access"), [("append", "overwrite"), ("overwrite", "append")])
def test_a_second_process_that_writes_is_refused(
    taught: Path, place: SimpleNamespace, theirs: str, access: str
) -> None:
    start = 12 if theirs == "append" else 0
    command = [sys.executable, "-c", HOLDER, str(HERE), str(taught), theirs, str(start)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout.readline() == "holding\n"
        with pytest.raises(StoreError, match="is being written by another process"), place.opened(taught, access):
            pass
        with place.opened(taught) as reader:  # readers are welcome
            assert len(reader.path()) == start + 3
            assert len(reader.localizer_map("floor").keyframes()) == start + 3
        holder.communicate(timeout=30)

    assert holder.returncode == 0
    with place.opened(taught) as store:
        assert len(store.path()) == start + 6
    assert os.listdir(taught.parent) == [taught.name]


@pytest.mark.parametrize("access", ["create", "append", "overwrite"])
def test_a_second_writer_in_the_same_process_is_refused(tmp_path: Path, place: SimpleNamespace, access: str) -> None:
    path = tmp_path / "a.trail"
    with place.opened(path, "create") as store:
        place.teach(store, 2)
        with pytest.raises(StoreError, match=r"is being written by another|exists already"), place.opened(path, access):
            pass
        place.teach(store, 2, start=2)  # and the first one goes on
    with place.opened(path) as store:
        assert len(store.path()) == 4


def test_a_refused_writer_can_come_back_later(tmp_path: Path, place: SimpleNamespace) -> None:
    path = tmp_path / "a.trail"
    with place.opened(path, "create") as store:
        place.teach(store, 2)
    with place.opened(path, "append") as store:
        place.teach(store, 2, start=2)
    with place.opened(path) as store:
        assert len(store.path()) == 4


def test_a_reader_sees_whole_commits_while_the_place_is_taught(tmp_path: Path, place: SimpleNamespace) -> None:
    path, n_waypoints = tmp_path / "a.trail", 150
    lengths: list[int] = []
    finished = threading.Event()

    def read() -> None:
        with place.opened(path) as reader:
            while not finished.is_set():
                taught = reader.path()
                lengths.append(len(taught))
                n_keyframes = len(reader.localizer_map("floor").keyframes())
                assert n_keyframes >= len(taught)  # each waypoint comes with its keyframe

    with place.opened(path, "create") as store:
        place.teach(store, 1)
        with ThreadPoolExecutor(1) as pool:
            reading = pool.submit(read)
            try:
                place.teach(store, n_waypoints - 1, start=1)
            finally:
                finished.set()
            reading.result(timeout=30)

    assert lengths == sorted(lengths)
    assert os.listdir(tmp_path) == ["a.trail"]


def test_any_thread_may_add_while_waypoints_are_laid(tmp_path: Path, place: SimpleNamespace) -> None:
    path, n_threads, n_each = tmp_path / "a.trail", 4, 30
    with place.opened(path, "create") as store:

        def work(worker: int) -> None:
            drawer = store.localizer_map(f"worker{worker}")
            for number in range(n_each):
                drawer.add(place.keyframe(1000 * worker + number, size=8))
                drawer.save("last", {"number": place.keyframe(number).arrays["offset"]})

        with ThreadPoolExecutor(n_threads) as pool:
            jobs = [pool.submit(work, worker) for worker in range(n_threads)]
            place.teach(store, 50)
            for job in jobs:
                job.result(timeout=30)
        store.commit()

    with place.opened(path) as store:
        assert len(store.path()) == 50
        for worker in range(n_threads):
            stamps = [keyframe.stamp_s for keyframe in store.localizer_map(f"worker{worker}").keyframes()]
            assert stamps == [place.keyframe(1000 * worker + number).stamp_s for number in range(n_each)]
    assert check_store(path).is_sound


def add_forever(drawer: LocalizerMap, place: SimpleNamespace) -> None:
    for number in itertools.count():
        drawer.add(place.keyframe(number, size=4))


def test_closing_from_another_thread_ends_the_work_with_a_clear_error(tmp_path: Path, place: SimpleNamespace) -> None:
    path = tmp_path / "a.trail"
    with place.opened(path, "create") as store:
        place.teach(store, 1)
        drawer = store.localizer_map("floor")
        closer = threading.Thread(target=store.close)
        closer.start()
        with pytest.raises(StoreError, match="is closed"):
            add_forever(drawer, place)
        closer.join()
    with place.opened(path) as store:
        assert len(store.path()) == 1


def test_a_store_is_one_file_also_when_a_reader_leaves_last(tmp_path: Path, place: SimpleNamespace) -> None:
    path = tmp_path / "a.trail"
    with place.opened(path, "create") as store:
        place.teach(store, 3)
        with place.opened(path) as reader:
            assert len(reader.path()) == 3
            store.close()
            assert len(reader.path()) == 3
        assert os.listdir(tmp_path) == ["a.trail"]
