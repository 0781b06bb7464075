"""The live source and a robot that dies, is silent, sends what cannot be used, or has another clock."""

from __future__ import annotations

import itertools
import logging
import math
import re
import threading
import time

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="the extra [ros2] is not installed")


from trailmark.errors import SourceError
from trailmark.pipeline import Pipeline
from trailmark_ros2 import dds
from trailmark_ros2.message_types import new_message

GREY = np.random.default_rng(7).integers(0, 255, (48, 64), dtype=np.uint8)


def test_a_robot_that_dies_and_comes_back_goes_on(domain, new_robot, messages, started, caplog) -> None:
    robot = new_robot(domain)
    robot.repeat("/odom", 50.0, lambda k: messages.odometry(0.01 * k))
    source = started(topics={"wheels": "/odom"}, silence_s=0.5)
    frames = source.frames()
    last = next(frames)
    threading.Timer(0.2, robot.die).start()

    def come_back() -> None:
        again = new_robot(domain)
        again.repeat("/odom", 50.0, lambda k: messages.odometry(0.01 * k))

    coming_back = threading.Timer(2.0, come_back)
    coming_back.start()
    with caplog.at_level(logging.WARNING):
        gap_s = 0.0
        while gap_s < 1.0:
            frame = next(frames)
            gap_s, last = frame.stamp_s - last.stamp_s, frame
    coming_back.join()

    assert "/odom is silent for" in caplog.text
    assert "/odom is back after" in caplog.text


def test_a_writer_that_comes_back_as_best_effort_is_read_too(domain, new_robot, messages, started) -> None:
    robot = new_robot(domain)
    robot.repeat("/odom", 50.0, lambda k: messages.odometry(), dds.Quality(is_reliable=True))
    source = started(topics={"wheels": "/odom"}, silence_s=0.5)
    frames = source.frames()
    next(frames)
    robot.die()
    again = new_robot(domain)

    again.repeat("/odom", 50.0, lambda k: messages.odometry(1.0), dds.Quality(is_reliable=False))

    began_s = time.time()
    assert next(frame for frame in frames if frame.stamp_s > began_s).sensor == "wheels"


def test_a_best_effort_writer_that_takes_its_time_is_read_too(domain, new_robot, messages, started) -> None:
    """It comes when the silence has been said already."""
    robot = new_robot(domain)
    robot.repeat("/odom", 50.0, lambda k: messages.odometry(), dds.Quality(is_reliable=True))
    source = started(topics={"wheels": "/odom"}, silence_s=0.3, end_when_silent_s=8.0)
    frames = source.frames()
    next(frames)
    robot.die()
    again = []

    def come_back() -> None:
        again.append(new_robot(domain))
        again[0].repeat("/odom", 50.0, lambda k: messages.odometry(1.0), dds.Quality(is_reliable=False))

    threading.Timer(2.0, come_back).start()

    began_s = time.time() + 1.0
    assert any(frame.stamp_s > began_s for frame in frames)


def test_a_type_that_does_not_fit_is_said_with_both_names(robot, messages, started) -> None:
    robot.repeat("/odom", 20.0, lambda k: messages.odometry())

    with pytest.raises(SourceError, match=r"/odom is sent as nav_msgs/msg/Odometry, .* asks for sensor_msgs/msg/Imu"):
        started(topics={"wheels": {"topic": "/odom", "type": "sensor_msgs/msg/Imu"}})


def test_a_type_that_is_not_understood_is_said(robot, started) -> None:
    robot.repeat("/chatter", 20.0, lambda k: new_message("std_msgs/msg/String", {"data": "hi"}))

    with pytest.raises(SourceError, match="/chatter is sent as std_msgs/msg/String; understood are"):
        started(topics={"wheels": "/chatter"})


def test_a_topic_that_nobody_sends_is_said_with_those_that_are_there(robot, messages, started) -> None:
    robot.repeat("/odom", 20.0, lambda k: messages.odometry())

    with pytest.raises(SourceError, match=r"/odo: nobody sends it \(did you mean /odom\?\)"):
        started(topics={"wheels": "/odo"}, start_timeout_s=1.0)


def test_an_empty_domain_is_said(started) -> None:
    with pytest.raises(SourceError, match=r"nothing at all is seen in ROS domain \d+ on loopback.*\n.*ROS_DOMAIN_ID="):
        started(topics={"wheels": "/odom"}, start_timeout_s=0.5)


def test_what_is_missing_is_said_before_it_is_given_up(started, caplog) -> None:
    with caplog.at_level(logging.WARNING), pytest.raises(SourceError):
        started(topics={"wheels": "/odom"}, silence_s=0.2, start_timeout_s=0.6)

    assert "waiting for the robot: nothing at all is seen" in caplog.text


