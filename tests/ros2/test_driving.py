"""Commands to the robot, and what stops it."""

from __future__ import annotations

import math
import os
import re
import time

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="the extra [ros2] is not installed")


from trailmark.api import create
from trailmark.commands import Steer4WS, Stop, Velocity
from trailmark.errors import ConfigError, SourceError
from trailmark.frames import Frame
from trailmark.interfaces import Controller, Session
from trailmark.pipeline import LocalizerPart, Parts, Pipeline, SourceStream
from trailmark_ros2 import dds
from trailmark_ros2.driving import accepted_commands, command_message
from trailmark_ros2.message_types import deserialize

TWIST = "geometry_msgs/msg/Twist"
RELIABLE = dds.Quality(depth=1000)


def test_velocities_are_twists() -> None:
    twist = command_message(Velocity(0.5, 0.1, -0.2), "twist")

    assert (twist.linear.x, twist.linear.y, twist.angular.z) == (0.5, 0.1, -0.2)


def test_a_stamped_twist_bears_the_time() -> None:
    stamped = command_message(Velocity(0.5), "twist_stamped")

    assert abs(stamped.header.stamp.sec - time.time()) < 2.0
    assert stamped.twist.linear.x == 0.5


def test_an_ackermann_vehicle_steers_the_way_of_its_rear_axle() -> None:
    """On a circle of radius r the front wheels turn by atan(wheelbase / r)."""
    drive = command_message(Velocity(0.5, 0.0, 0.25), "ackermann", wheelbase_m=0.4).drive

    assert drive.speed == pytest.approx(0.5)
    assert drive.steering_angle == pytest.approx(math.atan(0.4 / 2.0))


def test_an_ackermann_vehicle_that_stands_does_not_turn_on_the_spot() -> None:
    drive = command_message(Velocity(0.0, 0.0, 0.25), "ackermann", wheelbase_m=0.4).drive

    assert (drive.speed, drive.steering_angle) == (0.0, 0.0)


def test_steering_is_said_as_it_is() -> None:
    drive = command_message(Steer4WS(0.2, 0.0, 0.26), "ackermann").drive

    assert (drive.steering_angle, drive.speed) == (0.2, 0.26)


def test_commands_that_cannot_be_said_are_refused() -> None:
    with pytest.raises(ConfigError, match="a Twist cannot say Steer4WS"):
        command_message(Steer4WS(0.1, 0.1, 0.2), "twist")
    with pytest.raises(ConfigError, match="does not steer its rear wheels"):
        command_message(Steer4WS(0.1, 0.1, 0.2), "ackermann")
    with pytest.raises(ConfigError, match="say wheelbase_m"):
        command_message(Velocity(0.1), "ackermann")


def test_what_is_accepted_follows_the_kind_of_command() -> None:
    assert accepted_commands("twist", None) == {Velocity, Stop}
    assert accepted_commands("ackermann", None) == {Steer4WS, Stop}
    assert accepted_commands("ackermann", 0.4) == {Steer4WS, Velocity, Stop}


@pytest.fixture
def driven(domain, robot, messages):
    """Return a started source that drives, and what the robot hears."""
    robot.repeat("/odom", 50.0, lambda k: messages.odometry())
    heard = robot.hear("/cmd_vel", TWIST)
    sources = []

    def start(mode="replay", **keys):
        source = create("source", "ros2", domain=domain, topics={"wheels": "/odom"}, command="/cmd_vel", **keys)
        sources.append(source)
        source.start(Session("robot", mode))
        return source, heard

    yield start
    for source in sources:
        source.close()


def met(heard, wait_for):
    assert wait_for(lambda: heard.n_matched)


def speeds(heard) -> list[float]:
    return [twist.linear.x for twist in heard.messages()]


def test_commands_reach_the_robot(driven, wait_for) -> None:
    source, heard = driven()
    met(heard, wait_for)
    frames = source.frames()
    for _ in range(5):
        next(frames)
        source.drive(Velocity(0.4))

    assert wait_for(lambda: 0.4 in speeds(heard))


