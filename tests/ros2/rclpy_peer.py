"""A robot of rclpy, run by the Python of its own environment: sends sensors, hears beliefs, says what came.

Reads its task as JSON from the first argument, prints ``ready``, works until its input ends, and prints one JSON line.
"""

from __future__ import annotations

import array
import json
import sys
import threading
import time
from pathlib import Path

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage, Image, LaserScan

TASK = json.loads(sys.argv[1])
SPEED_MPS = 0.4


class Robot:
    """Drives straight on at `SPEED_MPS`, or as it is told."""

    def __init__(self) -> None:
        self.node = rclpy.create_node("peer")
        self.sent_s: dict[str, list[float]] = {}
        self.ages_s: list[float] = []
        self.last_pose: list[float] = []
        self.twists: list[tuple[float, float]] = []
        self.began_s = time.time()
        depth = QoSProfile(depth=10)
        if TASK.get("best_effort"):
            depth.reliability = ReliabilityPolicy.BEST_EFFORT
        self.publishers = {
            "wheels": self.node.create_publisher(Odometry, "/odom", depth),
            "front": self.node.create_publisher(Image, "/camera/image_raw", qos_profile_sensor_data),
            "laser": self.node.create_publisher(LaserScan, "/scan", qos_profile_sensor_data),
            "colour": self.node.create_publisher(CompressedImage, "/camera/compressed", qos_profile_sensor_data),
            "place": self.node.create_publisher(PoseWithCovarianceStamped, "/place", depth),
        }
        self.told = self.node.create_publisher(PoseWithCovarianceStamped, "/initialpose", QoSProfile(depth=10))
        self.node.create_subscription(Odometry, "/trailmark/odometry", self.on_belief, QoSProfile(depth=50))
        self.node.create_subscription(Twist, "/cmd_vel", self.on_twist, QoSProfile(depth=50))
        self.makers = {"wheels": self.odometry, "front": self.image, "laser": self.scan, "colour": self.colour}
        self.makers["place"] = self.place
        self.pixels = array.array("B", bytes(range(256)) * (640 * 480 // 256))
        self.jpeg = array.array("B", Path(TASK["jpeg"]).read_bytes()) if "jpeg" in TASK else None

    def on_belief(self, message: Odometry) -> None:
        stamp = message.header.stamp
        self.ages_s.append(time.time() - stamp.sec - stamp.nanosec / 1e9)
        position = message.pose.pose.position
        self.last_pose = [position.x, position.y]

    def on_twist(self, message: Twist) -> None:
        self.twists.append((time.time(), message.linear.x))

    def stamp(self, message: object, frame_id: str, now_s: float) -> object:
        message.header.stamp.sec = int(now_s)
        message.header.stamp.nanosec = int(now_s % 1.0 * 1e9)
        message.header.frame_id = frame_id
        return message

    def odometry(self, now_s: float) -> object:
        message = self.stamp(Odometry(), "odom", now_s)
        message.child_frame_id = "base_link"
        message.pose.pose.position.x = SPEED_MPS * (now_s - self.began_s)
        message.twist.twist.linear.x = SPEED_MPS
        return message

    def place(self, now_s: float) -> object:
        message = self.stamp(PoseWithCovarianceStamped(), "map", now_s)
        message.pose.pose.position.x = SPEED_MPS * (now_s - self.began_s)
        message.pose.pose.orientation.w = 1.0
        message.pose.covariance[0] = message.pose.covariance[7] = message.pose.covariance[35] = 0.01
        return message

    def image(self, now_s: float) -> object:
        message = self.stamp(Image(), "camera", now_s)
        message.height, message.width, message.step, message.encoding = 480, 640, 640, "mono8"
        message.data = self.pixels
        return message

    def scan(self, now_s: float) -> object:
        message = self.stamp(LaserScan(), "laser", now_s)
        message.angle_min, message.angle_increment, message.range_max = -1.57, 0.0087, 30.0
        message.ranges = array.array("f", [2.0] * 360)
        return message

    def colour(self, now_s: float) -> object:
        message = self.stamp(CompressedImage(), "camera", now_s)
        message.format, message.data = "jpeg", self.jpeg
        return message

    def send_for_ever(self, sensor: str, rate_hz: float, stop: threading.Event) -> None:
        began_s, k = time.monotonic(), 0
        while not stop.wait(max(0.0, began_s + k / rate_hz - time.monotonic())):
            now_s = time.time()
            self.sent_s.setdefault(sensor, []).append(now_s)
            self.publishers[sensor].publish(self.makers[sensor](now_s))
            k += 1

    def tell_pose(self) -> None:
        message = self.stamp(PoseWithCovarianceStamped(), "map", time.time())
        message.pose.pose.position.x, message.pose.pose.position.y = TASK["initial_pose"]
        message.pose.pose.orientation.w = 1.0
        message.pose.covariance[0] = message.pose.covariance[7] = message.pose.covariance[35] = 0.01
        self.told.publish(message)


def main() -> None:
    rclpy.init()
    robot, stop = Robot(), threading.Event()
    threads = [
        threading.Thread(target=robot.send_for_ever, args=(sensor, rate_hz, stop), daemon=True)
        for sensor, rate_hz in TASK["rates_hz"].items()
    ]
    for thread in threads:
        thread.start()
    print("ready", flush=True)
    executor = SingleThreadedExecutor()
    executor.add_node(robot.node)
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    tell_s = time.monotonic() + TASK.get("tell_after_s", 1e9)
    while not ended.is_set():
        executor.spin_once(timeout_sec=0.05)
        if time.monotonic() > tell_s:
            robot.tell_pose()
            tell_s = time.monotonic() + 0.5
    stop.set()
    for thread in threads:
        thread.join()
    said = {"sent_s": robot.sent_s, "ages_s": robot.ages_s, "last_pose": robot.last_pose, "twists": robot.twists}
    print(json.dumps(said), flush=True)


main()
