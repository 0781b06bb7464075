"""Path tracking for vehicles of four kinds, closed over the simulator's vehicles."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import ClassVar

import numpy as np
import pytest

from trailmark.commands import Command, Steer4WS, Stop, Velocity
from trailmark.errors import ConfigError
from trailmark.estimates import Belief
from trailmark.frames import Frame
from trailmark.geometry import Pose2
from trailmark.interfaces import Drivable, Session
from trailmark.paths import Path, Waypoint
from trailmark.pipeline.control import check_commands
from trailmark_controllers.tracking import PathTracking
from trailmark_controllers.tracking_config import TrackingConfig
from trailmark_sim.motion import VehicleIntegrator
from trailmark_sim.vehicles import Ackermann, Differential, FourWheelSteering, Holonomic, Vehicle

VEHICLES: dict[str, Vehicle] = {
    "differential": Differential(max_speed_mps=0.8),
    "holonomic": Holonomic(),
    "ackermann": Ackermann(),
    "four_wheel_steering": FourWheelSteering(),
}
LAGS_S = {"holonomic": 0.2}
DONE = "the end of the path is reached"
Doubt = Callable[[Belief], Belief]


def path_of(*pieces: tuple[float, float], spacing_m: float = 0.05) -> Path:
    """Return the path of pieces of (length [m], bend [rad/m])."""
    poses = [Pose2()]
    for length_m, bend in pieces:
        for _ in range(round(length_m / spacing_m)):
            poses.append(poses[-1] @ Pose2.exp(spacing_m, 0.0, bend * spacing_m))
    return Path(Waypoint(i, i * spacing_m, pose) for i, pose in enumerate(poses))


STRAIGHT = path_of((2.0, 0.0))
BEND = path_of((1.0, 0.0), (1.5, 1.0), (0.5, 0.0), (1.0, -1.0))


def tracker(path: Path | None, drive: str = "differential", **keys: object) -> PathTracking:
    config = {"drive": drive, "lag_s": LAGS_S.get(drive, 0.1), "min_turning_radius_m": 0.68} | keys
    controller = PathTracking(TrackingConfig.model_validate(config))
    controller.start(Session(mode="replay", path=path))
    return controller


@pytest.mark.parametrize(
    ("drive", "accepts", "remedy"),
    [
        ("differential", {Steer4WS, Stop}, "write 'drive: four_wheel_steering'"),
        ("four_wheel_steering", {Velocity, Stop}, "write 'drive: differential', 'holonomic' or 'ackermann'"),
    ],
)
def test_a_drive_that_the_robot_does_not_understand_is_refused_with_the_one_that_it_does(
    drive: str, accepts: set[type[Command]], remedy: str
) -> None:
    class Robot(Drivable):
        sensors: ClassVar = {}
        accepts = frozenset[type[Command]]()

        def frames(self) -> Iterator[Frame]:
            return iter(())

        def drive(self, command: Command) -> None:
            raise AssertionError

    Robot.accepts = frozenset(accepts)

    with pytest.raises(ConfigError, match=re.escape(remedy)):
        check_commands(tracker(STRAIGHT, drive), Robot(None))


def certain(belief: Belief) -> Belief:
    return belief


def drive(
    controller: PathTracking, vehicle: Vehicle, start: Pose2, doubt: Doubt = certain, limit_s: float = 60.0
) -> tuple[list[Pose2], list[float], Stop]:
    """Drive until the controller is done or stands; return poses and speeds every 50 ms, and the last command."""
    motion = VehicleIntegrator(vehicle, start, 0, None)
    poses, speeds = [], []
    for tick in range(round(limit_s / 0.05)):
        state = motion.state_at(0.05 * tick)
        poses.append(state.pose_map_base)
        speeds.append(math.hypot(state.twist.forward_mps, state.twist.left_mps))
        told = Belief(0.05 * tick, state.pose_map_base, travelled_m=state.travelled_m, fix_age_m=0, motion_age_s=0)
        command = controller.step(doubt(told))
        motion.command(0.05 * tick, command)
        if isinstance(command, Stop) and (command.done or max(speeds[-20:]) < 1e-3):
            return poses, speeds, command
    raise AssertionError(f"after {limit_s:g} s it still drives, at {poses[-1]}")


def largest_offset_m(path: Path, poses: list[Pose2]) -> float:
    station_m, most_m = None, 0.0
    for pose in poses:
        station_m = path.locate(pose, station_m).station_m
        most_m = max(most_m, pose.distance_to(path.pose_at(station_m)))
    return most_m


@pytest.mark.parametrize("kind", VEHICLES)
def test_bends_are_followed_there_and_back_within_four_millimetres(kind: str) -> None:
    poses, speeds, stop = drive(tracker(BEND, kind, repeat=1.0), VEHICLES[kind], Pose2())

    assert stop == Stop(DONE, done=True)
    assert largest_offset_m(BEND, poses) < 4e-3
    assert max(speeds) == pytest.approx(0.5, abs=0.01)
    assert max(pose.x for pose in poses) == pytest.approx(BEND[len(BEND) - 1].pose_map_base.x, abs=0.02)
    assert poses[-1].distance_to(Pose2()) < 0.02


@pytest.mark.parametrize("kind", VEHICLES)
def test_a_path_that_was_taught_with_noise_is_followed_by_a_noisy_belief(kind: str) -> None:
    rng = np.random.default_rng(7)

    def doubtful(pose: Pose2) -> Pose2:
        return Pose2(*(pose.array() + rng.normal(size=3) * [0.002, 0.002, math.radians(0.2)]))

    noisy = Path(replace(waypoint, pose_map_base=doubtful(waypoint.pose_map_base)) for waypoint in BEND.waypoints)

    def doubt(belief: Belief) -> Belief:
        assert belief.pose_map_base is not None
        return replace(belief, pose_map_base=doubtful(belief.pose_map_base))

    poses, _, stop = drive(tracker(noisy, kind), VEHICLES[kind], Pose2(), doubt)

    offsets_m = [abs(BEND.locate(pose).lateral_m) for pose in poses]
    assert stop.done
    assert np.mean(offsets_m) < 0.003
    assert max(offsets_m) < 0.012


@pytest.mark.parametrize("kind", VEHICLES)
@pytest.mark.parametrize(("left_m", "turn_deg"), [(0.3, -50.0), (-0.4, 20.0), (0.1, 55.0)])
def test_it_starts_anywhere_beside_the_path(kind: str, left_m: float, turn_deg: float) -> None:
    path = path_of((6.0, 0.0))
    start = Pose2(1.0, left_m, math.radians(turn_deg))

    poses, _, stop = drive(tracker(path, kind), VEHICLES[kind], start)

    assert stop.done
    assert poses[-1].x == pytest.approx(6.0, abs=0.02)
    assert abs(poses[-1].y) < 1e-3
    assert abs(poses[-1].theta) < 0.01
    swing_m = 0.75 * (1.0 - math.cos(math.radians(turn_deg)))  # what a vehicle that turns in 0.75 m cannot but drive
    assert max(abs(pose.y) for pose in poses) < abs(left_m) + swing_m + 0.02


@pytest.mark.parametrize("kind", VEHICLES)
def test_standing_at_the_end_drives_backwards(kind: str) -> None:
    end = BEND[len(BEND) - 1].pose_map_base

    poses, _, stop = drive(tracker(BEND, kind), VEHICLES[kind], end)

    assert stop.done
    assert largest_offset_m(BEND, poses) < 4e-3
    assert poses[-1].distance_to(Pose2()) < 0.02
    assert abs(poses[-1].theta) < 0.02


@pytest.mark.parametrize(("reverse", "end_x"), [(True, 0.0), (False, 2.0), (None, 0.0)])
def test_reverse_says_where_to_from_the_middle(reverse: bool | None, end_x: float) -> None:
    poses, _, stop = drive(tracker(STRAIGHT, reverse=reverse), VEHICLES["differential"], Pose2(1.2, 0.05, 0.0))

    assert stop.done
    assert poses[-1].x == pytest.approx(end_x, abs=0.02)


def test_a_loop_that_ends_where_it_begins_is_driven_whole() -> None:
    loop = path_of((2.0 * math.pi, 1.0), spacing_m=math.pi / 60.0)

    poses, _, stop = drive(tracker(loop), VEHICLES["differential"], Pose2(-0.005, 0.002, 0.0))

    assert stop.done
    assert max(pose.y for pose in poses) == pytest.approx(2.0, abs=0.01)
    assert poses[-1].distance_to(Pose2()) < 0.03


def test_a_way_that_was_taught_backwards_in_part_is_driven_so() -> None:
    there = [Pose2(0.05 * i, 0.0, 0.0) for i in range(31)]
    back = [Pose2(1.5, 0.0, 0.0) @ Pose2.exp(-0.05 * i, 0.0, 0.05 * i) for i in range(1, 31)]
    path = Path(Waypoint(i, 0.05 * i, pose) for i, pose in enumerate(there + back))

    poses, _, stop = drive(tracker(path, "ackermann"), VEHICLES["ackermann"], Pose2())

    assert stop.done
    assert max(pose.x for pose in poses) == pytest.approx(1.5, abs=0.02)
    assert poses[-1].distance_to(back[-1]) < 0.03
    assert max(abs(pose.y) for pose in poses) < abs(back[-1].y) + 0.02


def test_a_taught_turn_on_the_spot_is_one_again() -> None:
    there = [Pose2(0.05 * i, 0.0, 0.0) for i in range(21)]
    then = [Pose2(1.0, 0.05 * i, math.pi / 2) for i in range(1, 21)]
    path = Path(Waypoint(i, 0.05 * i, pose) for i, pose in enumerate(there + then))

    poses, _, stop = drive(tracker(path), VEHICLES["differential"], Pose2())

    assert stop.done
    assert poses[-1].distance_to(then[-1]) < 0.02
    assert max(pose.x for pose in poses) < 1.03  # it has not swung out


def test_sharp_bends_are_driven_slowly() -> None:
    sharp = path_of((1.0, 0.0), (0.6, 2.5), (1.0, 0.0))

    poses, speeds, stop = drive(tracker(sharp, yaw_limit_dps=45.0), VEHICLES["differential"], Pose2())
    in_bend = [v for pose, v in zip(poses, speeds) if 1.15 < sharp.locate(pose).station_m < 1.5]

    assert stop.done
    assert max(in_bend) < 1.15 * math.radians(45.0) / 2.5
    assert max(speeds) > 0.4


@pytest.mark.parametrize(
    ("doubt", "reason"),
    [
        ({"covariance": np.diag([0.36, 0.01, 0.01])}, "the position is known to 0.60 m only"),
        ({"fix_age_m": 2.5, "travelled_m": 9.0}, "2.50 m without a fix"),
        ({"motion_age_s": 0.7}, "no motion for 0.70 s"),
        ({"pose_map_base": None}, "the pose is not known yet"),
        ({"pose_map_base": Pose2(1.0, 1.2, 0.0)}, "1.20 m off the path"),
    ],
)
def test_a_doubtful_belief_stops_the_robot_and_a_good_one_sets_it_going_again(
    doubt: dict[str, object], reason: str
) -> None:
    controller = tracker(STRAIGHT)
    good = Belief(0.0, Pose2(0.2), fix_age_m=0.0, motion_age_s=0.0)
    controller.step(good)

    stop = controller.step(replace(good, stamp_s=0.1, **doubt))  # type: ignore[arg-type]
    goes = controller.step(replace(good, stamp_s=0.2))

    assert isinstance(stop, Stop)
    assert not stop.done
    assert reason in stop.reason
    assert isinstance(goes, Velocity)
    assert goes.forward_mps > 0.0


def test_a_belief_that_becomes_wide_slows_the_robot_down_before_it_stands() -> None:
    def widen(belief: Belief) -> Belief:
        return replace(belief, covariance=np.eye(3) * (0.25 * belief.travelled_m) ** 2)

    poses, speeds, stop = drive(tracker(path_of((4.0, 0.0))), VEHICLES["differential"], Pose2(), widen)

    assert "the position is known to 0.5" in stop.reason
    assert poses[-1].x == pytest.approx(2.0, abs=0.05)
    slowing = [v for pose, v in zip(poses, speeds) if 0.6 < pose.x < 1.9]
    assert all(later <= earlier + 1e-3 for earlier, later in pairwise(slowing))
    assert slowing[0] > 0.3 > 0.15 > slowing[-1]


def test_before_the_first_fix_the_way_counts_from_the_start() -> None:
    def never_fixed(belief: Belief) -> Belief:
        return replace(belief, fix_age_m=math.inf)

    path = path_of((4.0, 0.0))
    poses, _, stop = drive(tracker(path), VEHICLES["differential"], Pose2(), never_fixed)
    _, _, free = drive(tracker(path, max_fix_age_m=None), VEHICLES["differential"], Pose2(), never_fixed)

    assert "without a fix" in stop.reason
    assert poses[-1].x == pytest.approx(2.0, abs=0.05)
    assert free.done


@pytest.mark.parametrize(("kind", "command"), [("four_wheel_steering", Steer4WS), ("ackermann", Velocity)])
def test_it_gives_what_the_vehicle_takes(kind: str, command: type) -> None:
    controller = tracker(STRAIGHT, kind)

    assert controller.gives == {command, Stop}
    assert isinstance(controller.step(Belief(0.0, Pose2(), fix_age_m=0.0)), command)


def test_an_ackermann_vehicle_is_asked_for_no_sharper_bend_than_it_can_drive() -> None:
    controller = tracker(STRAIGHT, "ackermann")

    command = controller.step(Belief(0.0, Pose2(0.5, 0.4, 1.5), fix_age_m=0.0))

    assert isinstance(command, Velocity)
    assert abs(command.yaw_radps / command.forward_mps) == pytest.approx(1.0 / 0.68)


def test_a_path_of_one_place_is_reached() -> None:
    controller = tracker(Path([Waypoint(0, 0.0, Pose2())]))

    assert controller.step(Belief(0.0, Pose2(), fix_age_m=0.0)) == Stop(DONE, done=True)


def test_without_a_path_it_refuses_to_start() -> None:
    with pytest.raises(ConfigError, match="path_tracking follows a taught path"):
        tracker(None)


@pytest.mark.parametrize(
    ("config", "match"),
    [
        ({"repeat": 0.7}, "in halves"),
        ({"creep_mps": 1.0}, "faster than"),
        ({"slow_sigma_m": 0.6}, "is above max_sigma_m"),
        ({"drive": "crab"}, "differential"),
    ],
)
def test_impossible_configs_are_refused(config: dict[str, object], match: str) -> None:
    with pytest.raises(ValueError, match=match):
        TrackingConfig.model_validate(config)


@pytest.mark.parametrize("first_s", [0.0, 1.7e9])
def test_it_gathers_speed_from_rest_on_any_clock_and_after_a_pause(first_s: float) -> None:
    """Live stamps count from 1970; a guard or a person may stop the robot without asking."""
    controller = tracker(path_of((20.0, 0.0)))
    most = controller.config.accel_mps2 * 0.05 + 1e-9

    for begin_s in (first_s, first_s + 30.0):
        speeds = []
        for tick in range(20):
            place = Pose2(5.0 + 0.01 * tick, 0.0, 0.0)
            told = Belief(begin_s + 0.05 * tick, place, travelled_m=1.0, fix_age_m=0, motion_age_s=0)
            command = controller.step(told)
            assert isinstance(command, Velocity)
            speeds.append(command.forward_mps)
        assert speeds[0] <= controller.config.creep_mps + most
        assert np.diff(speeds).max() <= most + 1e-6
        assert speeds[-1] > 5 * speeds[0]
