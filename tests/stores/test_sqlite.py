"""The path store: what goes in comes out, in each way of opening it."""

from __future__ import annotations

import math
import os
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from trailmark.errors import ShapeError, StoreError
from trailmark.frames.array_documents import ARRAY_DTYPES
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.paths import Keyframe, Waypoint
from trailmark.stores import SqlitePathStore, SqliteStoreConfig

finite = st.floats(allow_nan=False, allow_infinity=False)
poses = st.builds(Pose2, finite, finite, st.floats(-math.pi, math.pi, exclude_max=True))
arrays = st.dictionaries(
    st.sampled_from(["patch", "bearing_rad", "Größe", "a b", "../x"]),
    st.sampled_from(list(ARRAY_DTYPES)).flatmap(
        lambda name: hnp.arrays(np.dtype(name), hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4))
    ),
    max_size=3,
)
keyframes = st.builds(Keyframe, finite, finite, poses, arrays)


@settings(max_examples=25, deadline=None)
@given(
    steps=st.lists(st.tuples(st.floats(1e-3, 1e3), poses), min_size=1, max_size=6),
    remembered=st.lists(keyframes, max_size=4),
    saved=arrays,
)
def test_a_place_comes_back_as_it_was_taught(
    place: SimpleNamespace, steps: list[tuple[float, Pose2]], remembered: list[Keyframe], saved: dict[str, np.ndarray]
) -> None:
    stations = np.cumsum([step for step, _ in steps])
    waypoints = tuple(Waypoint(i, float(stations[i]), pose) for i, (_, pose) in enumerate(steps))

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "place.trail"
        with place.opened(path, "create") as store:
            drawer = store.localizer_map("floor")
            for keyframe in remembered:
                drawer.add(keyframe)
            drawer.save("map", saved)
            for waypoint in waypoints:
                store.append(waypoint)
            store.commit()
        with place.opened(path) as store:
            assert store.path().waypoints == waypoints
            back, loaded = store.localizer_map("floor").keyframes(), store.localizer_map("floor").load("map")

    assert len(back) == len(remembered)
    for found, given_ in zip(back, remembered, strict=True):
        assert (found.station_m, found.stamp_s, found.pose_map_base) == (
            given_.station_m,
            given_.stamp_s,
            given_.pose_map_base,
        )
        assert_same_arrays(found.arrays, given_.arrays)
    assert_same_arrays(loaded, saved)


def assert_same_arrays(left: object, right: object) -> None:
    assert list(left) == list(right)
    for name in right:
        assert (left[name].dtype, left[name].shape) == (right[name].dtype, right[name].shape)
        assert left[name].tobytes() == right[name].tobytes()


def test_sensors_and_provenance_are_kept(taught: Path, place: SimpleNamespace) -> None:
    with place.opened(taught) as store:
        assert repr(store.sensors()) == repr(place.SENSORS)
        assert store.meta() == place.META


def test_a_store_is_one_file_once_it_is_closed(taught: Path) -> None:
    assert os.listdir(taught.parent) == ["place.trail"]


def test_a_keyframe_of_a_ground_patch_takes_at_most_2300_bytes(tmp_path: Path, place: SimpleNamespace) -> None:
    path = tmp_path / "place.trail"
    with place.opened(path, "create") as store:
        place.teach(store, 500)  # a waypoint beside each keyframe is counted in

    assert path.stat().st_size / 500 <= 2300


def test_an_empty_store_has_no_path(tmp_path: Path, place: SimpleNamespace) -> None:
    with place.opened(tmp_path / "a.trail", "create") as store:
        store.commit()
    with place.opened(tmp_path / "a.trail") as store:
        assert store.path() is None
        assert store.owners() == ()
        assert store.localizer_map("floor").keyframes() == ()
        assert store.localizer_map("floor").load("map") is None
        assert store.sensors() == {}
        assert store.meta() == {}


