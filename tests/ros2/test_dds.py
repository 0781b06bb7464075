"""The layer on cyclonedds: bytes as they are, who is there, and the private calls that it leans on."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="the extra [ros2] is not installed")


from trailmark.errors import ConfigError
from trailmark_ros2 import dds
from trailmark_ros2.message_types import dds_type_name, deserialize, idl_type, new_message, ros_type_name, serialize

ODOMETRY = "nav_msgs/msg/Odometry"


def test_a_picture_comes_as_it_was_sent(domain, robot, messages, wait_for) -> None:
    own = dds.Network(domain)
    subscription = own.subscription("/front", "sensor_msgs/msg/Image", dds.Quality(is_reliable=False))
    picture = np.random.default_rng(7).integers(0, 255, (480, 640), dtype=np.uint8)
    robot.send("/front", messages.image(picture, "mono8"))
    assert wait_for(lambda: subscription.n_matched)

    robot.send("/front", messages.image(picture, "mono8"))
    taken = wait_for(subscription.take)

    message = deserialize(taken[-1].cdr, "sensor_msgs/msg/Image")
    assert np.array_equal(message.data.reshape(480, 640), picture)
    own.close()


def test_taking_a_picture_costs_less_than_a_millisecond(domain, robot, messages, wait_for) -> None:
    """Through the Python deserialiser of cyclonedds it costs 20 ms: this fails when bytes go that way."""
    own = dds.Network(domain)
    subscription = own.subscription("/front", "sensor_msgs/msg/Image", dds.Quality(depth=10))
    message = messages.image(np.zeros((480, 640), np.uint8), "mono8")
    robot.send("/front", message)
    assert wait_for(lambda: subscription.n_matched)
    costs_ms = []
    for _ in range(10):
        robot.send("/front", message)
        time.sleep(0.02)
        began_s = time.thread_time()
        for sample in subscription.take():
            deserialize(sample.cdr, "sensor_msgs/msg/Image")
        costs_ms.append(1e3 * (time.thread_time() - began_s))

    assert np.median(costs_ms) < 5.0  # 0.3 ms on an idle machine
    own.close()


def test_a_late_reader_gets_what_is_latched(domain, robot, messages, wait_for) -> None:
    latched = dds.Quality(is_reliable=True, is_latched=True)
    robot.send("/map_pose", messages.pose_with_covariance(1.0, 2.0, 0.5), latched)
    own = dds.Network(domain)
    subscription = own.subscription("/map_pose", "geometry_msgs/msg/PoseWithCovarianceStamped", latched)

    (message,) = wait_for(subscription.messages)

    assert message.pose.pose.position.y == 2.0
    own.close()


def test_bytes_that_are_no_message_are_left_out_with_a_word(domain, robot, messages, wait_for, caplog) -> None:
    name = "geometry_msgs/msg/PoseWithCovarianceStamped"
    heard = robot.hear("/initialpose", name)
    publisher = dds.Network(domain).publisher("/initialpose", name, dds.Quality())
    wait_for(lambda: publisher.n_matched)
    cdr = serialize(messages.pose_with_covariance(1.0, 2.0, 0.5))
    for frame_id in (b"\xff\xfe\xfd", b"\x80\x80\x80"):  # DDS looks at lengths, not at letters
        publisher.send_bytes(cdr.replace(b"map", frame_id))
    publisher.send_bytes(cdr)

    found = wait_for(heard.messages)

    assert [message.pose.pose.position.x for message in found] == [1.0]
    assert caplog.text.count("/initialpose: a message cannot be read and is left out") == 1


def test_who_is_there_is_seen_with_type_and_quality(domain, robot, messages, wait_for) -> None:
    own = dds.Network(domain)
    robot.send("/odom", messages.odometry(), dds.Quality(is_reliable=False))
    heard = robot.hear("/cmd_vel", "geometry_msgs/msg/Twist")

    (writer,) = wait_for(own.writers)
    (reader,) = wait_for(own.readers)

    assert (writer.topic, writer.type_name, str(writer.quality)) == ("/odom", ODOMETRY, "best effort")
    assert (reader.topic, reader.type_name) == (heard.topic, "geometry_msgs/msg/Twist")
    assert not own.is_own(writer)
    own.close()


def test_who_has_left_is_seen_no_more(domain, new_robot, messages, wait_for) -> None:
    own, robot = dds.Network(domain), new_robot(domain)
    robot.send("/odom", messages.odometry())
    assert wait_for(own.writers)

    robot.die()

    assert wait_for(lambda: not own.writers())
    own.close()


def test_policies_that_do_not_fit_are_named(domain, robot, messages, wait_for) -> None:
    own = dds.Network(domain)
    robot.send("/odom", messages.odometry(), dds.Quality(is_reliable=False))
    reliable = own.subscription("/odom", ODOMETRY, dds.Quality())

    assert wait_for(lambda: reliable.refused_policy) == "reliability"
    own.close()


def test_a_domain_has_one_interface(domain) -> None:
    own = dds.Network(domain)

    with pytest.raises(ConfigError, match=f"domain {domain} is open on interface 'loopback' already"):
        dds.Network(domain, "lo")
    own.close()


def test_an_interface_that_is_not_there_is_named(domain) -> None:
    with pytest.raises(ConfigError, match="no_such_card"):
        dds.Network(domain, "no_such_card")


@pytest.mark.parametrize(
    "name", [ODOMETRY, "sensor_msgs/msg/CameraInfo", "tf2_msgs/msg/TFMessage", "nav_msgs/msg/Path"]
)
def test_types_are_called_as_ros_calls_them(name) -> None:
    package, kind, bare = name.split("/")

    assert idl_type(name).__idl__.idl_transformed_typename == f"{package}::{kind}::dds_::{bare}_"
    assert ros_type_name(dds_type_name(name)) == name


def test_a_blank_message_survives_its_bytes() -> None:
    for name in (ODOMETRY, "ackermann_msgs/msg/AckermannDriveStamped", "diagnostic_msgs/msg/DiagnosticArray"):
        message = new_message(name, {})
        assert serialize(deserialize(serialize(message), name)) == serialize(message)


def test_the_domain_of_ros_is_honoured(monkeypatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    assert dds.default_domain() == 42

    monkeypatch.delenv("ROS_DOMAIN_ID")
    assert dds.default_domain() == 0


def test_waiting_for_a_reader_that_hangs_ends(domain, messages, wait_for) -> None:
    """cyclonedds raises an AttributeError of its own where the time is up."""
    code = (
        "import sys, time\n"
        "from trailmark_ros2 import dds\n"
        f"network = dds.Network({domain})\n"
        f"subscription = network.subscription('/odom', {ODOMETRY!r}, dds.Quality())\n"
        "print('ready', flush=True)\n"
        "time.sleep(60.0)\n"
    )
    reader = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    own = dds.Network(domain)
    try:
        assert reader.stdout.readline() == "ready\n"
        publisher = own.publisher("/odom", ODOMETRY, dds.Quality())
        assert wait_for(lambda: publisher.n_matched)
        reader.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, reader.pid, os.WSTOPPED)  # a signal is not yet a stop: it could still acknowledge

        publisher.send(messages.odometry())

        assert publisher.wait_for_acknowledgments(0.1) is False
        reader.send_signal(signal.SIGCONT)
        assert publisher.wait_for_acknowledgments(10.0)
    finally:
        reader.kill()
        reader.communicate()
        own.close()
