"""Loops are closed when teaching ends: the path and all that remember it move together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.estimates import Belief, Fix
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session
from trailmark.paths import Keyframe, Waypoint
from trailmark.pipeline.lifecycle import Sessions
from trailmark.pipeline.localizers.runner import LocalizerFailedError
from trailmark.pipeline.teaching.closing import close_loops
from trailmark.pipeline.teaching.taught_map import open_taught_map
from trailmark.pipeline.teaching.way_log import WAY_LOG
from trailmark.stores import SqlitePathStore, SqliteStoreConfig

#: Places of one round and a third: enough to see that loops are closed, in a third of the time of two rounds.
N_SHORT = 84


def ahead(pose: Pose2) -> dict[str, Floats]:
    """Return a landmark a metre ahead, in map axes."""
    point = pose @ Pose2(1.0)
    return {"point": np.array([point.x, point.y])}


class SeesAhead(Localizer):
    """Keeps a landmark a metre ahead of every place."""

    def __init__(self) -> None:
        super().__init__(None)

    def observe(self, frame: Any, belief: Belief) -> Sequence[Any]:
        return ()

    def moved(self, keyframe: Keyframe, pose_map_base: Pose2) -> Keyframe:
        return replace(keyframe, pose_map_base=pose_map_base, arrays=ahead(pose_map_base))


def taught(path: Path, nodes: Sequence[Keyframe]) -> None:
    """Keep what a teaching leaves that has not finished."""
    store = SqlitePathStore(SqliteStoreConfig(path=str(path), access="create"))
    store.start(Session())
    for k, node in enumerate(nodes):
        store.localizer_map(WAY_LOG).add(node)
        store.localizer_map("laser").add(Keyframe(node.station_m, node.stamp_s, node.pose_map_base, {}))
        store.localizer_map("stranger").add(
            Keyframe(node.station_m, node.stamp_s, node.pose_map_base, ahead(node.pose_map_base))
        )
        store.append(Waypoint(k, node.station_m, node.pose_map_base))
    store.commit()
    store.close()


def closed(path: Path, localizer: Localizer, with_stranger: bool = True) -> tuple[int, list[list[Pose2]]]:
    """Close the loops of a store; return how many, and where waypoints and keyframes lie."""
    store = SqlitePathStore(SqliteStoreConfig(path=str(path), access="append"))
    store.start(Session())
    try:
        part: Any = SimpleNamespace(name="laser", localizer=localizer)
        stranger: Any = SimpleNamespace(name="stranger", localizer=SeesAhead())
        count = close_loops(store, [part], [stranger] if with_stranger else [])
        way = store.path()
        assert way is not None
        rows = [[one.pose_map_base for one in way.waypoints]]
        rows += [[one.pose_map_base for one in store.localizer_map(who).keyframes()] for who in ("laser", "stranger")]
        return count, rows
    finally:
        store.close()


def test_path_and_all_maps_move_together_once(rounds: Any, tmp_path: Path) -> None:
    nodes = rounds.log()
    taught(tmp_path / "a.trail", nodes)
    count, (waypoints, own, others) = closed(tmp_path / "a.trail", rounds.relating(nodes))
    assert count > 30
    assert rounds.worst(waypoints) < 0.35
    assert own == others
    assert max(a.distance_to(b) for a, b in zip(waypoints, own, strict=True)) < 1e-6
    again, rows = closed(tmp_path / "a.trail", rounds.relating(nodes))
    assert again == 0
    assert rows[0] == waypoints


def test_while_who_remembers_the_path_is_not_in_the_run_it_is_left(
    rounds: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    nodes = rounds.log(N_SHORT)
    taught(tmp_path / "a.trail", nodes)
    count, rows = closed(tmp_path / "a.trail", rounds.relating(nodes), with_stranger=False)
    assert count == 0
    assert rows == [[node.pose_map_base for node in nodes]] * 3
    assert "stranger remembers it too, is not in this run" in caplog.text
    assert closed(tmp_path / "a.trail", rounds.relating(nodes))[0] > 10  # later, with it


def test_what_is_held_in_map_axes_moves_though_its_localizer_is_switched_off(rounds: Any, tmp_path: Path) -> None:
    nodes = rounds.log(N_SHORT)
    taught(tmp_path / "a.trail", nodes)
    assert closed(tmp_path / "a.trail", rounds.relating(nodes))[0] > 10
    store = SqlitePathStore(SqliteStoreConfig(path=str(tmp_path / "a.trail"), access="read"))
    store.start(Session())
    for one in store.localizer_map("stranger").keyframes():
        np.testing.assert_allclose(one.arrays["point"], ahead(one.pose_map_base)["point"], atol=1e-9)
    store.close()


def replayed(path: Path, localizers: Mapping[str, Localizer]) -> list[Pose2]:
    """Return the path that a replay follows after it has finished what a teaching left."""

    def opened(access: str, base_dir: object) -> SqlitePathStore:
        return SqlitePathStore(SqliteStoreConfig(path=str(path), access=access))

    settings = SimpleNamespace(mode="replay", seed=0)
    run: Any = SimpleNamespace(
        path_store=SimpleNamespace(open=opened), settings=settings, base_dir=path.parent, access=None
    )
    starter: Any = SimpleNamespace(start=lambda kind, part, session: part.start(session))
    taught_map = open_taught_map(run, starter)
    assert taught_map is not None
    parts: Any = [SimpleNamespace(name=name, localizer=localizer) for name, localizer in localizers.items()]
    taught_map.finish_leftovers(parts, Sessions("replay", 0))
    assert taught_map.path is not None
    return [one.pose_map_base for one in taught_map.path.waypoints]


@pytest.mark.parametrize("is_finished", [False, True])
def test_loops_that_were_left_open_are_closed_by_a_replay_with_all_who_remember(
    rounds: Any, tmp_path: Path, is_finished: bool
) -> None:
    nodes, path = rounds.log(N_SHORT), tmp_path / "a.trail"
    taught(path, nodes)
    store = SqlitePathStore(SqliteStoreConfig(path=str(path), access="append"))
    store.start(Session())
    for owner in ("laser", "stranger") if is_finished else ():
        store.mark_finished(owner)
    store.commit()
    store.close()
    laser = rounds.relating(nodes)
    assert replayed(path, {"laser": laser}) == [node.pose_map_base for node in nodes]
    assert (laser.asked == 0) == is_finished
    assert rounds.worst([node.pose_map_base for node in nodes]) > 0.5
    straight = replayed(path, {"odometry": SeesAhead(), "laser": rounds.relating(nodes), "stranger": SeesAhead()})
    assert rounds.worst(straight) < 0.35
    assert replayed(path, {"laser": rounds.relating(nodes)}) == straight


def test_in_a_store_that_cannot_move_loops_stay_open_and_none_is_counted(
    rounds: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    nodes = rounds.log(N_SHORT)
    taught(tmp_path / "a.trail", nodes)
    monkeypatch.setattr(SqlitePathStore, "move", lambda store, waypoints, keyframes: False)
    count, (waypoints, _, _) = closed(tmp_path / "a.trail", rounds.relating(nodes))
    assert count == 0
    assert waypoints == [node.pose_map_base for node in nodes]
    assert "its loops stay open" in caplog.text


def test_a_path_that_was_taught_in_two_goes_is_straightened_like_in_one(rounds: Any, tmp_path: Path) -> None:
    nodes = rounds.log(N_SHORT)
    taught(tmp_path / "one.trail", nodes)
    taught(tmp_path / "two.trail", rounds.in_two_goes(nodes))
    count, (in_one, _, _) = closed(tmp_path / "one.trail", rounds.relating(nodes, by_number=True))
    again, (waypoints, own, others) = closed(tmp_path / "two.trail", rounds.relating(nodes, by_number=True))
    assert count == again > 10
    assert max(a.distance_to(b) for a, b in zip(in_one, waypoints, strict=True)) < 1e-6
    assert own == others
    assert max(a.distance_to(b) for a, b in zip(waypoints, own, strict=True)) < 1e-6


def test_what_fixes_have_held_is_left(rounds: Any, tmp_path: Path) -> None:
    nodes = rounds.log(fix_age_m=3.0)
    taught(tmp_path / "a.trail", nodes)
    count, (waypoints, _, _) = closed(tmp_path / "a.trail", rounds.relating(nodes))
    assert count == 0
    assert waypoints == [node.pose_map_base for node in nodes]


def test_a_localizer_that_fails_leaves_the_path_to_be_straightened_later(rounds: Any, tmp_path: Path) -> None:
    nodes = rounds.log(N_SHORT)
    taught(tmp_path / "a.trail", nodes)

    def fail(pose: Pose2, n: int) -> Fix:
        raise ValueError("broken")

    with pytest.raises(LocalizerFailedError, match=r"localizer 'laser'.*relate.*broken"):
        closed(tmp_path / "a.trail", rounds.relating(nodes, fail))
    assert closed(tmp_path / "a.trail", rounds.relating(nodes))[0] > 10