def test_messages_that_are_broken_are_counted_and_end_nothing(robot, messages, started) -> None:
    robot.repeat("/image_raw", 50.0, lambda k: messages.image(GREY, "mono8"))
    source = started(topics={"front": "/image_raw"})
    wrong = messages.image(GREY, "mono8")
    wrong.height = 4_000_000_000
    robot.send("/image_raw", wrong)
    robot.send("/image_raw", messages.image(GREY, "no_such_encoding"))

    frames = list(itertools.islice(source.frames(), 30))

    assert len(frames) == 30
    assert source.counters()["skipped.front"] == 2


def test_messages_none_of_which_can_be_used_are_not_called_silence(robot, messages, started) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry(stamp_s=0.0))

    with pytest.raises(SourceError, match=r"\d+ messages came, and none could be used: the header's stamp is empty"):
        started(topics={"wheels": "/odom"}, silence_s=2.0, start_timeout_s=1.0)


def test_a_velocity_that_is_no_number_is_not_known(robot, messages, started) -> None:
    def message(k):
        odometry = messages.odometry(0.01 * k)
        odometry.twist.twist.angular.z = math.nan
        return odometry

    robot.repeat("/odom", 50.0, message)
    frame = next(started(topics={"wheels": "/odom"}).frames())

    assert frame.payload.twist is None


def test_stamps_of_another_clock_are_measured_and_told(robot, messages, started, caplog) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry(stamp_s=time.time() + 3.1))
    source = started(topics={"wheels": "/odom"})
    with caplog.at_level(logging.WARNING):
        frames = list(itertools.islice(source.frames(), 20))

    assert frames[-1].stamp_s - time.time() > 2.5
    assert source.counters()["offset_ms.wheels"] == pytest.approx(3100, abs=300)
    assert re.search(r"/odom: header stamps are (3.\d|2.9)\d* s ahead of this machine", caplog.text)


def test_stamps_of_arrival_ignore_the_clock_of_the_sender(robot, messages, started) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry(stamp_s=12.0 + 0.02 * k))

    frame = next(started(topics={"wheels": "/odom"}, stamps="receive").frames())

    assert abs(frame.stamp_s - time.time()) < 2.0


def test_closing_from_another_thread_ends_the_frames(robot, messages, started) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry())
    source = started(topics={"wheels": "/odom"})
    threading.Timer(0.3, source.close).start()

    began_s = time.monotonic()
    list(source.frames())

    assert time.monotonic() - began_s < 10.0


def test_frames_that_waited_when_it_was_closed_do_not_come(robot, messages, started) -> None:
    robot.repeat("/odom", 100.0, lambda k: messages.odometry(0.01 * k))
    source = started(topics={"wheels": "/odom"})
    time.sleep(0.2)  # about 20 messages wait, as on a busy machine
    frames = source.frames()
    next(frames)

    source.close()

    assert list(frames) == []


def test_a_source_ends_on_silence_where_that_is_asked_for(robot, messages, started) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry())
    source = started(topics={"wheels": "/odom"}, end_when_silent_s=1.0)
    threading.Timer(0.3, robot.fall_silent).start()

    assert len(list(source.frames())) > 3


def test_a_pose_that_is_told_moves_the_belief(domain, robot, messages) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry())
    config = {
        "sources": {
            "robot": {"plugin": "ros2", "domain": domain, "topics": {"wheels": "/odom"}, "initial_pose": "/initialpose"}
        },
        "localizers": {"wheels": {"plugin": "odometry"}},
        "estimator": {"plugin": "kalman"},
    }
    with Pipeline(config) as pipeline:
        for step in itertools.islice(pipeline, 500):
            robot.send("/initialpose", messages.pose_with_covariance(3.0, -2.0, 1.0, np.eye(6).ravel() * 0.01))
            pose = step.belief.pose_map_base
            if pose is not None and pose.x > 2.9:
                break

    np.testing.assert_allclose(pose.array(), [3.0, -2.0, 1.0], atol=1e-6)


def test_a_pose_that_is_told_in_another_frame_is_left_alone(robot, messages, started, caplog) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry())
    source = started(topics={"wheels": "/odom"}, initial_pose="/initialpose", map_frame="/map")
    message = messages.pose_with_covariance(3.0, 0.0, 0.0)
    message.header.frame_id = "odom"
    for _ in itertools.islice(source.frames(), 30):
        robot.send("/initialpose", message)

    assert "/initialpose is left alone: it is a pose in 'odom', and the map is '/map' (map_frame of" in caplog.text
    assert caplog.text.count("is left alone") == 1
    assert "is told to be at" not in caplog.text
