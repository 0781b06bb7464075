"""Taught paths and path coordinates."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.errors import ShapeError
from trailmark.geometry import Pose2, wrap_angle
from trailmark.paths import Keyframe, OnPath, Path, Waypoint


def path_of(*poses: Pose2, spacing_m: float | None = None) -> Path:
    """Return the path through poses; stations from the distances, or evenly spaced."""
    stations = [0.0]
    for first, second in itertools.pairwise(poses):
        stations.append(stations[-1] + (first.distance_to(second) if spacing_m is None else spacing_m))
    return Path(Waypoint(i, station, pose) for i, (station, pose) in enumerate(zip(stations, poses, strict=True)))


STRAIGHT = path_of(Pose2(0, 0, 0), Pose2(1, 0, 0), Pose2(3, 0, 0))
CIRCLE = path_of(*(Pose2(math.cos(a), math.sin(a), a + math.pi / 2) for a in np.linspace(0.0, 1.5 * math.pi, 200)))


class TestPath:
    def test_a_path_is_its_waypoints_in_order(self) -> None:
        assert len(STRAIGHT) == 3
        assert STRAIGHT[1] == Waypoint(1, 1.0, Pose2(1, 0, 0))
        assert STRAIGHT.length_m == 3.0
        np.testing.assert_array_equal(STRAIGHT.stations, [0.0, 1.0, 3.0])
        np.testing.assert_array_equal(STRAIGHT.positions, [[0, 0], [1, 0], [3, 0]])

    def test_no_waypoint_is_no_path(self) -> None:
        with pytest.raises(ShapeError, match="at least one waypoint"):
            Path([])

    @pytest.mark.parametrize("station_m", [1.0, 0.5])
    def test_stations_increase(self, station_m: float) -> None:
        with pytest.raises(ShapeError, match="waypoint 2 does not lie after waypoint 1"):
            Path([Waypoint(0, 0.0, Pose2()), Waypoint(1, 1.0, Pose2()), Waypoint(2, station_m, Pose2())])

    def test_a_path_of_arrays_is_that_of_its_waypoints(self) -> None:
        poses = np.array([one.pose_map_base.array() for one in CIRCLE.waypoints])
        path = Path.from_arrays(CIRCLE.stations, poses)

        assert path[7] == CIRCLE[7]
        assert path[-1] == CIRCLE[-1]
        for station_m in (-1.0, 0.0, 1.234, 9.0):
            assert path.pose_at(station_m) == CIRCLE.pose_at(station_m)
            assert path.line_at(station_m) == CIRCLE.line_at(station_m)
            assert path.locate(Pose2(0.9, 0.1, 1.0), station_m) == CIRCLE.locate(Pose2(0.9, 0.1, 1.0), station_m)
        assert path.waypoints == CIRCLE.waypoints
        with pytest.raises(IndexError):
            path[len(CIRCLE)]

    def test_headings_of_arrays_are_wrapped_and_numbers_that_are_none_refused(self) -> None:
        assert (
            Path.from_arrays(np.array([0.0]), np.array([[1, 2, math.pi]])).waypoints[0].pose_map_base.theta == -math.pi
        )
        with pytest.raises(ShapeError, match="not finite"):
            Path.from_arrays(np.array([0.0, 1.0]), np.array([[0, 0, 0], [1, math.nan, 0]]))
        with pytest.raises(ShapeError, match="at least one waypoint"):
            Path.from_arrays(np.empty(0), np.empty((0, 3)))

    @pytest.mark.parametrize(
        ("stations", "poses"),
        [((4,), (2, 3)), ((2,), (4, 3)), ((4,), (4, 2)), ((4,), (4, 4)), ((0,), (0,)), ((), (1, 3))],
    )
    def test_arrays_that_do_not_fit_each_other_are_refused(
        self, stations: tuple[int, ...], poses: tuple[int, ...]
    ) -> None:
        with pytest.raises(ShapeError, match="shape"):
            Path.from_arrays(np.cumsum(np.ones(stations)).reshape(stations), np.zeros(poses))

    def test_a_slice_of_a_path_is_its_waypoints_however_it_was_made(self) -> None:
        path = Path.from_arrays(STRAIGHT.stations, np.array([[0, 0, 0], [1, 0, 0], [3, 0, 0]]))

        assert path[1:] == STRAIGHT[1:] == STRAIGHT.waypoints[1:]
        assert path[::-2] == STRAIGHT[::-2]


class TestPoseAt:
    def test_it_meets_the_waypoints(self) -> None:
        for waypoint in CIRCLE.waypoints:
            found = CIRCLE.pose_at(waypoint.station_m)
            assert found.distance_to(waypoint.pose_map_base) < 1e-12
            assert abs(wrap_angle(found.theta - waypoint.pose_map_base.theta)) < 1e-12

    def test_between_waypoints_it_is_on_the_line_and_turns_evenly(self) -> None:
        path = path_of(Pose2(0, 0, 3.0), Pose2(2, 0, -3.0))

        found = path.pose_at(0.5)

        assert (found.x, found.y) == (0.5, 0.0)
        assert wrap_angle(found.theta - 3.0) == pytest.approx((2 * math.pi - 6.0) / 4)

    @pytest.mark.parametrize(("station_m", "x"), [(-1.0, 0.0), (9.0, 3.0)])
    def test_beyond_an_end_it_is_that_end(self, station_m: float, x: float) -> None:
        assert STRAIGHT.pose_at(station_m) == Pose2(x, 0.0, 0.0)


class TestTangent:
    def test_it_is_the_direction_of_the_line_and_not_the_heading(self) -> None:
        sideways = path_of(Pose2(0, 0, 0.3), Pose2(0, 1, 0.3))

        assert sideways.tangent_at(0.5) == pytest.approx(math.pi / 2)

    def test_on_the_spot_it_is_the_heading(self) -> None:
        turning = path_of(Pose2(1, 1, 0.4), Pose2(1, 1, 0.8), spacing_m=0.1)

        assert turning.tangent_at(0.05) == pytest.approx(0.4)

    def test_the_turn_rate_is_that_of_the_taught_heading(self) -> None:
        assert CIRCLE.turn_rate_at(2.0) == pytest.approx(1.0, rel=1e-3)
        assert STRAIGHT.turn_rate_at(0.5) == 0.0
        assert CIRCLE.turn_rate_at(-1.0) == CIRCLE.turn_rate_at(99.0) == 0.0

    def test_a_line_says_its_direction_and_how_the_heading_turns_and_is_kept(self) -> None:
        line = CIRCLE.line_at(2.0)

        assert line.tangent_rad == CIRCLE.tangent_at(2.0)
        assert (line.cos, line.sin) == (math.cos(line.tangent_rad), math.sin(line.tangent_rad))
        assert line.turn_rate_radpm == CIRCLE.turn_rate_at(2.0)
        assert CIRCLE.line_at(2.0) is line


class TestLocate:
    def test_left_of_the_path_and_turned_counter_clockwise_are_positive(self) -> None:
        assert STRAIGHT.locate(Pose2(0.5, 0.2, 0.1)) == OnPath(0.5, pytest.approx(0.2), pytest.approx(0.1))
        assert STRAIGHT.locate(Pose2(2.0, -0.2, -0.1)) == OnPath(2.0, pytest.approx(-0.2), pytest.approx(-0.1))

    def test_headings_are_compared_the_short_way(self) -> None:
        path = path_of(Pose2(0, 0, 3.1), Pose2(-1, 0, 3.1))

        assert path.locate(Pose2(-0.5, 0, -3.1)).heading_rad == pytest.approx(2 * math.pi - 6.2)

    @given(st.floats(0.01, 4.6), st.floats(-0.3, 0.3), st.floats(-1.0, 1.0))
    def test_it_undoes_pose_from(self, station_m: float, lateral_m: float, heading_rad: float) -> None:
        found = CIRCLE.locate(CIRCLE.pose_from(OnPath(station_m, lateral_m, heading_rad)))

        # lines of 24 mm meet at 24 mrad: beside a corner the nearest line is not always the one it came from
        assert found.station_m == pytest.approx(station_m, abs=0.01)
        assert found.lateral_m == pytest.approx(lateral_m, abs=1e-3)
        assert found.heading_rad == pytest.approx(heading_rad, abs=0.03)

    @given(st.floats(0.0, 3.0), st.floats(-5.0, 5.0), st.floats(-3.1, 3.1))
    def test_on_a_straight_path_it_undoes_pose_from_exactly(
        self, station_m: float, lateral_m: float, turn: float
    ) -> None:
        found = STRAIGHT.locate(STRAIGHT.pose_from(OnPath(station_m, lateral_m, turn)))

        assert (found.station_m, found.lateral_m) == (pytest.approx(station_m), pytest.approx(lateral_m))
        assert found.heading_rad == pytest.approx(turn)

    def test_where_the_path_crosses_itself_it_stays_on_its_branch(self) -> None:
        eight = path_of(*(Pose2(math.sin(a), math.sin(2 * a), 0.0) for a in np.linspace(0.2, 2 * math.pi + 0.1, 400)))
        crossing = [
            float(eight.stations[np.argmin(np.hypot(*eight.positions[part].T)) + part.start])
            for part in (slice(0, 300), slice(300, 400))
        ]

        for station_m in crossing:
            found = eight.locate(Pose2(), near_station_m=station_m, window_m=0.5)
            assert found.station_m == pytest.approx(station_m, abs=0.05)
        assert abs(crossing[0] - crossing[1]) > 2.0

    @given(st.integers(0, 2**32 - 1))
    def test_the_window_gives_what_a_search_of_everything_gives(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        headings = np.cumsum(rng.normal(0.0, 0.05, 60))  # winding, but it comes back to no place within 3 m
        places = 0.05 * np.cumsum([np.cos(headings), np.sin(headings)], axis=1).T
        path = path_of(*(Pose2(x, y, a) for (x, y), a in zip(places.tolist(), headings.tolist(), strict=True)))
        station_m = float(rng.uniform(0.0, path.length_m))
        pose = path.pose_from(OnPath(station_m, float(rng.normal(0.0, 0.1)), 0.2))

        assert path.locate(pose, station_m + float(rng.normal(0.0, 0.1)), window_m=3.5) == path.locate(pose)

    def test_a_robot_that_was_carried_away_is_looked_for_everywhere(self) -> None:
        found = CIRCLE.locate(CIRCLE.pose_at(4.0), near_station_m=0.5, window_m=0.5)

        assert found.station_m == pytest.approx(4.0, abs=1e-6)

    def test_a_hint_beyond_the_ends_is_harmless(self) -> None:
        for hint in (-5.0, 99.0):
            assert STRAIGHT.locate(Pose2(0.5, 0.1, 0.0), near_station_m=hint, window_m=0.1).station_m == pytest.approx(
                0.5
            )


class TestOnePose:
    PATH = path_of(Pose2(1.0, 2.0, math.pi / 2))

    def test_everything_is_asked_of_the_one_pose(self) -> None:
        assert self.PATH.length_m == 0.0
        assert self.PATH.pose_at(7.0) == Pose2(1.0, 2.0, math.pi / 2)
        assert self.PATH.tangent_at(7.0) == math.pi / 2

    def test_offsets_are_those_from_it(self) -> None:
        assert self.PATH.locate(Pose2(0.5, 2.2, math.pi / 2)) == OnPath(0.0, pytest.approx(0.5), 0.0)


def test_a_keyframe_keeps_its_arrays_from_being_changed() -> None:
    patch = np.zeros((2, 2), np.uint8)
    keyframe = Keyframe(1.0, 2.0, Pose2(), {"patch": patch})

    with pytest.raises(ValueError, match="read-only"):
        keyframe.arrays["patch"][0, 0] = 1
    with pytest.raises(TypeError):
        keyframe.arrays["more"] = patch  # type: ignore[index]
    assert patch.flags.writeable  # the owner's own array stays its own


@pytest.mark.parametrize("far_m", [9e307, -1.7e308])
def test_a_path_of_places_beyond_all_distances_can_be_built(far_m: float) -> None:
    """A store that holds such a path must open, and say what is in it."""
    poses = [Pose2(far_m, 0.0), Pose2(0.0, far_m), Pose2(-far_m, 0.0)]

    path = Path(Waypoint(k, float(k), pose) for k, pose in enumerate(poses))

    assert len(path.waypoints) == 3
