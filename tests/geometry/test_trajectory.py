"""Trajectories: increasing stamps, interpolation, other frames."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.errors import ShapeError
from trailmark.geometry import Pose2, Trajectory, wrap_angles

coordinates = st.floats(-50.0, 50.0)
poses = st.builds(Pose2, coordinates, coordinates, st.floats(-3.0, 3.0))


def trajectories(min_size: int = 1) -> st.SearchStrategy[Trajectory]:
    steps = st.tuples(st.floats(1e-3, 10.0), poses)
    return st.lists(steps, min_size=min_size, max_size=8).map(
        lambda rows: Trajectory(np.cumsum([dt for dt, _ in rows]), np.array([pose.array() for _, pose in rows]))
    )


SQUARE = Trajectory(
    np.array([0.0, 1.0, 2.0, 3.0]), np.array([[0, 0, 0], [3, 0, 0], [3, 4, math.pi / 2], [3, 4, math.pi]], float)
)


def test_the_way_is_measured_along_the_poses() -> None:
    assert SQUARE.length_m() == 7.0
    np.testing.assert_array_equal(SQUARE.travelled_m(), [0.0, 3.0, 7.0, 7.0])


def test_headings_are_wrapped() -> None:
    np.testing.assert_allclose(SQUARE.headings, [0.0, 0.0, math.pi / 2, -math.pi])


def test_halfway_between_two_poses_is_their_middle() -> None:
    stamp_s, pose = SQUARE.at([1.5])[0]

    assert stamp_s == 1.5
    np.testing.assert_allclose(pose.array(), [3.0, 2.0, math.pi / 4])


def test_turns_are_interpolated_the_short_way() -> None:
    turning = Trajectory(np.array([0.0, 1.0]), np.array([[0, 0, 3.0], [0, 0, -3.0]]))

    assert abs(abs(turning.at([0.5]).headings[0]) - math.pi) < 1e-12


@given(trajectories())
def test_at_its_own_stamps_a_trajectory_is_itself(trajectory: Trajectory) -> None:
    same = trajectory.at(trajectory.stamps_s)

    np.testing.assert_allclose(same.positions, trajectory.positions, atol=1e-9)
    np.testing.assert_allclose(wrap_angles(same.headings - trajectory.headings), 0.0, atol=1e-9)


@given(trajectories(), poses)
def test_another_frame_changes_no_motion(trajectory: Trajectory, pose_new_old: Pose2) -> None:
    moved = trajectory.transformed(pose_new_old)

    assert moved.length_m() == pytest.approx(trajectory.length_m(), abs=1e-8)
    for index in range(len(trajectory)):
        expected = pose_new_old @ trajectory[index][1]
        np.testing.assert_allclose(moved[index][1].array()[:2], expected.array()[:2], atol=1e-9)
        assert math.cos(moved[index][1].theta - expected.theta) == pytest.approx(1.0)


@given(trajectories())
def test_stamped_poses_make_the_same_trajectory(trajectory: Trajectory) -> None:
    again = Trajectory.from_poses(trajectory[index] for index in range(len(trajectory)))

    np.testing.assert_array_equal(again.stamps_s, trajectory.stamps_s)
    np.testing.assert_array_equal(again.poses, trajectory.poses)


def test_a_part_holds_the_stamps_inside_with_both_ends() -> None:
    assert SQUARE.between(1.0, 2.0).stamps_s.tolist() == [1.0, 2.0]
    assert len(SQUARE.between(1.1, 1.9)) == 0


def test_an_empty_trajectory_is_a_trajectory() -> None:
    empty = Trajectory.from_poses([])

    assert (len(empty), empty.length_m(), empty.travelled_m().tolist()) == (0, 0.0, [])
    assert len(empty.at([])) == 0
    assert len(empty.transformed(Pose2(1.0, 2.0, 3.0))) == 0
    with pytest.raises(ValueError, match="trajectory is empty"):
        empty.at([1.0])


def test_it_cannot_be_changed_and_does_not_change_what_it_was_made_of() -> None:
    stamps_s, values = np.array([0.0, 1.0]), np.array([[0, 0, 4.0], [1, 0, 0]])
    trajectory = Trajectory(stamps_s, values)
    stamps_s[0] = 9.0

    assert values[0, 2] == 4.0
    assert trajectory.stamps_s[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        trajectory.poses[0, 0] = 1.0


@pytest.mark.parametrize("stamps_s", [[-0.1], [3.1], [1.0, 3.1]])
def test_it_is_never_extrapolated(stamps_s: list[float]) -> None:
    with pytest.raises(ValueError, match=r"trajectory covers 0.000000 to 3.000000 s; asked for"):
        SQUARE.at(stamps_s)


@pytest.mark.parametrize(
    ("stamps_s", "values", "error", "message"),
    [
        ([0.0, 0.0], np.zeros((2, 3)), ValueError, "pose 1 has 0.000000000 s after 0.000000000 s"),
        ([0.0, 2.0, 1.0], np.zeros((3, 3)), ValueError, "pose 2 has 1.0"),
        ([0.0, math.nan], np.zeros((2, 3)), ValueError, "pose 1 is not finite"),
        ([0.0, 1.0], [[0, 0, 0], [0, math.inf, 0]], ValueError, "pose 1 is not finite"),
        ([0.0, 1.0], np.zeros((3, 3)), ShapeError, "must be"),
        ([0.0, 1.0], np.zeros((2, 2)), ShapeError, "must be"),
    ],
)
def test_what_is_no_trajectory_is_refused_with_the_index(
    stamps_s: list[float], values: object, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        Trajectory(np.array(stamps_s), values)  # type: ignore[arg-type]
