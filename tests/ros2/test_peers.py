"""Against genuine nodes of rclpy, over Fast DDS; in a process of their own, with the Python of their environment.

``TRAILMARK_ROS2_PEER`` names that Python; `.ci/ros2-peer` makes the environment (264 MB).
"""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="the extra [ros2] is not installed")


from trailmark.pipeline import Pipeline

PEER = os.environ.get("TRAILMARK_ROS2_PEER", "")

pytestmark = [
    pytest.mark.ros2_peer,
    pytest.mark.skipif(not PEER, reason="TRAILMARK_ROS2_PEER names no Python with rclpy; .ci/ros2-peer makes one"),
]

TOPICS = {"wheels": "/odom", "front": "/camera/image_raw", "laser": "/scan"}
RATES_HZ = {"wheels": 50, "front": 30, "laser": 10}


class Peer:
    """A node at work."""

    def __init__(self, domain: int, task: dict[str, Any]) -> None:
        environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "LD_LIBRARY_PATH")}
        environment |= {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        command = [PEER, str(Path(__file__).with_name("rclpy_peer.py")), json.dumps(task)]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment)
        assert self.process.stdout is not None
        assert self.process.stdout.readline().strip() == "ready"

    def said(self) -> Any:
        """End it, and return what it says came."""
        output, _ = self.process.communicate("", timeout=60.0)
        return json.loads(output.strip().splitlines()[-1])


@pytest.fixture
def new_peer(domain: int) -> Iterator[Callable[..., Peer]]:
    peers: list[Peer] = []

    def new(**task: Any) -> Peer:
        peers.append(Peer(domain, task))
        return peers[-1]

    yield new
    for peer in peers:
        peer.process.kill()
        peer.process.wait()


def config_of(domain: int, topics: dict[str, str], **source: Any) -> dict[str, Any]:
    robot = {"plugin": "ros2", "domain": domain, "topics": topics, **source}
    return {
        "sources": {"robot": robot},
        "localizers": {"wheels": {"plugin": "odometry"}},
        "estimator": {"plugin": "kalman"},
        "sinks": [{"plugin": "ros2", "domain": domain}],
    }


def test_sensors_in_and_beliefs_out(domain, new_peer) -> None:
    peer = new_peer(rates_hz=RATES_HZ)
    with Pipeline(config_of(domain, TOPICS)) as pipeline:
        steps = list(itertools.islice(pipeline, 600))  # 6.7 s
        time.sleep(0.2)
        said = peer.said()

    counters = pipeline.result.counters
    for sensor in RATES_HZ:
        stamps_s = [step.frame.stamp_s for step in steps if step.frame.sensor == sensor]
        sent = [stamp_s for stamp_s in said["sent_s"][sensor] if stamps_s[0] - 1e-4 < stamp_s < stamps_s[-1] + 1e-4]
        # All, on an idle machine; of pictures that come too fast for a busy one the run drops the older.
        least = 0.5 if sensor == "front" else 0.95
        assert len(stamps_s) >= least * len(sent), f"{sensor}: {len(stamps_s)} of {len(sent)}"
    assert len(said["ages_s"]) >= 0.95 * counters["frames"]
    assert np.median(said["ages_s"]) < 0.1  # 4 ms on an idle machine
    np.testing.assert_allclose(said["last_pose"][0], steps[-1].belief.pose_map_base.x, atol=0.05)


def test_a_pose_that_is_told_by_rclpy_moves_the_belief(domain, new_peer) -> None:
    new_peer(rates_hz={"wheels": 50}, initial_pose=[30.0, -20.0], tell_after_s=0.5)
    with Pipeline(config_of(domain, {"wheels": "/odom"}, initial_pose="/initialpose")) as pipeline:
        for step in itertools.islice(pipeline, 1500):  # 30 s
            pose = step.belief.pose_map_base
            if pose is not None and pose.y < -10.0:
                break

    assert pose.x == pytest.approx(30.0, abs=2.0)  # it drives on
    assert pose.y == pytest.approx(-20.0, abs=0.1)


def test_a_node_that_dies_and_comes_back_goes_on(domain, new_peer) -> None:
    first = new_peer(rates_hz={"wheels": 50})
    n_after = 0
    with Pipeline(config_of(domain, {"wheels": "/odom"}, silence_s=1.0)) as pipeline:
        died_s = 0.0
        for index, step in enumerate(pipeline):
            if index == 200:  # 4 s: the other has not come so far when it is heard
                first.process.kill()
                first.process.wait()
                died_s = time.time()
                new_peer(rates_hz={"wheels": 50}, best_effort=True)
            n_after += bool(died_s and step.frame.stamp_s > died_s + 0.2)
            if n_after == 20:
                break

    assert pipeline.result.counters["source.robot.restarts.wheels"] == 1


def write_driving_config(path: Path, domain: int) -> Path:
    """Write a config that drives towards a goal far away."""
    config = config_of(domain, {"wheels": "/odom", "place": "/place"}, command="/cmd_vel")
    config["localizers"]["place"] = {"plugin": "pose_fixes"}
    config["start"] = "unknown"  # it has been driving: to begin at the origin, within 1 cm, contradicts every place
    config["controller"] = {"plugin": "goal_seeking", "goal": [1000.0, 0.0], "way": "straight"}
    path.write_text(json.dumps(config))
    return path


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_program_that_is_told_to_go_stops_the_robot(domain, robot, new_peer, tmp_path, wait_for, number) -> None:
    peer = new_peer(rates_hz={"wheels": 50, "place": 10})
    config = write_driving_config(tmp_path / "drive.yaml", domain)
    command = [sys.executable, "-m", "trailmark.cli", "run", str(config), "--out", str(tmp_path / "run"), "--no-report"]
    heard = robot.hear("/cmd_vel", "geometry_msgs/msg/Twist")
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        assert wait_for(lambda: any(twist.linear.x > 0.0 for twist in heard.messages()), 60.0)
        time.sleep(1.0)
        told_s = time.time()
        run.send_signal(number)
        run.wait(30.0)
        ended_s = time.time()
    finally:
        run.kill()
    twists = peer.said()["twists"]

    moving = [stamp_s for stamp_s, speed in twists if speed > 0.0]
    stops = [stamp_s for stamp_s, speed in twists if speed == 0.0 and stamp_s > told_s]
    assert moving, run.stderr.read()
    assert stops, "no zero velocity was heard"
    busy = max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
    assert max(moving) < stops[0] < told_s + 0.3 * busy
    assert ended_s > stops[0]


def test_inspect_finds_a_node_each_time(domain, new_peer) -> None:
    new_peer(rates_hz={"wheels": 50})
    command = [sys.executable, "-m", "trailmark.cli", "inspect", f"ros2://{domain}", "--json"]
    for _ in range(4):  # found within 0.1 to 1.2 s
        rows = json.loads(subprocess.run(command, capture_output=True, check=True, timeout=60.0).stdout)

        (wheels,) = (row for row in rows if row["topic"] == "/odom")
        assert (wheels["type"], wheels["sensor"]) == ("nav_msgs/msg/Odometry", "odometry")
        assert float(wheels["rate"].removesuffix(" Hz")) > 10.0
