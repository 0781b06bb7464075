"""Loops are closed when teaching ends, if places are told to be the same that are."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.estimates import Belief, Fix, Lost, information_from_sigmas
from trailmark.geometry import Pose2, rotate_axes
from trailmark.interfaces import Localizer, Session
from trailmark.paths import Keyframe, Waypoint
from trailmark.pipeline.lifecycle import Sessions
from trailmark.pipeline.localizers.runner import LocalizerFailedError
from trailmark.pipeline.teaching.closing import close_loops
from trailmark.pipeline.teaching.logged_way import LoggedWay
from trailmark.pipeline.teaching.loops import LoopSearch, RelatingLocalizer, _parallel
from trailmark.pipeline.teaching.taught_map import open_taught_map
from trailmark.pipeline.teaching.way_graph import Straightened
from trailmark.pipeline.teaching.way_log import WAY_LOG, WayLog
from trailmark.stores import SqlitePathStore, SqliteStoreConfig
from trailmark.testing import MemoryMap

STEP_M, N = 0.5, 126
GOOD = information_from_sigmas(0.02, 0.02, math.radians(0.3))


def two_rounds() -> list[Pose2]:
    """Return where a robot truly is that drives a circle of 5 m twice."""
    turn = STEP_M / 5.0
    return [Pose2(5.0 * math.sin(k * turn), 5.0 - 5.0 * math.cos(k * turn), k * turn) for k in range(N)]


TRUTH = two_rounds()


def way_log(drift_rad_per_m: float = math.radians(0.4), fix_age_m: float = math.inf) -> Sequence[Keyframe]:
    """Return the log of that robot, whose heading drifts."""
    log, pose, covariance = MemoryMap(), TRUTH[0], np.diag([1e-8, 1e-8, 1e-8])
    notes = WayLog(log)
    for k, true in enumerate(TRUTH):
        if k:
            step = TRUTH[k - 1].between(true)
            before, pose = pose, pose @ Pose2(1.005 * step.x, step.y, step.theta + drift_rad_per_m * STEP_M)
            dx, dy = pose.x - before.x, pose.y - before.y
            carry = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
            covariance = carry @ covariance @ carry.T + np.diag([4e-5, 4e-5, math.radians(0.4) ** 2])
        belief = Belief(0.2 * k, pose, covariance, pose_odom_base=pose, fix_age_m=fix_age_m)
        notes.note(belief, 1.0001 * STEP_M * k)
    return log.keyframes()


class Relates(Localizer):
    """Tells places that are the same: what `tell` makes of the truth."""

    relates_keyframes = True

    def __init__(self, nodes: Sequence[Keyframe], tell: Any = None) -> None:
        super().__init__(None)
        self.nodes, self.tell, self.asked = nodes, tell, 0

    def observe(self, frame: Any, belief: Belief) -> Sequence[Any]:
        return ()

    def true(self, number: int) -> Pose2:
        return TRUTH[round(self.nodes[number].stamp_s / 0.2)]

    def relate(self, known: Mapping[int, Pose2], keyframe: int, guess: Pose2, covariance: Floats) -> Fix | Lost:
        self.asked += 1
        first = min(known, key=lambda one: self.true(one).distance_to(self.true(keyframe)))
        seen = self.true(first).between(self.true(keyframe))
        if math.hypot(seen.x, seen.y) > 2.0:
            return Lost(0.0, "nothing like it")
        pose = known[first] @ seen
        return Fix(0.0, pose, GOOD) if self.tell is None else self.tell(pose, self.asked)


def searched(nodes: Sequence[Keyframe], localizer: Relates) -> Any:
    part: Any = SimpleNamespace(name="laser", localizer=localizer)
    return LoopSearch(nodes, [RelatingLocalizer(part, nodes)]).straighten()


def worst(poses: Sequence[Pose2]) -> float:
    return max(a.distance_to(b) for a, b in zip(poses, TRUTH, strict=True))


def test_a_drift_is_straightened_by_places_seen_twice() -> None:
    nodes = way_log()
    assert len(nodes) == N
    straightened = searched(nodes, Relates(nodes))
    moved = [straightened.at_stamp(node.stamp_s, node.pose_map_base) for node in nodes]
    assert worst([node.pose_map_base for node in nodes]) > 1.0
    assert worst(moved) < 0.35
    second = [moved[k].between(moved[k + 63]) for k in range(62)]  # what matters: both rounds lie on each other
    true = [TRUTH[k].between(TRUTH[k + 63]) for k in range(62)]
    assert max(a.distance_to(b) for a, b in zip(second, true, strict=True)) < 0.08
    assert straightened.at_station(0.0, Pose2()) == Pose2()


def test_without_places_seen_twice_nothing_moves() -> None:
    nodes = way_log()
    assert searched(nodes, Relates(nodes, lambda pose, n: Lost(0.0, "no"))) is None


def test_single_wrong_places_are_not_believed() -> None:
    nodes, rng = way_log(), np.random.default_rng(5)

    def somewhere(pose: Pose2, n: int) -> Fix:
        return Fix(0.0, Pose2(pose.x + rng.normal(0, 1), pose.y + rng.normal(0, 1), pose.theta + rng.normal()), GOOD)

    localizer = Relates(nodes, somewhere)
    straightened = searched(nodes, localizer)
    assert localizer.asked > 20
    assert straightened is None


@pytest.mark.parametrize("told", [1e2, 1e5, 1e6, 1e7])
@pytest.mark.parametrize("angle_deg", [30.0, 45.0, 80.0])
def test_two_that_tell_the_same_direction_tell_half_as_much_of_their_difference(told: float, angle_deg: float) -> None:
    one_way = rotate_axes(np.diag([told, 0.0, 1e6]), math.radians(angle_deg))
    other_way = rotate_axes(np.diag([0.0, told, 1e6]), math.radians(angle_deg))
    np.testing.assert_allclose(_parallel(one_way, one_way), one_way / 2.0, rtol=1e-9, atol=1e-9 * told)
    np.testing.assert_allclose(_parallel(one_way, other_way), np.diag([0.0, 0.0, 5e5]), rtol=1e-9, atol=1e-6)
    assert not _parallel(np.zeros((3, 3)), one_way).any()


def test_wrong_places_among_right_ones_bend_nothing() -> None:
    nodes = way_log()
    right = searched(nodes, Relates(nodes))
    wrong = searched(
        nodes, Relates(nodes, lambda pose, n: Fix(0.0, pose @ Pose2(0.5, -0.4, 0.2 * (n % 8 == 0)), GOOD)
                       if n % 4 == 0 else Fix(0.0, pose, GOOD))
    )  # fmt: skip
    ends = [one.at_stamp(nodes[-1].stamp_s, nodes[-1].pose_map_base) for one in (right, wrong)]
    assert ends[0].distance_to(ends[1]) < 0.15


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


def test_path_and_all_maps_move_together_once(tmp_path: Path) -> None:
    nodes = way_log()
    taught(tmp_path / "a.trail", nodes)
    count, (waypoints, own, others) = closed(tmp_path / "a.trail", Relates(nodes))
    assert count > 30
    assert worst(waypoints) < 0.35
    assert own == others
    assert max(a.distance_to(b) for a, b in zip(waypoints, own, strict=True)) < 1e-6
    again, rows = closed(tmp_path / "a.trail", Relates(nodes))
    assert again == 0
    assert rows[0] == waypoints


def test_while_who_remembers_the_path_is_not_in_the_run_it_is_left(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    nodes = way_log()
    taught(tmp_path / "a.trail", nodes)
    count, rows = closed(tmp_path / "a.trail", Relates(nodes), with_stranger=False)
    assert count == 0
    assert rows == [[node.pose_map_base for node in nodes]] * 3
    assert "stranger remembers it too, is not in this run" in caplog.text
    assert closed(tmp_path / "a.trail", Relates(nodes))[0] > 30  # later, with it


def test_what_is_held_in_map_axes_moves_though_its_localizer_is_switched_off(tmp_path: Path) -> None:
    nodes = way_log()
    taught(tmp_path / "a.trail", nodes)
    assert closed(tmp_path / "a.trail", Relates(nodes))[0] > 30
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
    tmp_path: Path, is_finished: bool
) -> None:
    nodes, path = way_log(), tmp_path / "a.trail"
    taught(path, nodes)
    store = SqlitePathStore(SqliteStoreConfig(path=str(path), access="append"))
    store.start(Session())
    for owner in ("laser", "stranger") if is_finished else ():
        store.mark_finished(owner)
    store.commit()
    store.close()
    laser = Relates(nodes)
    assert replayed(path, {"laser": laser}) == [node.pose_map_base for node in nodes]
    assert (laser.asked == 0) == is_finished
    straight = replayed(path, {"odometry": SeesAhead(), "laser": Relates(nodes), "stranger": SeesAhead()})
    assert worst(straight) < 0.35
    assert replayed(path, {"laser": Relates(nodes)}) == straight


def test_in_a_store_that_cannot_move_loops_stay_open_and_none_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    nodes = way_log()
    taught(tmp_path / "a.trail", nodes)
    monkeypatch.setattr(SqlitePathStore, "move", lambda store, waypoints, keyframes: False)
    count, (waypoints, _, _) = closed(tmp_path / "a.trail", Relates(nodes))
    assert count == 0
    assert waypoints == [node.pose_map_base for node in nodes]
    assert "its loops stay open" in caplog.text


def appended(nodes: Sequence[Keyframe], first: int = N // 2) -> list[Keyframe]:
    """Return the log of the same way taught in two goes, the stamps of the second from zero again."""
    began_s = nodes[first].stamp_s
    return [node if k < first else replace(node, stamp_s=node.stamp_s - began_s) for k, node in enumerate(nodes)]


class RelatesByNumber(Relates):
    """Knows its places whatever their stamps."""

    def true(self, number: int) -> Pose2:
        return TRUTH[number]


def test_a_path_that_was_taught_in_two_goes_is_straightened_like_in_one(tmp_path: Path) -> None:
    nodes = way_log()
    taught(tmp_path / "one.trail", nodes)
    taught(tmp_path / "two.trail", appended(nodes))
    count, (in_one, _, _) = closed(tmp_path / "one.trail", RelatesByNumber(nodes))
    again, (waypoints, own, others) = closed(tmp_path / "two.trail", RelatesByNumber(nodes))
    assert count == again > 30
    assert max(a.distance_to(b) for a, b in zip(in_one, waypoints, strict=True)) < 1e-6
    assert own == others
    assert max(a.distance_to(b) for a, b in zip(waypoints, own, strict=True)) < 1e-6


def test_a_place_seen_again_is_found_by_the_keyframe_of_its_own_teaching() -> None:
    nodes = appended(way_log())
    part: Any = SimpleNamespace(name="laser", localizer=RelatesByNumber(nodes))
    sites = RelatingLocalizer(part, nodes).sites_of(LoggedWay(nodes))
    assert {number: site[0] for number, site in sites.items()} == {number: number for number in range(N)}


def test_what_was_taught_before_there_was_a_log_moves_with_its_waypoints() -> None:
    nodes = [replace(node, station_m=node.station_m + 12.5) for node in way_log()]
    straightened = searched(nodes, RelatesByNumber(nodes))
    before = [Keyframe(0.5 * k, float(k), Pose2(0.5 * k - 12.5), {}) for k in range(25)]
    assert [straightened.at_keyframe(one) for one in before] == [one.pose_map_base for one in before]
    assert straightened.at_station(3.0, Pose2(-9.5)) == Pose2(-9.5)


def test_what_was_taught_without_a_log_between_is_not_placed_by_its_stamps() -> None:
    ends = [Keyframe(*at, Pose2(at[0]), {}) for at in ((0.0, 0.0), (0.5, 1.0), (20.0, 90.0), (20.5, 91.0))]
    moved = [Pose2(0.0), Pose2(0.5), Pose2(20.0, 1.0), Pose2(20.5, 1.0)]
    between = Keyframe(10.25, 5.0, Pose2(10.25), {})
    assert Straightened(ends, moved, 1).at_keyframe(between).y == pytest.approx(0.5)


def test_where_a_robot_stood_its_stamps_tell_how_far_it_had_turned() -> None:
    quarter = math.pi / 8
    nodes = [Keyframe(1.0, float(k), Pose2(1.0, 0.0, k * quarter), {}) for k in range(4)]
    moved = [node.pose_map_base @ Pose2(0.0, 0.0, 0.01 * k) for k, node in enumerate(nodes)]
    seen = Keyframe(1.0, 1.5, Pose2(1.0, 0.0, 1.5 * quarter), {})
    assert Straightened(nodes, moved, 1).at_keyframe(seen).theta == pytest.approx(1.5 * quarter + 0.015)


def test_what_fixes_have_held_is_left(tmp_path: Path) -> None:
    nodes = way_log(fix_age_m=3.0)
    taught(tmp_path / "a.trail", nodes)
    count, (waypoints, _, _) = closed(tmp_path / "a.trail", Relates(nodes))
    assert count == 0
    assert waypoints == [node.pose_map_base for node in nodes]


def test_a_localizer_that_fails_leaves_the_path_to_be_straightened_later(tmp_path: Path) -> None:
    nodes = way_log()
    taught(tmp_path / "a.trail", nodes)

    def fail(pose: Pose2, n: int) -> Fix:
        raise ValueError("broken")

    with pytest.raises(LocalizerFailedError, match=r"localizer 'laser'.*relate.*broken"):
        closed(tmp_path / "a.trail", Relates(nodes, fail))
    assert closed(tmp_path / "a.trail", Relates(nodes))[0] > 30