def test_a_stop_is_sent_several_times(driven, wait_for) -> None:
    source, heard = driven()
    met(heard, wait_for)

    source.drive(Stop("enough"))
    time.sleep(0.3)

    assert speeds(heard) == [0.0] * 5


def test_a_robot_whose_commands_cease_is_stopped(driven, wait_for) -> None:
    source, heard = driven(watchdog_s=0.2)
    met(heard, wait_for)
    frames = source.frames()
    next(frames)
    source.drive(Velocity(0.4))
    began_s = time.monotonic()
    received = []
    while time.monotonic() - began_s < 0.6:  # frames go on, commands do not
        next(frames)
        received += speeds(heard)

    assert received == [0.4] + [0.0] * 5
    assert source.counters()["watchdog_stops"] == 1


def test_a_robot_that_falls_silent_is_stopped_and_gets_no_more_speed(driven, robot, wait_for) -> None:
    source, heard = driven(watchdog_s=0.2)
    met(heard, wait_for)
    next(source.frames())
    robot.fall_silent()
    for _ in range(20):  # a controller that goes on with what it believes
        source.drive(Velocity(0.4))
        time.sleep(0.03)
    received = speeds(heard)

    assert received[0] == 0.4
    assert received[-1] == 0.0
    assert 0.4 not in received[received.index(0.0) :]


@pytest.mark.parametrize("lost", ["fall_silent", "die"])
def test_zero_velocity_comes_within_three_tenths_of_a_second_of_a_lost_link(driven, robot, wait_for, lost) -> None:
    source, heard = driven()
    commands = heard if lost == "fall_silent" else dds.Network(robot.domain).subscription("/cmd_vel", TWIST, RELIABLE)
    met(commands, wait_for)
    frames = source.frames()
    for _ in range(3):
        next(frames)
        source.drive(Velocity(0.4))
    getattr(robot, lost)()
    lost_s = time.time()
    while time.time() < lost_s + 0.6:  # a controller that goes on with what it believes
        source.drive(Velocity(0.4))
        time.sleep(0.02)

    sent = [(sample.sent_s, deserialize(sample.cdr, TWIST).linear.x) for sample in commands.take(1000)]
    stopped_s = [sent_s for sent_s, speed in sent if speed == 0.0]
    # A machine that is busy may let the thread of the watchdog wait for its turn.
    assert stopped_s[0] - lost_s < 0.3 * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
    assert not [speed for sent_s, speed in sent if sent_s > stopped_s[0] and speed != 0.0]


def test_closing_stops_a_robot_that_moves(driven, wait_for) -> None:
    source, heard = driven()
    met(heard, wait_for)
    next(source.frames())
    source.drive(Velocity(0.4))

    source.close()

    received = wait_for(lambda: speeds(heard))
    assert received[-5:] == [0.0] * 5


def test_while_a_person_teaches_nothing_but_stops_is_sent(driven, wait_for) -> None:
    source, heard = driven(mode="teach")
    met(heard, wait_for)

    source.drive(Velocity(0.4))
    time.sleep(0.5)

    assert source.drives_itself
    assert speeds(heard) == []


def test_without_a_command_topic_nothing_is_ever_sent(domain, robot, messages) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry())
    heard = robot.hear("/cmd_vel", TWIST)
    source = create("source", "ros2", domain=domain, topics={"wheels": "/odom"})
    source.start(Session("robot", "replay"))

    source.drive(Stop("enough"))
    time.sleep(0.3)

    assert source.drives_itself
    assert heard.n_matched == 0
    source.close()


class Creeping(Controller):
    """Always forward."""

    gives = frozenset({Velocity})

    def step(self, belief):
        return Velocity(0.1)


