"""A drift is straightened if places are told to be the same that are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trailmark.estimates import Fix, Lost
from trailmark.geometry import Pose2, rotate_axes, wrap_angle
from trailmark.paths import Keyframe
from trailmark.pipeline.teaching.logged_way import LoggedWay
from trailmark.pipeline.teaching.loops import LoopSearch, RelatingLocalizer, _parallel
from trailmark.pipeline.teaching.way_graph import Straightened


def searched(nodes: Sequence[Keyframe], localizer: Any) -> Any:
    part: Any = SimpleNamespace(name="laser", localizer=localizer)
    return LoopSearch(nodes, [RelatingLocalizer(part, nodes)]).straighten()


def test_a_drift_is_straightened_by_places_seen_twice(rounds: Any) -> None:
    nodes = rounds.log()
    assert len(nodes) == len(rounds.truth)
    straightened = searched(nodes, rounds.relating(nodes))
    moved = [straightened.at_stamp(node.stamp_s, node.pose_map_base) for node in nodes]
    assert rounds.worst([node.pose_map_base for node in nodes]) > 1.0
    assert rounds.worst(moved) < 0.35
    second = [moved[k].between(moved[k + 63]) for k in range(62)]  # what matters: both rounds lie on each other
    true = [rounds.truth[k].between(rounds.truth[k + 63]) for k in range(62)]
    assert max(a.distance_to(b) for a, b in zip(second, true, strict=True)) < 0.08
    assert straightened.at_station(0.0, Pose2()) == Pose2()


def test_without_places_seen_twice_nothing_moves(rounds: Any) -> None:
    nodes = rounds.log()
    assert searched(nodes, rounds.relating(nodes, lambda pose, n: Lost(0.0, "no"))) is None


def test_single_wrong_places_are_not_believed(rounds: Any) -> None:
    nodes, rng = rounds.log(), np.random.default_rng(5)

    def somewhere(pose: Pose2, n: int) -> Fix:
        return Fix(
            0.0, Pose2(pose.x + rng.normal(0, 1), pose.y + rng.normal(0, 1), pose.theta + rng.normal()), rounds.good
        )

    localizer = rounds.relating(nodes, somewhere)
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


def test_places_that_tell_only_the_heading_straighten_it(rounds: Any) -> None:
    nodes, only_heading = rounds.log(), np.diag([0.0, 0.0, rounds.good[2, 2]])
    straightened = searched(nodes, rounds.relating(nodes, lambda pose, n: Fix(0.0, pose, only_heading)))
    before = [abs(wrap_angle(node.pose_map_base.theta - true.theta)) for node, true in zip(nodes, rounds.truth)]
    moved = [straightened.at_stamp(node.stamp_s, node.pose_map_base) for node in nodes]
    after = [abs(wrap_angle(pose.theta - true.theta)) for pose, true in zip(moved, rounds.truth)]
    assert max(after) < 0.5 * max(before)


def test_wrong_places_among_right_ones_bend_nothing(rounds: Any) -> None:
    nodes = rounds.log()
    right = searched(nodes, rounds.relating(nodes))
    wrong = searched(
        nodes, rounds.relating(nodes, lambda pose, n: Fix(0.0, pose @ Pose2(0.5, -0.4, 0.2 * (n % 8 == 0)), rounds.good)
                       if n % 4 == 0 else Fix(0.0, pose, rounds.good))
    )  # fmt: skip
    ends = [one.at_stamp(nodes[-1].stamp_s, nodes[-1].pose_map_base) for one in (right, wrong)]
    assert ends[0].distance_to(ends[1]) < 0.15


def test_a_place_seen_again_is_found_by_the_keyframe_of_its_own_teaching(rounds: Any) -> None:
    nodes = rounds.in_two_goes(rounds.log())
    part: Any = SimpleNamespace(name="laser", localizer=rounds.relating(nodes, by_number=True))
    sites = RelatingLocalizer(part, nodes).sites_of(LoggedWay(nodes))
    assert {number: site[0] for number, site in sites.items()} == {number: number for number in range(len(nodes))}


def test_what_was_taught_before_there_was_a_log_moves_with_its_waypoints(rounds: Any) -> None:
    nodes = [replace(node, station_m=node.station_m + 12.5) for node in rounds.log()]
    straightened = searched(nodes, rounds.relating(nodes, by_number=True))
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
