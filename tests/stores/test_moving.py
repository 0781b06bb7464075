"""Loops are closed: path and keyframes are put elsewhere, all of them or none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trailmark.errors import StoreError
from trailmark.geometry import Pose2
from trailmark.paths import Keyframe
from trailmark.stores.check import check_store

from .conftest import opened, waypoint

ARRAYS = {"points": np.arange(6.0).reshape(3, 2)}


def keyframe(k: int, shift: float = 0.0) -> Keyframe:
    return Keyframe(0.05 * k, float(k), Pose2(0.05 * k + shift, shift, 0.1), ARRAYS)


@pytest.fixture
def place(tmp_path: Path) -> Path:
    path = tmp_path / "a.trail"
    with opened(path, "create") as store:
        for k in range(4):
            store.localizer_map("laser").add(keyframe(k))
            store.append(waypoint(k))
        store.mark_finished("laser")
        store.commit()
    return path


def shifted(count: int = 4) -> tuple[list[Pose2], dict[str, list[Keyframe]]]:
    return [Pose2(k, 1.0, 0.5) for k in range(count)], {"laser": [keyframe(k, 2.0) for k in range(4)]}


def test_path_and_keyframes_lie_elsewhere_and_the_store_is_sound(place: Path) -> None:
    with opened(place, "append") as store:
        assert store.move(*shifted())
        assert not store.is_finished("laser")  # what was made of its keyframes is out of date
        store.commit()
    assert check_store(place).is_sound
    with opened(place) as store:
        path = store.path()
        assert path is not None
        assert [one.pose_map_base for one in path.waypoints] == shifted()[0]
        assert list(path.stations) == pytest.approx([0.0, 0.05, 0.1, 0.15])
        found = store.localizer_map("laser").keyframes()
        assert [one.pose_map_base for one in found] == [one.pose_map_base for one in shifted()[1]["laser"]]
        assert [one.stamp_s for one in found] == [0.0, 1.0, 2.0, 3.0]
        np.testing.assert_array_equal(found[2].arrays["points"], ARRAYS["points"])


def test_what_is_not_committed_has_not_happened(place: Path) -> None:
    with opened(place, "append") as store:
        store.move(*shifted())
    assert check_store(place).is_sound
    with opened(place) as store:
        path = store.path()
        assert path is not None
        assert [one.pose_map_base for one in path.waypoints] == [waypoint(k).pose_map_base for k in range(4)]
        assert [one.pose_map_base for one in store.localizer_map("laser").keyframes()] == [
            keyframe(k).pose_map_base for k in range(4)
        ]
        assert store.is_finished("laser")


@pytest.mark.parametrize("wrong", ["waypoints", "keyframes"])
def test_a_count_that_does_not_fit_changes_nothing(place: Path, wrong: str) -> None:
    waypoints, keyframes = shifted(3 if wrong == "waypoints" else 4)
    if wrong == "keyframes":
        keyframes["laser"].pop()
    with opened(place, "append") as store:
        with pytest.raises(StoreError, match=r"3 (poses for 4 waypoints|keyframes in place of 4)"):
            store.move(waypoints, keyframes)
        path = store.path()
        assert path is not None
        assert path[2].pose_map_base == waypoint(2).pose_map_base