def test_only_committed_waypoints_are_the_path(tmp_path: Path, place: SimpleNamespace) -> None:
    with place.opened(tmp_path / "a.trail", "create") as store:
        store.append(place.waypoint(0))
        assert store.path() is None
        store.commit()
        store.append(place.waypoint(1))
        assert len(store.path()) == 1


def test_a_localizer_sees_at_once_what_it_added(tmp_path: Path, place: SimpleNamespace) -> None:
    with place.opened(tmp_path / "a.trail", "create") as store:
        drawer = store.localizer_map("floor")
        drawer.add(place.keyframe(0))
        drawer.save("map", {"points": np.zeros(3)})

        assert len(drawer.keyframes()) == 1
        assert drawer.load("map") is not None


def test_what_was_not_committed_is_forgotten(taught: Path, place: SimpleNamespace) -> None:
    before = place.contents(taught)
    with place.opened(taught, "append") as store:
        store.append(place.waypoint(12))
        store.localizer_map("floor").add(place.keyframe(12))

    assert place.contents(taught) == before


def test_drawers_do_not_see_each_other(tmp_path: Path, place: SimpleNamespace) -> None:
    with place.opened(tmp_path / "a.trail", "create") as store:
        for number in range(4):
            store.localizer_map("even" if number % 2 == 0 else "odd").add(place.keyframe(number))
        store.localizer_map("even").save("map", {"points": np.zeros(1)})

        stamps = [keyframe.stamp_s for keyframe in store.localizer_map("odd").keyframes()]
        assert stamps == [place.keyframe(1).stamp_s, place.keyframe(3).stamp_s]
        assert store.localizer_map("odd").load("map") is None


def test_saving_again_replaces_what_stood_there(tmp_path: Path, place: SimpleNamespace) -> None:
    with place.opened(tmp_path / "a.trail", "create") as store:
        drawer = store.localizer_map("laser")
        for value in (1.0, 2.0):
            drawer.save("map", {"points": np.array([value])})

        assert drawer.load("map")["points"].tolist() == [2.0]


class TestFinish:
    def test_a_drawer_that_nobody_used_needs_no_finish(self, taught: Path, place: SimpleNamespace) -> None:
        with place.opened(taught) as store:
            assert store.is_finished("unknown")

    def test_a_drawer_is_unfinished_until_it_is_marked(self, taught: Path, place: SimpleNamespace) -> None:
        with place.opened(taught, "append") as store:
            assert not store.is_finished("floor")
            store.mark_finished("floor")
            store.commit()
        with place.opened(taught) as store:
            assert store.is_finished("floor")

    @pytest.mark.parametrize("change", ["add", "save"])
    def test_a_drawer_that_changes_is_unfinished_again(self, taught: Path, place: SimpleNamespace, change: str) -> None:
        with place.opened(taught, "append") as store:
            assert store.is_finished("laser")
            if change == "add":
                store.localizer_map("laser").add(place.keyframe(0))
            else:
                store.localizer_map("laser").save("map", {})
            assert not store.is_finished("laser")


