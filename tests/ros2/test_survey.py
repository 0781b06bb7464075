"""``trailmark inspect ros2://DOMAIN``: what is on the network."""

from __future__ import annotations

import json
import time

import pytest

pytest.importorskip("cyclonedds", reason="the extra [ros2] is not installed")


from trailmark.cli import main
from trailmark.errors import ConfigError
from trailmark_ros2 import dds
from trailmark_ros2.survey import survey_network


def test_topics_types_quality_and_rates_are_listed_within_two_seconds(domain, robot, messages) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry(), dds.Quality(is_reliable=False))
    robot.send("/map_pose", messages.pose_with_covariance(0.0, 0.0, 0.0), dds.Quality(is_latched=True))
    heard = robot.hear("/cmd_vel", "geometry_msgs/msg/Twist")
    survey_network(str(domain))  # what it imports, it has imported now

    began_s = time.monotonic()
    rows = {row["topic"]: row for row in survey_network(str(domain))}

    assert time.monotonic() - began_s < 6.0  # 1.9 s on an idle machine
    assert set(rows) == {"/odom", "/map_pose", heard.topic}
    assert rows["/odom"]["type"] == "nav_msgs/msg/Odometry"
    assert rows["/odom"]["quality"] == "best effort"
    assert rows["/odom"]["sensor"] == "odometry"
    assert 25.0 < float(rows["/odom"]["rate"].removesuffix(" Hz")) < 75.0
    assert rows["/map_pose"]["quality"] == "reliable, transient local"
    assert rows["/cmd_vel"]["readers"] == "1"


def test_the_command_shows_them(domain, robot, messages, capsys) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry())

    with pytest.raises(SystemExit):
        main(["inspect", f"ros2://{domain}", "--json"])

    assert [row["topic"] for row in json.loads(capsys.readouterr().out)] == ["/odom"]


def test_an_empty_network_is_said(domain, capsys) -> None:
    with pytest.raises(SystemExit):
        main(["inspect", f"ros2://{domain}"])

    assert f"nothing is seen at ros2://{domain}" in capsys.readouterr().out


def test_what_is_no_domain_is_said() -> None:
    with pytest.raises(ConfigError, match="'here' is no domain of ROS"):
        survey_network("here")


def test_a_source_that_reads_no_network_says_so(capsys) -> None:
    with pytest.raises(SystemExit):
        main(["inspect", "camera://0"])

    assert "Camera reads no network" in capsys.readouterr().err
