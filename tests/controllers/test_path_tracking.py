"""Path tracking with front and rear steering."""

from __future__ import annotations

import math

import pytest

from trailmark.commands import Steer4WS, Stop
from trailmark.errors import ConfigError
from trailmark.estimates import Belief
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.paths import Path, Waypoint
from trailmark_controllers.path_tracking import PathTracking4WS, path_errors, steering
from trailmark_controllers.path_tracking_config import PathTrackingConfig

WHEELBASE_M = 0.5


def straight_path(length_m: float = 2.0, spacing_m: float = 0.05) -> Path:
    n = round(length_m / spacing_m) + 1
    return Path(Waypoint(i, i * spacing_m, Pose2(i * spacing_m, 0.0, 0.0)) for i in range(n))


def arc_path(radius_m: float = 2.0, spacing_m: float = 0.05) -> Path:
    n = 80
    return Path(Waypoint(i, i * spacing_m, Pose2.exp(i * spacing_m, 0.0, i * spacing_m / radius_m)) for i in range(n))


def started(path: Path, start: Pose2 | None = None, **config: object) -> PathTracking4WS:
    controller = PathTracking4WS(PathTrackingConfig.model_validate(config))
    controller.start(Session(mode="replay", path=path, start_pose=start))
    return controller


def drive(
    controller: PathTracking4WS, pose: Pose2, dt_s: float = 0.02, steps: int = 20_000
) -> tuple[list[Pose2], Stop]:
    """Drive the bicycle model with perfect localization until the controller is done."""
    poses = [pose]
    for _ in range(steps):
        command = controller.step(Belief(0.0, pose))
        if isinstance(command, Stop):
            return poses, command
        assert isinstance(command, Steer4WS)
        slip = math.atan((math.tan(command.front_rad) + math.tan(command.rear_rad)) / 2)
        yaw = math.cos(slip) * (math.tan(command.front_rad) - math.tan(command.rear_rad)) / WHEELBASE_M
        v = command.speed_mps
        pose = pose @ Pose2.exp(v * math.cos(slip) * dt_s, v * math.sin(slip) * dt_s, v * yaw * dt_s)
        poses.append(pose)
    raise AssertionError("the controller never finished")


def test_errors_follow_the_cross_product_of_the_paper() -> None:
    path = straight_path()

    lateral_m, heading_rad = path_errors(path, Pose2(0.93, 0.02, 0.1), 20, 1)

    assert lateral_m == pytest.approx(0.02)
    assert heading_rad == pytest.approx(0.1)


def test_errors_keep_the_taught_sense_when_driving_backwards() -> None:
    path = straight_path()

    assert path_errors(path, Pose2(0.93, 0.02, 0.1), 17, -1) == pytest.approx((0.02, 0.1))


def test_steering_uses_the_gains_and_units_of_the_paper() -> None:
    config = PathTrackingConfig()

    front_rad, rear_rad = steering(10 * 3.9e-4, math.radians(1.0), 1, config)

    # 10 px and 1 deg: 0.6 * 10 +- 16 * 1 units, 100 units are 18.3 deg.
    assert math.degrees(front_rad) == pytest.approx(-(6 + 16) * 0.183)
    assert math.degrees(rear_rad) == pytest.approx(-(6 - 16) * 0.183)


def test_steering_never_exceeds_the_limit() -> None:
    front_rad, rear_rad = steering(1.0, 1.0, 1, PathTrackingConfig())

    assert math.degrees(front_rad) == pytest.approx(-18.3)
    assert abs(math.degrees(rear_rad)) <= 18.3 + 1e-12


@pytest.mark.parametrize("start", [Pose2(0.0, 0.02, 0.05), Pose2(0.0, -0.03, -0.1), Pose2(0.1, 0.0, 0.0)])
def test_an_offset_start_converges_onto_the_path(start: Pose2) -> None:
    poses, stop = drive(started(straight_path(), start), start)

    assert stop.done
    assert poses[-1].x == pytest.approx(2.0, abs=0.01)
    assert abs(poses[-1].y) < 0.002
    assert abs(poses[-1].theta) < 0.01


def test_a_curve_is_followed_within_five_millimetres() -> None:
    path = arc_path()

    poses, stop = drive(started(path), Pose2())

    assert stop.done
    assert max(abs(path.locate(pose).lateral_m) for pose in poses[200:]) < 0.005


def test_standing_at_the_end_drives_backwards() -> None:
    start = Pose2(2.0, 0.02, 0.03)

    poses, stop = drive(started(straight_path(), start), start)

    assert stop.done
    assert poses[-1].x == pytest.approx(0.0, abs=0.01)
    assert abs(poses[-1].y) < 0.002


@pytest.mark.parametrize(("repeat", "end_x"), [(0.5, 2.0), (1.0, 0.0), (1.5, 2.0)])
def test_repeat_counts_round_trips(repeat: float, end_x: float) -> None:
    poses, stop = drive(started(straight_path(), repeat=repeat), Pose2())

    assert stop.done
    assert poses[-1].x == pytest.approx(end_x, abs=0.01)


def test_an_unknown_pose_holds_the_robot_without_ending_the_run() -> None:
    command = started(straight_path()).step(Belief(0.0, None))

    assert command == Stop("the pose is not known yet", done=False)


def test_without_a_path_it_refuses_to_start() -> None:
    with pytest.raises(ConfigError, match="follows a taught path"):
        PathTracking4WS(PathTrackingConfig()).start(Session())


@pytest.mark.parametrize(
    ("config", "match"),
    [({"repeat": 0.7}, "in halves"), ({"creep_mps": 1.0}, "faster than"), ({"gain": 1}, "Extra inputs")],
)
def test_impossible_configs_are_refused(config: dict[str, float], match: str) -> None:
    with pytest.raises(ValueError, match=match):
        PathTrackingConfig.model_validate(config)