class TestAccess:
    def test_reading_refuses_to_write(self, taught: Path, place: SimpleNamespace) -> None:
        with place.opened(taught) as store:
            for write in (
                lambda: store.append(place.waypoint(12)),
                lambda: store.localizer_map("floor").add(place.keyframe(0)),
                lambda: store.localizer_map("floor").save("map", {}),
                lambda: store.mark_finished("floor"),
                lambda: store.set_meta({}),
                store.commit,
            ):
                with pytest.raises(StoreError, match="open for reading only"):
                    write()

    def test_creating_refuses_an_existing_file(self, taught: Path, place: SimpleNamespace) -> None:
        with (
            pytest.raises(StoreError, match=r"exists already; .*--append.*--overwrite"),
            place.opened(taught, "create"),
        ):
            pass

    def test_appending_goes_on_where_teaching_ended(self, taught: Path, place: SimpleNamespace) -> None:
        with place.opened(taught, "append") as store:
            place.teach(store, 3, start=12)
        with place.opened(taught) as store:
            assert store.path().waypoints == tuple(place.waypoint(i) for i in range(15))
            assert len(store.localizer_map("floor").keyframes()) == 15

    @pytest.mark.parametrize("access", ["read", "append"])
    def test_a_missing_file_is_named_with_the_way_to_make_it(
        self, tmp_path: Path, place: SimpleNamespace, access: str
    ) -> None:
        with (
            pytest.raises(StoreError, match=r"no path store at .*a\.trail; 'trailmark teach"),
            place.opened(tmp_path / "a.trail", access),
        ):
            pass
        assert os.listdir(tmp_path) == []

    def test_a_missing_folder_is_named(self, tmp_path: Path, place: SimpleNamespace) -> None:
        path = tmp_path / "nowhere" / "a.trail"
        with pytest.raises(StoreError, match=r"no folder .*nowhere"), place.opened(path, "create"):
            pass

    def test_a_folder_is_no_store(self, tmp_path: Path, place: SimpleNamespace) -> None:
        with pytest.raises(StoreError, match="is not a file"), place.opened(tmp_path):
            pass

    def test_no_name_is_no_store(self) -> None:
        with pytest.raises(StoreError, match="no path store is named; give one with --store"):
            SqlitePathStore(SqliteStoreConfig()).start(Session())

    def test_names_may_hold_what_urls_may_not(self, tmp_path: Path, place: SimpleNamespace) -> None:
        path = tmp_path / "a?mode=ro#%20 ü.trail"
        with place.opened(path, "create") as store:
            place.teach(store, 2)
        with place.opened(path) as store:
            assert len(store.path()) == 2
        assert os.listdir(tmp_path) == [path.name]

    def test_a_link_to_a_store_stays_a_link(self, taught: Path, place: SimpleNamespace) -> None:
        link = taught.parent / "link.trail"
        link.symlink_to(taught)
        with place.opened(link, "overwrite") as store:
            place.teach(store, 1)

        assert link.is_symlink()
        with place.opened(taught) as store:
            assert len(store.path()) == 1


class TestOverwrite:
    def test_the_old_store_stands_until_the_first_waypoint_is_committed(
        self, taught: Path, place: SimpleNamespace
    ) -> None:
        before = place.contents(taught)
        with place.opened(taught, "overwrite") as store:
            store.set_meta({"new": True})
            store.localizer_map("new").add(place.keyframe(0))
            store.commit()
            assert place.contents(taught) == before
            store.append(place.waypoint(0))
            assert place.contents(taught) == before
            store.commit()
            with place.opened(taught) as reader:
                assert (len(reader.path()), reader.owners(), reader.meta()) == (1, ("new",), {"new": True})
            place.teach(store, 2, start=1)
        with place.opened(taught) as store:
            assert len(store.path()) == 3
        assert os.listdir(taught.parent) == [taught.name]

    def test_a_teaching_without_a_waypoint_leaves_the_old_store(self, taught: Path, place: SimpleNamespace) -> None:
        before = place.contents(taught)
        with place.opened(taught, "overwrite") as store:
            store.localizer_map("floor").add(place.keyframe(0))
            store.commit()

        assert place.contents(taught) == before
        assert os.listdir(taught.parent) == [taught.name]

    def test_where_nothing_stands_it_creates(self, tmp_path: Path, place: SimpleNamespace) -> None:
        (tmp_path / "empty.trail").touch()
        for name in ("new.trail", "empty.trail"):
            with place.opened(tmp_path / name, "overwrite") as store:
                place.teach(store, 2)
            with place.opened(tmp_path / name) as store:
                assert len(store.path()) == 2

    def test_a_file_that_is_no_store_is_not_touched(self, tmp_path: Path, place: SimpleNamespace) -> None:
        path = tmp_path / "notes.txt"
        path.write_text("dear diary" * 200)
        with pytest.raises(StoreError, match="is not a path store, so it is not"), place.opened(path, "overwrite"):
            pass
        assert path.read_text() == "dear diary" * 200
        assert os.listdir(tmp_path) == ["notes.txt"]

    def test_a_damaged_store_can_be_replaced(self, taught: Path, place: SimpleNamespace) -> None:
        taught.write_bytes(taught.read_bytes()[:5000])
        with place.opened(taught, "overwrite") as store:
            place.teach(store, 2)
        with place.opened(taught) as store:
            assert len(store.path()) == 2

    def test_a_file_that_turned_up_meanwhile_is_not_replaced(self, tmp_path: Path, place: SimpleNamespace) -> None:
        path = tmp_path / "a.trail"
        with place.opened(path, "create") as store:
            store.append(place.waypoint(0))
            path.write_text("mine")
            with pytest.raises(StoreError, match="made by somebody else meanwhile"):
                store.commit()
        assert path.read_text() == "mine"


