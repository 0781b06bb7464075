"""Live ROS 2 in numbers: what arrives, how old beliefs are when they are back, what a picture costs.

A node of rclpy, in an environment of its own, sends sensors and hears beliefs (`tests/ros2/rclpy_peer.py`); a run of
Trailmark localizes by the wheels, and gets the pictures and scans.
``python benchmarks/ros2.py --peer PYTHON [--seconds 60]``
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from trailmark.pipeline import Pipeline

ROOT = Path(__file__).parents[1]
TYPES = {
    "wheels": "Odometry",
    "front": "Image 640x480 mono8",
    "laser": "LaserScan 360",
    "colour": "CompressedImage 1280x720",
}
TOPICS = {"wheels": "/odom", "front": "/camera/image_raw", "laser": "/scan"}
#: Topics and rates of each scene.
SCENES = {
    "sensors": (TOPICS, {"wheels": 50, "front": 30, "laser": 10}),
    "colour": ({"wheels": "/odom", "colour": "/camera/compressed"}, {"wheels": 50, "colour": 15}),
    "wheels": ({"wheels": "/odom"}, {"wheels": 50}),
}

TEXT = """`python benchmarks/ros2.py --seconds {seconds:.0f}`, commit {commit}: one run each. The load of
the machine was {load[0]:.1f} when the measurement began and {load[1]:.1f} when it ended, for {cores} cores. Ages and
shares are those of such a machine.

| scene | message | Hz | received since the match | share | late or dropped in the run |
|---|---|---|---|---|---|
{arrived}

| scene | beliefs heard by rclpy | age: median [ms] | 95 % [ms] | 99 % [ms] |
|---|---|---|---|---|
{ages}

| scene | CPU of the whole run, per second [ms] | of it, threads that bring messages in (DDS, source) |
|---|---|---|
{cpu}

A picture or scan in costs {in_ms:.2f} ms of CPU in those threads (bar: 1 ms), and {picture_ms:.2f} ms with the belief
that goes back for it: the differences of the scenes `sensors` and `wheels`, per picture and scan.
"""


def colour_jpeg(folder: Path) -> Path:
    """Write a colour picture of 1280 x 720 with the detail of a scene, and return its file."""
    rng = np.random.default_rng(7)
    small = rng.integers(0, 255, (90, 160, 3), dtype=np.uint8)
    picture = cv2.resize(small, (1280, 720), interpolation=cv2.INTER_CUBIC)
    path = folder / "colour.jpg"
    cv2.imwrite(str(path), picture, [cv2.IMWRITE_JPEG_QUALITY, 80])
    return path


def play(scene: str, seconds: float, peer: str, folder: Path, domain: int) -> dict[str, Any]:
    """Run a scene and return what was sent, what came, ages and CPU time."""
    topics, rates_hz = SCENES[scene]
    task = {"rates_hz": rates_hz, "jpeg": str(colour_jpeg(folder))}
    environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "LD_LIBRARY_PATH")}
    environment |= {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    command = [peer, str(ROOT / "tests" / "ros2" / "rclpy_peer.py"), json.dumps(task)]
    node = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)
    assert node.stdout is not None
    node.stdout.readline()
    config = {
        "sources": {"robot": {"plugin": "ros2", "domain": domain, "topics": topics}},
        "localizers": {"wheels": {"plugin": "odometry"}},
        "estimator": {"plugin": "kalman"},
        "sinks": [{"plugin": "ros2", "domain": domain}],
    }
    stamps_s: dict[str, list[float]] = {}
    with Pipeline(config) as pipeline:
        began_s, began_cpu_s, began_main_s = time.monotonic(), time.process_time(), time.thread_time()
        for step in pipeline:
            if step.frame is not None:
                stamps_s.setdefault(step.frame.sensor, []).append(step.frame.stamp_s)
            if time.monotonic() - began_s > seconds:
                break
        cpu_s, wall_s = time.process_time() - began_cpu_s, time.monotonic() - began_s
        in_s = cpu_s - (time.thread_time() - began_main_s)  # this thread localizes and sends; the others bring in
        said = json.loads(node.communicate("", timeout=60.0)[0].strip().splitlines()[-1])
    cpu_ms = {"whole": 1e3 * cpu_s / wall_s, "in": 1e3 * in_s / wall_s}
    return {"said": said, "stamps_s": stamps_s, "cpu_ms": cpu_ms, "counters": pipeline.result.counters}


def rows_of(scene: str, played: dict[str, Any]) -> list[str]:
    """Return the rows of the table of what arrived."""
    rows = []
    for sensor, stamps_s in played["stamps_s"].items():
        sent = [s for s in played["said"]["sent_s"][sensor] if stamps_s[0] - 1e-4 < s < stamps_s[-1] + 1e-4]
        late = played["counters"].get("source.robot.late", 0) + played["counters"].get("source.robot.dropped", 0)
        share = 100.0 * len(stamps_s) / len(sent)
        rate_hz, counts = SCENES[scene][1][sensor], f"{len(stamps_s)} / {len(sent)}"
        rows.append(f"| {scene} | {TYPES[sensor]} | {rate_hz} | {counts} | {share:.2f} % | {late} |")
    return rows


def main() -> None:
    """Play all scenes, and print what docs/results/ros2.md shows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peer", default=os.environ.get("TRAILMARK_ROS2_PEER"), help="Python with rclpy")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--domain", type=int, default=77)
    arguments = parser.parse_args()
    if not arguments.peer:
        parser.error("name a Python with rclpy: --peer, or TRAILMARK_ROS2_PEER")
    load_before = os.getloadavg()[0]
    arrived, ages = [], []
    cpu_ms: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for index, scene in enumerate(SCENES):
            played = play(scene, arguments.seconds, arguments.peer, Path(folder), arguments.domain + index)
            arrived += rows_of(scene, played)
            age_ms = 1e3 * np.array(played["said"]["ages_s"])
            n_frames = sum(len(stamps) for stamps in played["stamps_s"].values())
            median, p95, p99 = np.quantile(age_ms, [0.5, 0.95, 0.99])
            ages.append(f"| {scene} | {len(age_ms)} of {n_frames} | {median:.1f} | {p95:.1f} | {p99:.1f} |")
            cpu_ms[scene] = played["cpu_ms"]
    rates_hz = SCENES["sensors"][1]
    n = rates_hz["front"] + rates_hz["laser"]
    picture_ms, in_ms = ((cpu_ms["sensors"][part] - cpu_ms["wheels"][part]) / n for part in ("whole", "in"))
    cpu = [f"| {scene} | {value['whole']:.0f} | {value['in']:.0f} |" for scene, value in cpu_ms.items()]
    git = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()
    text = TEXT.format(
        seconds=arguments.seconds,
        commit=commit or "unknown",
        cores=os.cpu_count(),
        load=(load_before, os.getloadavg()[0]),
        arrived="\n".join(arrived),
        ages="\n".join(ages),
        cpu="\n".join(cpu),
        picture_ms=picture_ms,
        in_ms=in_ms,
    )
    print(text)


if __name__ == "__main__":
    main()
