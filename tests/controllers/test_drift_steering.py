"""Drift steering along a taught path."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.commands import Stop, Velocity
from trailmark.errors import ConfigError
from trailmark.estimates import Belief, PathOffset
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import Session
from trailmark.paths import Path, Waypoint
from trailmark_controllers.drift_steering import DriftSteering, StepLaw, drift_angle, smooth_bend, taught_bend
from trailmark_controllers.drift_steering_config import DriftSteeringConfig

DT_S = 0.05


def path_of(*pieces: tuple[float, float]) -> Path:
    """A path of pieces (length, radius); waypoints every 5 cm, radius inf is straight."""
    pose, waypoints = Pose2(), [Waypoint(0, 0.0, Pose2())]
    for length_m, radius_m in pieces:
        for _ in range(round(length_m / 0.05)):
            pose = pose @ Pose2.exp(0.05, 0.0, 0.05 / radius_m)
            waypoints.append(Waypoint(len(waypoints), 0.05 * len(waypoints), pose))
    return Path(waypoints)


STRAIGHT = path_of((10.0, math.inf))
TWO_TURNS = path_of((4.0, math.inf), (math.pi / 2, 1.0), (4.0, math.inf), (math.pi / 2, -1.0), (4.0, math.inf))


def offset(station_m: float, lateral_m: float = 0.0, heading_rad: float = 0.0) -> PathOffset:
    return PathOffset(0.0, station_m, lateral_m, heading_rad, np.zeros((3, 3)))


def started(path: Path, start_pose: Pose2 | None = None, **config: object) -> DriftSteering:
    controller = DriftSteering(DriftSteeringConfig.model_validate(config))
    controller.start(Session(mode="replay", path=path, start_pose=start_pose))
    return controller


def drive(
    controller: DriftSteering, path: Path, pose: Pose2, fix_every_m: float = 0.0, seconds: float = 400.0
) -> tuple[list[PathOffset], Stop]:
    """Drive a unicycle until it is done. The drift is known at once, or every so often."""
    seen, station_m, way_m, fix_m, odom = [], None, 0.0, 0.0, Pose2()
    for k in range(round(seconds / DT_S)):
        near = path.locate(pose, station_m)
        station_m = near.station_m
        fix_m = way_m if way_m - fix_m >= fix_every_m else fix_m
        on_path = offset(near.station_m, near.lateral_m, near.heading_rad)
        belief = Belief(k * DT_S, pose, None, odom, Twist2(), way_m, on_path, way_m - fix_m, 0.0)
        command = controller.step(belief)
        seen.append(on_path)
        if isinstance(command, Stop):
            return seen, command
        assert isinstance(command, Velocity)
        step = Pose2.exp(command.forward_mps * DT_S, 0.0, command.yaw_radps * DT_S)
        pose, odom, way_m = pose @ step, odom @ step, way_m + abs(command.forward_mps) * DT_S
    raise AssertionError("the controller never finished")


@pytest.mark.parametrize("law", ["smooth", "steps"])
@pytest.mark.parametrize("heading_deg", [5, -5, 2, -2, 10, -10])
def test_a_wrong_heading_at_the_start_is_turned_away(law: str, heading_deg: float) -> None:
    controller = started(STRAIGHT, law=law)

    seen, stop = drive(controller, STRAIGHT, Pose2(0, 0, math.radians(heading_deg)), 0.4 if law == "steps" else 0.0)

    assert stop.done
    assert abs(seen[-1].lateral_m) < 0.06
    assert abs(math.degrees(seen[-1].heading_rad)) < 1.5
    assert max(abs(there.lateral_m) for there in seen) < 0.25


@pytest.mark.parametrize("lateral_m", [0.4, -0.4])
def test_an_offset_vanishes_within_the_lookahead(lateral_m: float) -> None:
    seen, _ = drive(started(STRAIGHT, lookahead_m=2.0), STRAIGHT, Pose2(0, lateral_m, 0))

    at_m = {round(there.station_m): there.lateral_m for there in seen}
    assert abs(at_m[4]) < 0.5 * abs(lateral_m)
    assert abs(at_m[9]) < 0.03
    assert all(there.lateral_m * lateral_m > -1e-4 for there in seen)  # no overshoot


@pytest.mark.parametrize("law", ["smooth", "steps"])
def test_taught_turns_are_driven_again(law: str) -> None:
    seen, stop = drive(started(TWO_TURNS, law=law), TWO_TURNS, Pose2(0, 0.05, 0.03), 0.4 if law == "steps" else 0.0)

    assert stop.done
    assert seen[-1].station_m == pytest.approx(TWO_TURNS.stations[-1], abs=0.03)
    assert max(abs(there.lateral_m) for there in seen) < 0.1


def test_taught_turns_are_driven_backwards_from_the_end() -> None:
    end = TWO_TURNS[len(TWO_TURNS) - 1].pose_map_base
    controller = started(TWO_TURNS, start_pose=end)

    seen, stop = drive(controller, TWO_TURNS, end @ Pose2(0.0, 0.05, 0.03))

    assert stop.done
    assert seen[-1].station_m < 0.03
    assert abs(seen[-1].lateral_m) < 0.03
    assert max(abs(there.lateral_m) for there in seen) < 0.1


@pytest.mark.parametrize(("repeat", "end_m"), [(0.5, 10.0), (1.0, 0.0), (1.5, 10.0)])
def test_legs_end_where_they_should(repeat: float, end_m: float) -> None:
    seen, stop = drive(started(STRAIGHT, repeat=repeat), STRAIGHT, Pose2())

    assert stop.done
    assert seen[-1].station_m == pytest.approx(end_m, abs=0.03)
    assert len(seen) == pytest.approx(2 * repeat * 10 / 0.3 / DT_S, rel=0.02)


def test_corrections_are_never_sharper_than_the_limit() -> None:
    controller = started(STRAIGHT, correction_limit_deg_per_m=10.0)

    command = controller.step(Belief(0.0, on_path=offset(2.0, 3.0, 1.0)))

    assert isinstance(command, Velocity)
    assert math.degrees(command.yaw_radps / command.forward_mps) == pytest.approx(-10.0)


def test_in_a_bend_too_sharp_for_the_yaw_limit_it_slows_down() -> None:
    path = path_of((2.0, math.inf), (0.5, 0.25), (2.0, math.inf))

    command = started(path, yaw_limit_deg_per_s=30.0).step(Belief(0.0, on_path=offset(2.25)))

    assert isinstance(command, Velocity)
    assert math.degrees(command.yaw_radps) == pytest.approx(30.0)
    assert command.yaw_radps / command.forward_mps == pytest.approx(4.0, rel=0.05)


def test_a_turn_on_the_spot_is_driven_as_a_tight_bend() -> None:
    before = [Waypoint(k, 0.05 * k, Pose2(0.05 * k, 0.0, 0.0)) for k in range(41)]
    after = [Waypoint(41 + k, 2.05 + 0.05 * k, Pose2(2.0, 0.05 * (k + 1), math.pi / 2)) for k in range(40)]
    path = Path(before + after)

    seen, stop = drive(started(path), path, Pose2())

    assert stop.done
    assert max(abs(there.lateral_m) for there in seen) < 0.2


@pytest.mark.parametrize(
    ("station_m", "expected"), [(-1.0, 0.0), (2.0, 0.0), (5.0, 1.0), (7.0, 0.0), (10.0, -1.0), (99.0, 0.0)]
)
def test_the_taught_bend_is_the_curvature_of_the_path(station_m: float, expected: float) -> None:
    assert taught_bend(TWO_TURNS, station_m) == pytest.approx(expected, abs=0.01)


def test_a_path_of_one_place_does_not_bend() -> None:
    assert taught_bend(Path([Waypoint(0, 0.0, Pose2())]), 0.0) == 0.0


def test_backwards_an_offset_is_turned_away_the_other_way() -> None:
    assert drift_angle(offset(0, 0.3, 0.1), 1, 3.0) == pytest.approx(0.1 + math.atan(0.1))
    assert drift_angle(offset(0, 0.3, 0.1), -1, 3.0) == pytest.approx(0.1 - math.atan(0.1))


def test_the_smooth_law_is_proportional_up_to_its_limit() -> None:
    assert smooth_bend(0.1, 0.5, 1.0) == pytest.approx(-0.2)
    assert smooth_bend(-3.0, 0.5, 1.0) == 1.0


def test_the_step_law_waits_for_news_after_a_turn() -> None:
    law, limit = StepLaw(0.01, 0.2), 0.2

    def believe(way_m: float, heading_rad: float, fix_age_m: float) -> Belief:
        return Belief(0.0, pose_odom_base=Pose2(0, 0, heading_rad), travelled_m=way_m, fix_age_m=fix_age_m)

    assert law.bend(believe(0.0, 0.0, math.inf), 0.1, 0.0) == 0.0  # nothing known yet
    assert law.bend(believe(0.4, 0.0, 0.2), 0.1, 0.0) == 0.0  # known now: decided
    assert law.bend(believe(0.41, 0.0, 0.2), 0.1, 0.0) == -limit
    assert law.bend(believe(0.6, -0.05, 0.2), 0.1, 0.0) == -limit  # half done
    assert law.bend(believe(0.9, -0.1, 0.2), 0.1, 0.0) == 0.0  # done: straight, although the old estimate stands
    assert law.bend(believe(1.0, -0.1, 0.3), 0.1, 0.0) == 0.0
    assert law.bend(believe(1.2, -0.1, 0.1), 0.005, 0.0) == 0.0  # news, within the dead band
    assert law.bend(believe(1.3, -0.1, 0.1), -0.05, 0.0) == 0.0
    assert law.bend(believe(1.31, -0.1, 0.1), -0.05, 0.0) == limit


def test_a_turn_of_the_path_does_not_count_as_correction() -> None:
    law = StepLaw(0.01, 0.2)
    law.bend(Belief(0.0, fix_age_m=math.inf), 0.0, 0.0)
    law.bend(Belief(0.0, travelled_m=0.4, fix_age_m=0.1), 0.1, 0.0)

    turned_with_the_path = Belief(0.0, pose_odom_base=Pose2(0, 0, 0.1), travelled_m=0.5, fix_age_m=0.2)

    assert law.bend(turned_with_the_path, 0.1, 0.1) == -0.2


def test_while_its_place_is_unknown_it_drives_a_little_way_and_stops() -> None:
    controller = started(STRAIGHT, search_m=1.0)

    commands = [controller.step(Belief(0.0, travelled_m=3.0 + way_m)) for way_m in (0.0, 0.99, 1.01)]

    assert commands[0] == commands[1] == Velocity(0.15)
    assert commands[2] == Stop("the place on the path is not known")
    assert isinstance(controller.step(Belief(0.0, travelled_m=4.1, on_path=offset(1.0))), Velocity)
    assert controller.step(Belief(0.0, travelled_m=4.2)) == Velocity(0.15)  # lost again: it may search again


def test_it_gives_velocities_and_stops() -> None:
    assert started(STRAIGHT).gives == {Velocity, Stop}


def test_it_needs_a_path() -> None:
    with pytest.raises(ConfigError, match="there is none"):
        DriftSteering(DriftSteeringConfig()).start(Session(mode="replay"))


def test_repeat_counts_in_halves() -> None:
    with pytest.raises(ValueError, match=r"not 0\.7"):
        DriftSteeringConfig(repeat=0.7)
