"""Places that look alike close no loop: the way between them excludes it, or it is left open and said."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.estimates import Belief, Fix, Lost, information_from_sigmas
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session
from trailmark.paths import Keyframe, Waypoint
from trailmark.pipeline.teaching.closing import close_loops
from trailmark.pipeline.teaching.logged_way import LoggedWay
from trailmark.pipeline.teaching.loops import LoopSearch, RelatingLocalizer, _LoopCandidate
from trailmark.pipeline.teaching.matched_way import MatchedWay
from trailmark.pipeline.teaching.way_log import COVARIANCE, FIXED, WAY_LOG
from trailmark.stores import SqlitePathStore, SqliteStoreConfig

STEP_M, ROOM_M, SEEN_M = 0.5, 3.0, 3.5
GOOD = information_from_sigmas(0.02, 0.02, math.radians(0.3))


class Corridor(Localizer):
    """Sees rooms along x, each as long as the next and all alike; without a length, each looks different."""

    relates_keyframes = True

    def __init__(self, truth_x: Sequence[float], *, room_m: float | None, sees_steps: bool = True) -> None:
        super().__init__(None)
        self._truth_x, self._room_m, self._sees_steps = truth_x, room_m, sees_steps

    def observe(self, frame: Any, belief: Belief) -> Sequence[Any]:
        return ()

    def relate(self, known: Mapping[int, Pose2], keyframe: int, guess: Pose2, covariance: Floats) -> Fix | Lost:
        """Return the fit nearest to the guess, in the window, where a known place looks like the one asked about."""
        if not self._sees_steps and abs(max(known) - keyframe) < 3:
            return Lost(0.0, "dark")
        window_m, fits = 3.0 * math.sqrt(covariance[0, 0]), list[Pose2]()
        for one, pose in known.items():
            apart = self._truth_x[keyframe] - self._truth_x[one]
            seen = math.remainder(apart, self._room_m) if self._room_m else apart
            if abs(seen) < (1.0 if self._room_m else SEEN_M):
                fits.append(pose @ Pose2(seen))
        inside = [fit for fit in fits if fit.distance_to(guess) <= window_m + 0.2]
        if not inside or max(one.distance_to(inside[0]) for one in inside) > 0.4:
            return Lost(0.0, "nothing, or several")
        return Fix(0.0, min(inside, key=guess.distance_to), GOOD)


def way(believed_x: Sequence[float], sigma_m: float, gap: tuple[int, float] = (0, 0.0)) -> list[Keyframe]:
    """Return a log of a straight way, each step as uncertain but for the one to a node, which is more so."""
    stations = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(believed_x)))])
    nodes = []
    for k, (at, x) in enumerate(zip(stations.tolist(), believed_x, strict=True)):
        along = k * sigma_m**2 + gap[1] ** 2 * (k >= gap[0]) + 1e-6
        covariance = np.diag([along, 1e-4 + 1e-6 * k, 1e-6 + 1e-8 * k])
        nodes.append(Keyframe(at, float(k), Pose2(x), {COVARIANCE: covariance, FIXED: np.array(False)}))
    return nodes


def search(nodes: Sequence[Keyframe], localizer: Localizer) -> LoopSearch:
    part: Any = SimpleNamespace(name="laser", localizer=localizer)
    return LoopSearch(nodes, [RelatingLocalizer(part, nodes)])


def matched(nodes: Sequence[Keyframe], localizer: Localizer) -> MatchedWay:
    part: Any = SimpleNamespace(name="laser", localizer=localizer)
    relating = RelatingLocalizer(part, nodes)
    return MatchedWay(nodes, {k: (k, Pose2()) for k in range(len(nodes))}, relating.relate)


AHEAD = [STEP_M * k for k in range(25)]
THERE_AND_BACK = [*AHEAD, *AHEAD[-2::-1]]


def test_a_room_is_not_taken_for_the_last_one_by_an_unsure_belief() -> None:
    searched = search(way(AHEAD, 0.75), Corridor(AHEAD, room_m=ROOM_M))
    assert searched.straighten() is None
    assert searched.n_left_open >= 3


def test_the_way_between_two_rooms_excludes_that_they_are_the_same() -> None:
    ahead = AHEAD[:24]
    searched = search(way(ahead, 0.75), Corridor(ahead, room_m=6.0))  # no third room shows that they repeat
    assert searched.straighten() is None
    assert searched.n_left_open >= 3


def test_what_agrees_only_across_a_corridor_is_tested_like_the_first() -> None:
    ahead = AHEAD[:24]
    searched = search(way(ahead, 0.75), Corridor(ahead, room_m=6.0))
    spread = np.diag([2.0**2, 0.1**2, 0.02**2])
    across = np.diag([0.0, GOOD[1, 1], GOOD[2, 2]])
    searched._counted = [_LoopCandidate(2, 16, Pose2(7.0), across, spread)]
    alikes = searched._places[0].alikes

    searched._take(_LoopCandidate(3, 17, Pose2(1.0), GOOD, spread), alikes)
    assert (len(searched._graph.loops), searched.n_left_open) == (0, 1)

    surer = np.diag([0.4**2, 0.1**2, 0.02**2])
    searched._take(_LoopCandidate(4, 18, Pose2(7.0), GOOD, surer), alikes)
    assert (len(searched._graph.loops), searched.n_left_open) == (1, 1)


def test_where_rooms_differ_the_same_belief_is_straightened() -> None:
    believed = [*AHEAD, *(x + 0.04 * k for k, x in enumerate(AHEAD[-2::-1]))]
    searched = search(way(believed, 0.1), Corridor(THERE_AND_BACK, room_m=None))
    straightened = searched.straighten()
    assert straightened is not None
    assert searched.n_left_open == 0
    assert straightened.at_stamp(48.0, Pose2(believed[-1])).x == pytest.approx(0.0, abs=0.1)


def test_after_a_gap_a_room_that_looks_like_those_before_closes_nothing() -> None:
    ahead = [STEP_M * k for k in range(37)]
    truth = [*ahead[:19], *(x + 3.0 for x in ahead[19:])]  # one room was passed unrecorded, and is believed shorter
    believed = [*ahead[:19], *(x + 2.8 for x in ahead[19:])]
    searched = search(way(believed, 0.02, gap=(19, 2.0)), Corridor(truth, room_m=ROOM_M))
    assert searched.straighten() is None
    assert searched.n_left_open >= 3


def test_matched_steps_exclude_what_an_unsure_belief_allows() -> None:
    way_as_seen = matched(way(AHEAD, 0.5), Corridor(AHEAD, room_m=ROOM_M))
    as_believed = matched(way(AHEAD, 0.5), Corridor(AHEAD, room_m=ROOM_M, sees_steps=False))
    assert not way_as_seen.contradicts(2, 8, Pose2(3.0), GOOD)
    assert way_as_seen.contradicts(2, 8, Pose2(0.0), GOOD)
    assert not as_believed.contradicts(2, 8, Pose2(0.0), GOOD)


def test_a_relation_and_its_inverse_are_contradicted_alike() -> None:
    as_seen = matched(way(AHEAD, 0.5), Corridor(AHEAD, room_m=ROOM_M))
    for off_m in np.linspace(0.0, 2.0, 21).tolist():
        measured = Pose2(3.0 + off_m, 0.1, 0.02)
        there = as_seen.contradicts(2, 8, measured, GOOD)
        assert as_seen.contradicts(8, 2, measured.inverse(), information_of_inverse(measured, GOOD)) == there


def information_of_inverse(pose: Pose2, information: Floats) -> Floats:
    """Return the information of a pose's inverse, by differences."""
    at, nudge = pose.array(), 1e-6
    rows = [
        (Pose2.from_array(at + nudge * axis).inverse().array() - pose.inverse().array()) / nudge for axis in np.eye(3)
    ]
    back = np.linalg.inv(np.array(rows).T)
    return np.asarray(back.T @ information @ back)