def test_a_part_that_fails_stops_the_robot(domain, robot, messages, wait_for) -> None:
    """However a run ends, zero velocity comes before anything is closed."""
    robot.repeat("/odom", 50.0, lambda k: messages.odometry(0.001 * k))
    heard = robot.hear("/cmd_vel", TWIST)
    source = create("source", "ros2", domain=domain, topics={"wheels": "/odom"}, command="/cmd_vel")

    class Failing(type(create("localizer", "odometry", wheels="wheels"))):
        def observe(self, frame: Frame, belief):
            if 0.1 in np.round(received, 6):
                raise RuntimeError("out of luck")
            received.extend(speeds(heard))
            return super().observe(frame, belief)

    received: list[float] = []
    parts = Parts(
        estimator=create("estimator", "kalman"),
        sources=[SourceStream("robot", source, source.config)],
        localizers=[LocalizerPart("odo", Failing(create("localizer", "odometry", wheels="wheels").config), {"wheels"})],
        controller=Creeping(None),
    )
    with pytest.raises(Exception, match="out of luck"):
        list(Pipeline(parts))

    received += wait_for(lambda: speeds(heard))
    assert received[-5:] == [0.0] * 5


@pytest.mark.parametrize(
    ("read_as", "why"),
    [
        ("geometry_msgs/msg/TwistStamped", "it is read as geometry_msgs/msg/TwistStamped, and sent as geometry_msgs/"),
        (None, r"nobody reads it \(did you mean /cmd_vels\?\); there are /cmd_vels"),
    ],
)
def test_a_command_that_nobody_hears_is_said_with_the_reason(
    domain, robot, messages, wait_for, caplog, read_as, why
) -> None:
    robot.repeat("/odom", 20.0, lambda k: messages.odometry())
    other = robot.hear("/cmd_vel" if read_as else "/cmd_vels", read_as or TWIST)
    source = create("source", "ros2", domain=domain, topics={"wheels": "/odom"}, command="/cmd_vel", silence_s=0.4)
    source.start(Session("robot", "replay"))

    def is_said() -> bool:
        next(frames)
        return "hears no command" in caplog.text

    try:
        frames = source.frames()
        assert wait_for(is_said)
        heard = robot.hear("/cmd_vel", TWIST)
        assert wait_for(lambda: next(frames) and "/cmd_vel is read now" in caplog.text)
        source.drive(Velocity(0.2))
        assert wait_for(lambda: speeds(heard))
    finally:
        source.close()

    assert re.search(f"the robot hears no command on /cmd_vel: {why}", caplog.text)
    assert caplog.text.count("hears no command") == 1
    assert not other.messages()


def test_while_a_person_teaches_nobody_need_hear_commands(domain, robot, messages, caplog) -> None:
    robot.repeat("/odom", 20.0, lambda k: messages.odometry())
    source = create("source", "ros2", domain=domain, topics={"wheels": "/odom"}, command="/cmd_vel", silence_s=0.2)
    source.start(Session("robot", "teach"))
    until_s = time.monotonic() + 1.2

    for _ in source.frames():
        if time.monotonic() > until_s:
            break
    source.close()

    assert "hears no command" not in caplog.text


def test_a_robot_whose_time_went_back_is_stopped_and_the_run_ends(driven, robot, messages, wait_for) -> None:
    source, heard = driven(watchdog_s=0.3)
    met(heard, wait_for)
    frames = source.frames()
    for _ in range(3):
        next(frames)
        source.drive(Velocity(0.4))
    robot.fall_silent()
    robot.repeat("/odom", 50.0, lambda k: messages.odometry(stamp_s=1.0 + k / 50.0))  # a simulation that was reset

    with pytest.raises(SourceError, match=r"the stamps of /odom went back by \d+\.\d s: was the simulation reset"):
        list(frames)
    source.close()

    received = speeds(heard)
    assert received[-1] == 0.0
    assert source.counters()["went_back.wheels"] > 0


def test_another_program_that_sends_commands_is_said(driven, robot, wait_for, caplog) -> None:
    source, heard = driven()
    met(heard, wait_for)
    frames = source.frames()
    next(frames)
    robot.send("/cmd_vel", command_message(Velocity(0.1), "twist"))

    assert wait_for(lambda: next(frames) and "is sent by another program too" in caplog.text)
    assert caplog.text.count("/cmd_vel is sent by another program too: the robot follows whoever spoke last") == 1