class TestRefusals:
    @pytest.mark.parametrize(
        ("index", "station_m", "message"),
        [
            (0, 9.0, "waypoint 0 does not follow: the store has 12"),
            (13, 9.0, "waypoint 13 does not follow"),
            (12, 0.55, r"waypoint 12 at 0.55 m does not lie after"),
        ],
    )
    def test_a_waypoint_that_does_not_follow(
        self, taught: Path, place: SimpleNamespace, index: int, station_m: float, message: str
    ) -> None:
        with place.opened(taught, "append") as store:
            with pytest.raises(StoreError, match=message):
                store.append(Waypoint(index, station_m, Pose2()))
            store.append(place.waypoint(12))  # a refusal costs nothing but itself
            store.commit()
            assert len(store.path()) == 13

    def test_numbers_that_are_not_finite(self, taught: Path, place: SimpleNamespace) -> None:
        with place.opened(taught, "append") as store:
            for keyframe in (Keyframe(math.nan, 0.0, Pose2(), {}), Keyframe(0.0, math.inf, Pose2(), {})):
                with pytest.raises(ShapeError, match="is not finite"):
                    store.localizer_map("floor").add(keyframe)
            with pytest.raises(ShapeError, match="is not finite"):
                store.append(Waypoint(12, math.inf, Pose2()))

    def test_a_refused_keyframe_leaves_no_trace(self, tmp_path: Path, place: SimpleNamespace) -> None:
        with place.opened(tmp_path / "a.trail", "create") as store:
            with pytest.raises(ShapeError):
                store.localizer_map("floor").add(Keyframe(0.0, math.nan, Pose2(), {}))
            assert store.owners() == ()

    def test_names_of_drawers_are_text(self, taught: Path, place: SimpleNamespace) -> None:
        with place.opened(taught) as store, pytest.raises(ShapeError, match="a localizer map cannot be named"):
            store.localizer_map("a\nb")

    @pytest.mark.parametrize("meta", [{"a": object()}, {"a": math.nan}])
    def test_provenance_is_json(self, taught: Path, place: SimpleNamespace, meta: dict[str, object]) -> None:
        with place.opened(taught, "append") as store, pytest.raises(StoreError, match="meta of a path store must be"):
            store.set_meta(meta)


class TestLife:
    def test_a_store_that_was_not_started_says_so(self, tmp_path: Path) -> None:
        store = SqlitePathStore(SqliteStoreConfig(path=str(tmp_path / "a.trail")))
        store.close()
        with pytest.raises(StoreError, match="start it first"):
            store.path()

    def test_closing_twice_is_closing_once(self, taught: Path, place: SimpleNamespace) -> None:
        with place.opened(taught, "append") as store:
            drawer = store.localizer_map("floor")
            store.close()
            store.close()
            with pytest.raises(StoreError, match="is closed"):
                drawer.keyframes()

    def test_started_again_it_is_as_new(self, taught: Path, place: SimpleNamespace) -> None:
        with place.opened(taught, "append") as store:
            store.append(place.waypoint(12))
            store.start(Session())
            assert len(store.path()) == 12
            store.append(place.waypoint(12))
            store.commit()
            assert len(store.path()) == 13
