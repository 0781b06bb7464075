"""The contract of controllers: among other things, that an ideal robot with a perfect belief arrives."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from trailmark.commands import Command, Steer4WS, Stop, Velocity
from trailmark.config import PluginConfig
from trailmark.estimates import Belief, PathOffset, information_from_sigmas
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import Controller, Session
from trailmark.paths import Path, Waypoint
from trailmark.testing.checks.configs import common_checks
from trailmark.testing.checks.parametrize import Check, parametrize

if TYPE_CHECKING:
    import pytest

__all__ = ["controller_checks", "parametrize_with_controller_checks"]

_WHEELBASE_M = 0.36
_STEP_S = 0.05
_PATIENCE_S = 60.0
_SIGMAS = (0.005, 0.005, 0.005)


def parametrize_with_controller_checks(
    controller: type[Controller],
    *,
    config: PluginConfig,
    path: Path | None = None,
    arrives_within_m: float = 0.3,
    expected_failures: Mapping[str, str] | None = None,
) -> pytest.MarkDecorator:
    """Parametrize a test over the contract of controllers; the test takes ``check`` and calls it.

    Parameters
    ----------
    controller : type
        The class.
    config : PluginConfig
        Its config.
    path : Path, optional
        The taught path; 2.5 m with a gentle bend unless given.
    arrives_within_m : float
        How far from the end of the path an ideal robot with a perfect belief may have stopped [m].
    expected_failures : mapping of str to str
        Checks that it is known not to pass, by name, and why.
    """
    return parametrize(controller_checks(controller, config, path, arrives_within_m), expected_failures)


def controller_checks(
    controller: type[Controller], config: PluginConfig, path: Path | None = None, arrives_within_m: float = 0.3
) -> dict[str, Check]:
    """Return the checks by name; arguments as of `parametrize_with_controller_checks`."""
    taught = _gentle_bend() if path is None else path

    def make() -> Controller:
        return controller(config)

    return common_checks(make, lambda: config) | {
        "gives_commands": lambda: _gives_commands(make),
        "stands_while_lost": lambda: _stands_while_lost(make, taught),
        "arrives_and_says_done": lambda: _arrives(make, taught, arrives_within_m),
        "same_beliefs_same_commands": lambda: _repeats(make, taught),
        "started_again_is_as_new": lambda: _is_as_new(make, taught),
    }


def _gentle_bend(straight_m: float = 1.0, radius_m: float = 2.0, length_m: float = 2.5) -> Path:
    """Return a path that is straight first and then bends to the left, with a waypoint every 5 cm."""
    stations = np.arange(0.0, length_m + 1e-9, 0.05).tolist()
    bends = [max(0.0, station_m - straight_m) for station_m in stations]
    poses = [Pose2(s - bend, 0.0, 0.0) @ Pose2.exp(bend, 0.0, bend / radius_m) for s, bend in zip(stations, bends)]
    return Path(Waypoint(index, stations[index], pose) for index, pose in enumerate(poses))


def _gives_commands(make: Callable[[], Controller]) -> None:
    gives = make().gives
    assert gives, "it gives nothing"
    assert gives <= {Steer4WS, Velocity, Stop}, f"{gives} are not all commands of trailmark.commands"


def _stands_while_lost(make: Callable[[], Controller], path: Path) -> None:
    controller = _start_controller(make, path)
    command = controller.step(Belief(0.0))
    assert isinstance(command, Stop), f"it does not know where it is, and gives {command}"
    assert not command.done, "it does not know where it is, and says that it has arrived"


def _arrives(make: Callable[[], Controller], path: Path, within_m: float) -> None:
    controller = _start_controller(make, path)
    commands, poses = _drive(controller, path)
    last = commands[-1]
    given = {type(command) for command in commands}
    assert given <= controller.gives | {Stop}, f"it gave {given}, and declares {controller.gives}"
    assert isinstance(last, Stop), f"after {_PATIENCE_S:.0f} s it still drives, at {poses[-1]}"
    assert last.done, f"it stopped at {poses[-1]}, not done: {last.reason}"
    off_m = poses[-1].distance_to(path[-1].pose_map_base)
    assert off_m <= within_m, f"it says that it has arrived, {off_m:.2f} m from the end of the path"


def _repeats(make: Callable[[], Controller], path: Path) -> None:
    assert _drive(_start_controller(make, path), path) == _drive(_start_controller(make, path), path), "two runs differ"


def _is_as_new(make: Callable[[], Controller], path: Path) -> None:
    controller = _start_controller(make, path)
    first = _drive(controller, path)
    controller.start(_session(path))
    assert _drive(controller, path) == first, "started again it gives other commands"


def _start_controller(make: Callable[[], Controller], path: Path) -> Controller:
    controller = make()
    controller.start(_session(path))
    return controller


def _session(path: Path) -> Session:
    return Session("controller", "replay", path=path, start_pose=path[0].pose_map_base)


def _drive(controller: Controller, path: Path) -> tuple[list[Command], list[Pose2]]:
    """Drive an ideal robot until it stops for good; return the commands and where they were given."""
    pose, twist, stamp_s, travelled_m = path[0].pose_map_base, Twist2(), 0.0, 0.0
    commands: list[Command] = []
    poses: list[Pose2] = []
    while stamp_s < _PATIENCE_S:
        command = controller.step(_belief(stamp_s, pose, twist, travelled_m, path))
        commands.append(command)
        poses.append(pose)
        if isinstance(command, Stop) and command.done:
            break
        twist = _twist(command)
        assert all(map(math.isfinite, (twist.forward_mps, twist.left_mps, twist.yaw_radps))), f"{command} is not finite"
        pose, stamp_s = pose @ twist.after(_STEP_S), stamp_s + _STEP_S
        travelled_m += math.hypot(twist.forward_mps, twist.left_mps) * _STEP_S
    return commands, poses


def _twist(command: Command) -> Twist2:
    match command:
        case Velocity(forward_mps, left_mps, yaw_radps):
            return Twist2(forward_mps, left_mps, yaw_radps)
        case Steer4WS(front_rad, rear_rad, speed_mps):
            left = (math.tan(front_rad) + math.tan(rear_rad)) / 2
            yaw_radps = speed_mps * (math.tan(front_rad) - math.tan(rear_rad)) / _WHEELBASE_M
            return Twist2(speed_mps, speed_mps * left, yaw_radps)
        case Stop():
            return Twist2()


def _belief(stamp_s: float, pose: Pose2, twist: Twist2, travelled_m: float, path: Path) -> Belief:
    place = path.locate(pose)
    information = information_from_sigmas(*_SIGMAS)
    on_path = PathOffset(stamp_s, place.station_m, place.lateral_m, place.heading_rad, information)
    covariance = np.diag(np.square(_SIGMAS))
    start = path[0].pose_map_base
    return Belief(stamp_s, pose, covariance, start.between(pose), twist, travelled_m, on_path, 0.0, 0.0)
