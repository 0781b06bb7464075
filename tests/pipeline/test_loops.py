"""Loops are closed when teaching ends, if places are told to be the same that are."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.estimates import Belief, Fix, Lost, information_from_sigmas
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session
from trailmark.paths import Keyframe, Waypoint
from trailmark.pipeline.localizers.runner import LocalizerFailedError
from trailmark.pipeline.teaching.closing import close_loops
from trailmark.pipeline.teaching.loops import LoopSearch, RelatingLocalizer
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


def test_wrong_places_among_right_ones_bend_nothing() -> None:
    nodes = way_log()
    right = searched(nodes, Relates(nodes))
    wrong = searched(
        nodes, Relates(nodes, lambda pose, n: Fix(0.0, pose @ Pose2(0.5, -0.4, 0.2 * (n % 8 == 0)), GOOD)
                       if n % 4 == 0 else Fix(0.0, pose, GOOD))
    )  # fmt: skip
    ends = [one.at_stamp(nodes[-1].stamp_s, nodes[-1].pose_map_base) for one in (right, wrong)]
    assert ends[0].distance_to(ends[1]) < 0.15


def taught(path: Path, nodes: Sequence[Keyframe]) -> None:
    """Keep what a teaching leaves that has not finished."""
    store = SqlitePathStore(SqliteStoreConfig(path=str(path), access="create"))
    store.start(Session())
    for k, node in enumerate(nodes):
        store.localizer_map(WAY_LOG).add(node)
        store.localizer_map("laser").add(Keyframe(node.station_m, node.stamp_s, node.pose_map_base, {}))
        store.localizer_map("stranger").add(Keyframe(node.station_m, node.stamp_s, node.pose_map_base, {}))
        store.append(Waypoint(k, node.station_m, node.pose_map_base))
    store.commit()
    store.close()


def closed(path: Path, localizer: Localizer) -> tuple[int, list[list[Pose2]]]:
    """Close the loops of a store; return how many, and where waypoints and keyframes lie."""
    store = SqlitePathStore(SqliteStoreConfig(path=str(path), access="append"))
    store.start(Session())
    try:
        part: Any = SimpleNamespace(name="laser", localizer=localizer)
        count = close_loops(store, [part])
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
