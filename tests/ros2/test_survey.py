"""``trailmark inspect ros2://DOMAIN``: what is on the network."""

from __future__ import annotations

import json
import socket
import sys
import threading
import time

import pytest

pytest.importorskip("cyclonedds", reason="the extra [ros2] is not installed")


from trailmark.cli import main
from trailmark.errors import ConfigError
from trailmark_ros2 import dds
from trailmark_ros2.silence import _domains_of_others, reason_of_emptiness
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


def test_an_empty_network_is_said_with_the_likely_reasons(capsys) -> None:
    domain = 102  # which no other test enters: theirs come around after a hundred
    with pytest.raises(SystemExit) as ended:
        main(["inspect", f"ros2://{domain}"])

    said = capsys.readouterr().err
    assert ended.value.code == 2
    assert f"nothing at all is seen in ROS domain {domain} on loopback" in said
    assert len(said.splitlines()) == 2
    for word in (f"ROS_DOMAIN_ID={domain}", f"ros2://{domain}/eth0", "Cyclone DDS", "rmw_zenoh_cpp"):
        assert word in said


def test_through_a_network_other_reasons_are_likely() -> None:
    said = reason_of_emptiness(0, "wlan0")

    for word in ("through wlan0", "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST", "multicast", "firewall", "rmw_zenoh_cpp"):
        assert word in said


@pytest.mark.skipif(sys.platform != "linux", reason="ports are listed by Linux alone")
def test_a_robot_in_another_domain_is_pointed_at(monkeypatch, tmp_path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as program:
        program.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # two runs of this test at once
        program.bind(("127.0.0.1", 7400 + 250 * 101 + 10))  # as the first program of a domain that no test here opens

        assert 101 in _domains_of_others()
        assert "; in use on this machine: domain " in reason_of_emptiness(3, "loopback")
    monkeypatch.setattr("trailmark_ros2.silence._UDP_PORTS", tmp_path / "none")  # as on other systems
    assert "in use" not in reason_of_emptiness(3, "loopback")


def test_what_is_found_at_the_last_moment_has_no_rate(domain, robot, messages, monkeypatch) -> None:
    monkeypatch.setattr("trailmark_ros2.survey._LEAST_S", 100.0)
    robot.repeat("/odom", 50.0, lambda k: messages.odometry())

    (row,) = survey_network(str(domain))

    assert row["rate"] == "unknown"


def test_what_is_no_domain_is_said() -> None:
    with pytest.raises(ConfigError, match="'here' is no domain of ROS"):
        survey_network("here")


def test_a_source_that_reads_no_network_says_so(capsys) -> None:
    with pytest.raises(SystemExit):
        main(["inspect", "camera://0"])

    assert "Camera reads no network" in capsys.readouterr().err


def test_who_is_found_late_is_listed_too(domain, new_robot, messages) -> None:
    """Fast DDS is found within 0.1 to 1.2 s."""
    late = threading.Timer(1.2, lambda: new_robot(domain).repeat("/odom", 50.0, lambda k: messages.odometry()))
    late.start()

    (row,) = survey_network(str(domain))

    late.join()
    assert row["topic"] == "/odom"
    assert float(row["rate"].removesuffix(" Hz")) > 25.0
