"""The contract of path stores."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from trailmark.config import PluginConfig
from trailmark.errors import StoreError
from trailmark.frames import SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Access, PathStore, Session
from trailmark.paths import Keyframe, Waypoint
from trailmark.testing.checks.configs import common_checks
from trailmark.testing.checks.parametrize import Check, parametrize

if TYPE_CHECKING:
    import pytest

__all__ = ["Access", "parametrize_with_store_checks", "store_checks"]


_FOREIGN = b"GIF89a this is no path store at all" * 40


def parametrize_with_store_checks(
    store: type[PathStore],
    *,
    config: Callable[[FilePath, Access], PluginConfig],
    expected_failures: Mapping[str, str] | None = None,
) -> pytest.MarkDecorator:
    """Parametrize a test over the contract of path stores; the test takes ``check`` and calls it.

    Parameters
    ----------
    store : type
        The class.
    config : callable
        Returns its config for a file and how it is to be opened.
    expected_failures : mapping of str to str
        Checks that it is known not to pass, by name, and why.
    """
    return parametrize(store_checks(store, config), expected_failures)


def store_checks(store: type[PathStore], config: Callable[[FilePath, Access], PluginConfig]) -> dict[str, Check]:
    """Return the checks by name; arguments as of `parametrize_with_store_checks`."""
    some = config(FilePath("place.trail"), "read")

    def on_disk(check: Callable[[_StorePlace], None]) -> Check:
        def run() -> None:
            with TemporaryDirectory() as folder:
                check(_StorePlace(store, config, FilePath(folder) / "place.trail"))

        return run

    return common_checks(lambda: store(some), lambda: some) | {
        name: on_disk(check)
        for name, check in {
            "a_path_comes_back": _path_comes_back,
            "a_new_store_has_no_path": _has_no_path,
            "what_is_not_committed_is_forgotten": _forgets,
            "waypoints_follow_each_other": _follow,
            "arrays_come_back_as_they_were": _arrays_come_back,
            "localizer maps_are_apart": _are_apart,
            "a_map_works_in_any_thread": _works_in_a_thread,
            "reading_changes_nothing": _reads_only,
            "sensors_come_back": _sensors_come_back,
            "finishing_is_written_down": _finishes,
            "a_missing_file_is_said": _says_missing,
            "a_foreign_file_is_refused": _refuses_foreign,
            "a_cut_file_is_refused_or_opens": _survives_a_cut,
        }.items()
    }


class _StorePlace:
    """A place on disk, and stores opened on it."""

    def __init__(
        self, store: type[PathStore], config: Callable[[FilePath, Access], PluginConfig], file: FilePath
    ) -> None:
        self._store, self._config, self.file = store, config, file

    @contextmanager
    def open_store(self, access: Access) -> Iterator[PathStore]:
        store = self._store(self._config(self.file, access))
        store.start(Session("path_store"))
        try:
            yield store
        finally:
            store.close()

    def teach_waypoints(self, n_waypoints: int = 5) -> None:
        """Teach a straight path with a keyframe beside each waypoint."""
        with self.open_store("create") as store:
            for index in range(n_waypoints):
                store.localizer_map("floor").add(_keyframe(index))
                store.append(_waypoint(index))
            store.commit()


def _waypoint(index: int) -> Waypoint:
    return Waypoint(index, 0.05 * index, Pose2(0.05 * index, 0.1, 0.2))


def _keyframe(index: int) -> Keyframe:
    return Keyframe(0.05 * index, float(index), Pose2(0.05 * index, 0.1, 0.2), {"patch": np.full((4, 4), index, "u1")})


def _path_comes_back(place: _StorePlace) -> None:
    place.teach_waypoints()
    with place.open_store("read") as store:
        path = store.path()
    assert path is not None, "the path is gone"
    assert [path[index] for index in range(len(path))] == [_waypoint(index) for index in range(5)]


def _has_no_path(place: _StorePlace) -> None:
    with place.open_store("create") as store:
        assert store.path() is None, "a new store has a path"


def _forgets(place: _StorePlace) -> None:
    place.teach_waypoints(3)
    with place.open_store("append") as store:
        store.localizer_map("floor").add(_keyframe(3))
        store.append(_waypoint(3))
    with place.open_store("read") as store:
        path, keyframes = store.path(), store.localizer_map("floor").keyframes()
    assert path is not None
    assert len(path) == 3, f"{len(path)} waypoints: one was not committed"
    assert len(keyframes) == 3, f"{len(keyframes)} keyframes: one was not committed"


def _follow(place: _StorePlace) -> None:
    with place.open_store("create") as store:
        store.append(_waypoint(0))
        for wrong in (_waypoint(0), _waypoint(2), Waypoint(1, -1.0, Pose2())):
            _check_refused(lambda wrong=wrong: store.append(wrong), f"{wrong} after waypoint 0")  # type: ignore[misc]


def _arrays_come_back(place: _StorePlace) -> None:
    rng = np.random.default_rng(0)
    kinds = ("u1", "u2", "i4", "i8", "f4", "f8", "?")
    arrays = {f"a_{kind.strip('?')}": rng.integers(0, 2, (3, 5)).astype(kind) for kind in kinds}
    arrays |= {"scalar": np.array(1.5), "empty": np.zeros((0, 7), "f4"), "odd": rng.random((4, 6))[::2, ::-1]}
    arrays["special"] = np.array([np.nan, np.inf, -0.0, 5e-324])
    with place.open_store("create") as store:
        localizer_map = store.localizer_map("floor")
        localizer_map.add(Keyframe(0.0, 0.0, Pose2(), arrays))
        localizer_map.save("model", arrays)
        store.append(_waypoint(0))
        store.commit()
    with place.open_store("read") as store:
        localizer_map = store.localizer_map("floor")
        saved = localizer_map.load("model")
        assert localizer_map.load("other") is None, "a name that was never saved gives something"
        for what, found in (("keyframe", localizer_map.keyframes()[0].arrays), ("saved", saved)):
            assert found is not None
            assert set(found) == set(arrays), f"{what}: {set(arrays) ^ set(found)}"
            for name, array in arrays.items():
                same = found[name].dtype == array.dtype and found[name].shape == array.shape
                assert same, (
                    f"{what} {name!r}: {array.dtype} {array.shape} became {found[name].dtype} {found[name].shape}"
                )
                assert np.ascontiguousarray(found[name]).tobytes() == array.tobytes(), (
                    f"{what} {name!r} has other numbers"
                )


def _are_apart(place: _StorePlace) -> None:
    with place.open_store("create") as store:
        store.localizer_map("one").add(_keyframe(1))
        store.localizer_map("two").save("model", {"x": np.zeros(2)})
        store.append(_waypoint(0))
        store.commit()
    with place.open_store("read") as store:
        assert len(store.localizer_map("one").keyframes()) == 1
        assert len(store.localizer_map("two").keyframes()) == 0, "one localizer sees the keyframes of another"
        assert store.localizer_map("one").load("model") is None, "one localizer sees what another saved"


def _works_in_a_thread(place: _StorePlace) -> None:
    failures: list[BaseException] = []

    def add(localizer_map: Any, index: int) -> None:
        try:
            for _ in range(20):
                localizer_map.add(_keyframe(index))
        except BaseException as error:
            failures.append(error)

    with place.open_store("create") as store:
        localizer_map = store.localizer_map("floor")
        threads = [threading.Thread(target=add, args=(localizer_map, index)) for index in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        store.append(_waypoint(0))
        store.commit()
        assert not failures, f"adding from a thread failed: {failures[0]!r}"
        assert len(localizer_map.keyframes()) == 80, f"{len(localizer_map.keyframes())} of 80 keyframes"


def _reads_only(place: _StorePlace) -> None:
    place.teach_waypoints()
    before = place.file.read_bytes()
    with place.open_store("read") as store:
        _check_refused(lambda: store.localizer_map("floor").add(_keyframe(9)), "a keyframe into a store that is read")
        _check_refused(lambda: store.append(_waypoint(5)), "a waypoint into a store that is read")
    assert place.file.read_bytes() == before, "reading changed the file"


def _sensors_come_back(place: _StorePlace) -> None:
    sensors = {"floor": SensorInfo("floor", "image", (512, 480), 70.0)}
    with place.open_store("create") as store:
        store.set_sensors(sensors)
        store.append(_waypoint(0))
        store.commit()
    with place.open_store("read") as store:
        assert dict(store.sensors()) in (sensors, {}), f"{dict(store.sensors())} came back"


def _finishes(place: _StorePlace) -> None:
    place.teach_waypoints()
    with place.open_store("append") as store:
        store.mark_finished("floor")
        store.commit()
    with place.open_store("read") as store:
        assert store.is_finished("floor"), "it forgot that a localizer has finished"


def _says_missing(place: _StorePlace) -> None:
    _check_refused(lambda: _open_and_close(place, "read"), "a file that is not there")


def _refuses_foreign(place: _StorePlace) -> None:
    place.file.write_bytes(_FOREIGN)
    for access in ("read", "append"):
        _check_refused(lambda access=access: _open_and_close(place, access), "a file of another program")  # type: ignore[misc]
    assert place.file.read_bytes() == _FOREIGN, "it changed a file of another program"


def _survives_a_cut(place: _StorePlace) -> None:
    place.teach_waypoints(40)
    whole = place.file.read_bytes()
    for share in (0.0, 0.01, 0.3, 0.7, 0.99):
        place.file.write_bytes(whole[: int(share * len(whole))])
        try:
            with place.open_store("read") as store:
                store.path()
                store.localizer_map("floor").keyframes()
        except StoreError:
            continue


def _open_and_close(place: _StorePlace, access: Access) -> None:
    with place.open_store(access):
        pass


def _check_refused(call: Callable[[], Any], what: str) -> None:
    try:
        call()
    except StoreError as error:
        story = str(error)
    else:
        raise AssertionError(f"it takes {what}")
    assert story.strip(), f"refusing {what} it says nothing"
