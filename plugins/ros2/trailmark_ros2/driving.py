"""Commands to a robot of ROS 2, and the watchdog that stops it."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, Literal

from trailmark.clock import live_stamp_s
from trailmark.commands import Command, Steer4WS, Stop, Velocity
from trailmark.errors import ConfigError
from trailmark_ros2.dds import Publisher
from trailmark_ros2.message_types import new_message

__all__ = ["CommandType", "RobotDriver", "accepted_commands", "command_message", "sec_and_nanosec", "stamp_of"]

logger = logging.getLogger(__name__)

CommandType = Literal["twist", "twist_stamped", "ackermann"]

#: Message type of each kind of command topic.
COMMAND_TYPES: Mapping[CommandType, str] = {
    "twist": "geometry_msgs/msg/Twist",
    "twist_stamped": "geometry_msgs/msg/TwistStamped",
    "ackermann": "ackermann_msgs/msg/AckermannDriveStamped",
}

# A stop is sent so often, so far apart: one message may get lost on a best-effort reader.
_N_STOPS = 5
_STOP_EVERY_S = 0.02
_SLOWEST_RAD = 1e-9


def stamp_of(stamp_s: float) -> Any:
    """Return a stamp as ROS has it."""
    sec, nanosec = sec_and_nanosec(stamp_s)
    return new_message("builtin_interfaces/msg/Time", {"sec": sec, "nanosec": nanosec})


def sec_and_nanosec(stamp_s: float) -> tuple[int, int]:
    """Return the two numbers of a stamp as ROS has it, none of them negative."""
    return divmod(max(0, round(stamp_s * 1e9)), 10**9)


def accepted_commands(kind: CommandType, wheelbase_m: float | None) -> frozenset[type[Command]]:
    """Return the commands that can be said in messages of a kind."""
    if kind != "ackermann":
        return frozenset({Velocity, Stop})
    return frozenset({Steer4WS, Stop} | ({Velocity} if wheelbase_m else set()))


def command_message(command: Command, kind: CommandType, wheelbase_m: float | None = None) -> Any:
    """Return a command as a message, stamped now.

    Raises
    ------
    ConfigError
        If it cannot be said in such a message.
    """
    if kind == "ackermann":
        return _ackermann(command, wheelbase_m)
    match command:
        case Velocity(forward_mps, left_mps, yaw_radps):
            pass
        case Stop():
            forward_mps = left_mps = yaw_radps = 0.0
        case _:
            raise ConfigError(f"a Twist cannot say {type(command).__name__}; choose another controller or command_type")
    vector = "geometry_msgs/msg/Vector3"
    linear = new_message(vector, {"x": float(forward_mps), "y": float(left_mps)})
    twist = new_message(
        COMMAND_TYPES["twist"], {"linear": linear, "angular": new_message(vector, {"z": float(yaw_radps)})}
    )
    if kind == "twist":
        return twist
    return new_message(COMMAND_TYPES["twist_stamped"], {"header": _header(), "twist": twist})


def _ackermann(command: Command, wheelbase_m: float | None) -> Any:
    match command:
        case Steer4WS(front_rad, rear_rad, speed_mps):
            if abs(rear_rad) > _SLOWEST_RAD:
                raise ConfigError("an Ackermann vehicle does not steer its rear wheels; choose another controller")
            angle_rad, speed_mps = front_rad, speed_mps
        case Velocity(forward_mps, _, yaw_radps) if wheelbase_m:
            # Curvature of the rear axle's way: tan(angle) = wheelbase * yaw / speed.
            speed_mps = forward_mps
            turn = 0.0 if abs(forward_mps) < _SLOWEST_RAD else wheelbase_m * yaw_radps / forward_mps
            angle_rad = math.atan(turn)
        case Stop():
            angle_rad = speed_mps = 0.0
        case _:
            raise ConfigError(f"an Ackermann message cannot say {type(command).__name__}; say wheelbase_m")
    drive = new_message(
        "ackermann_msgs/msg/AckermannDrive", {"steering_angle": float(angle_rad), "speed": float(speed_mps)}
    )
    return new_message(COMMAND_TYPES["ackermann"], {"header": _header(), "drive": drive})


def _header() -> Any:
    return new_message("std_msgs/msg/Header", {"stamp": stamp_of(live_stamp_s()), "frame_id": "base_link"})


class RobotDriver:
    """Sends commands, and zero velocity when nobody gives any or the robot is silent.

    A stop is sent several times. Once the watchdog has stopped the robot it moves again at the next command, if the
    robot is heard.

    Parameters
    ----------
    publisher : Publisher
        Of the command topic.
    message_of : callable
        Returns a command as a message.
    watchdog_s : float
        How long a command holds without another one, and without a message of the robot [s].
    """

    def __init__(self, publisher: Publisher, message_of: Callable[[Command], Any], watchdog_s: float) -> None:
        self._publisher, self._message_of, self._watchdog_s = publisher, message_of, watchdog_s
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._moves = False
        self._commanded_s = self._heard_s = time.monotonic()
        self._stops_left = 0
        self.n_watchdog_stops = 0
        self._thread = threading.Thread(target=self._watch, name="ros2 watchdog", daemon=True)
        self._thread.start()

    def note_message(self) -> None:
        """Take note that the robot was heard."""
        self._heard_s = time.monotonic()

    def drive(self, command: Command) -> None:
        """Send a command; while the robot is silent it is a stop."""
        message = self._message_of(command)
        with self._lock:
            if self._closed.is_set():
                return
            self._commanded_s = time.monotonic()
            if isinstance(command, Stop):
                self._send_stops_from_now()
            elif not self._is_robot_silent():
                self._moves, self._stops_left = True, 0
                self._publisher.send(message)

    def close(self) -> None:
        """Stop the robot, if it may move, and be sure that it has been told."""
        with self._lock:
            if self._closed.is_set():
                return
            self._closed.set()
            if self._moves or self._stops_left:
                stop = self._message_of(Stop("the run is over"))
                for _ in range(_N_STOPS):
                    self._publisher.send(stop)
                    time.sleep(_STOP_EVERY_S / 4)
                self._publisher.wait_for_acknowledgments(0.2)
        self._thread.join(1.0)

    def _is_robot_silent(self) -> bool:
        return time.monotonic() - self._heard_s > self._watchdog_s

    def _send_stops_from_now(self) -> None:
        self._moves = False
        self._publisher.send(self._message_of(Stop("stop")))
        self._stops_left = _N_STOPS - 1

    def _watch(self) -> None:
        while not self._closed.wait(_STOP_EVERY_S):
            with self._lock:
                if self._closed.is_set():
                    return
                self._watch_once()

    def _watch_once(self) -> None:
        if self._stops_left:
            self._stops_left -= 1
            self._publisher.send(self._message_of(Stop("stop")))
            return
        age_s = time.monotonic() - self._commanded_s
        if not self._moves or (age_s <= self._watchdog_s and not self._is_robot_silent()):
            return
        why = "the robot is silent" if self._is_robot_silent() else f"no command for {age_s:.2f} s"
        logger.warning("the watchdog stops the robot: %s (watchdog_s: %g)", why, self._watchdog_s)
        self.n_watchdog_stops += 1
        self._send_stops_from_now()