def test_a_match_that_a_sure_belief_contradicts_makes_the_step_unsure() -> None:
    truth = [x + 0.4 * (k >= 6) for k, x in enumerate(AHEAD)]  # the belief does not know
    as_seen = matched(way(AHEAD, 0.02), Corridor(truth, room_m=None))
    assert not as_seen.contradicts(2, 8, Pose2(3.0), GOOD)
    assert not as_seen.contradicts(2, 8, Pose2(3.4), GOOD)
    assert as_seen.contradicts(2, 8, Pose2(9.0), GOOD)


def test_a_keyframe_to_which_the_belief_has_jumped_does_not_stand_for_a_node() -> None:
    nodes = way(AHEAD, 0.05)
    laid = [Keyframe(node.station_m, node.stamp_s, node.pose_map_base, {}) for node in nodes]
    laid[4] = Keyframe(laid[4].station_m, laid[4].stamp_s, Pose2(2.8), {})
    part: Any = SimpleNamespace(name="laser", localizer=None)
    assert sorted(RelatingLocalizer(part, laid).sites_of(LoggedWay(nodes))) == [k for k in range(25) if k != 4]


def test_loops_that_are_left_open_are_said(tmp_path: Any, caplog: pytest.LogCaptureFixture) -> None:
    store = SqlitePathStore(SqliteStoreConfig(path=str(tmp_path / "a.trail"), access="create"))
    store.start(Session())
    nodes = way(AHEAD, 0.75)
    for k, node in enumerate(nodes):
        store.localizer_map(WAY_LOG).add(node)
        store.localizer_map("laser").add(Keyframe(node.station_m, node.stamp_s, node.pose_map_base, {}))
        store.append(Waypoint(k, node.station_m, node.pose_map_base))
    store.commit()
    part: Any = SimpleNamespace(name="laser", localizer=Corridor(AHEAD, room_m=ROOM_M))
    with caplog.at_level(logging.WARNING):
        assert close_loops(store, [part]) == 0
    store.close()
    assert "their loops stay open: places look like others" in caplog.text
