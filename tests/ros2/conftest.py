"""A robot of ROS 2 to test against: a participant of its own, on a private domain and on loopback."""

from __future__ import annotations

import itertools
import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from trailmark.api import create
from trailmark.interfaces import Session

try:
    from trailmark_ros2 import dds
    from trailmark_ros2.driving import stamp_of
    from trailmark_ros2.message_types import new_message
except ModuleNotFoundError:  # without the extra every module here skips itself, with the reason
    pass

_numbers = itertools.count()


@pytest.fixture
def domain() -> int:
    """Return a domain that no other test uses at the time."""
    return 1 + (13 * os.getpid() + next(_numbers)) % 100


class Robot:
    """Sends what a robot sends."""

    def __init__(self, domain: int) -> None:
        self.domain = domain
        self.network = dds.Network(domain)
        self._publishers: dict[str, dds.Publisher] = {}
        self._stop = threading.Event()
        self._threads: list[threading.Thread] = []
        self._error: BaseException | None = None

    def send(self, topic: str, message: Any, quality: dds.Quality | None = None) -> None:
        """Send a message; the topic is made at the first."""
        if topic not in self._publishers:
            self._publishers[topic] = self.network.publisher(topic, message.__msgtype__, quality or dds.Quality())
        self._publishers[topic].send(message)

    def repeat(
        self, topic: str, rate_hz: float, message_of: Callable[[int], Any], quality: dds.Quality | None = None
    ) -> None:
        """Send messages at a rate, from a thread, until the test ends."""
        self.send(topic, message_of(0), quality)

        def work() -> None:
            began_s = time.monotonic()
            k = 1
            while not self._stop.wait(max(0.0, began_s + k / rate_hz - time.monotonic())):
                self.send(topic, message_of(k))
                k += 1

        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        self._threads.append(thread)  # not before: the test may end while a timer of its own comes here

    def hear(self, topic: str, type_name: str, quality: dds.Quality | None = None) -> dds.Subscription:
        """Return a subscription of the robot's side."""
        return self.network.subscription(topic, type_name, quality or dds.Quality(depth=1000))

    def fall_silent(self) -> None:
        """Stop sending, but stay."""
        self._stop.set()
        for thread in self._threads:
            thread.join(5.0)
        self._stop, self._threads = threading.Event(), []

    def die(self) -> None:
        """Leave the network."""
        self.fall_silent()
        self._publishers.clear()
        self.network.close()


@pytest.fixture
def new_robot() -> Iterator[Callable[[int], Robot]]:
    """Return what makes robots on a domain; they leave when the test ends."""
    robots: list[Robot] = []

    def new(domain: int) -> Robot:
        robots.append(Robot(domain))
        return robots[-1]

    yield new
    for robot in robots:
        robot.die()


@pytest.fixture
def robot(domain: int, new_robot: Callable[[int], Robot]) -> Robot:
    """Return a robot on the test's domain."""
    return new_robot(domain)


@pytest.fixture
def started(domain: int) -> Iterator[Callable[..., Any]]:
    """Return what starts sources on the test's domain; they are closed when the test ends."""
    sources: list[Any] = []

    def start(*, mode: str = "track", session: Session | None = None, **keys: Any) -> Any:
        source = create("source", "ros2", domain=domain, **keys)
        sources.append(source)
        source.start(session or Session("robot", mode))
        return source

    yield start
    for source in sources:
        source.close()


class Messages:
    """Makes messages."""

    @staticmethod
    def header(stamp_s: float | None = None, frame_id: str = "base_link") -> Any:
        stamp = stamp_of(time.time() if stamp_s is None else stamp_s)
        return new_message("std_msgs/msg/Header", {"stamp": stamp, "frame_id": frame_id})

    @staticmethod
    def pose(x: float = 0.0, y: float = 0.0, theta: float = 0.0) -> Any:
        point = new_message("geometry_msgs/msg/Point", {"x": x, "y": y})
        turn = new_message("geometry_msgs/msg/Quaternion", {"z": math.sin(theta / 2), "w": math.cos(theta / 2)})
        return new_message("geometry_msgs/msg/Pose", {"position": point, "orientation": turn})

    @classmethod
    def odometry(cls, x: float = 0.0, y: float = 0.0, theta: float = 0.0, *, stamp_s: float | None = None) -> Any:
        pose = new_message("geometry_msgs/msg/PoseWithCovariance", {"pose": cls.pose(x, y, theta)})
        head = cls.header(stamp_s, "odom")
        return new_message("nav_msgs/msg/Odometry", {"header": head, "child_frame_id": "base_link", "pose": pose})

    @classmethod
    def image(cls, pixels: np.ndarray, encoding: str, *, stamp_s: float | None = None, frame_id: str = "cam") -> Any:
        height, width = pixels.shape[:2]
        step = pixels.nbytes // height
        fields = {"height": height, "width": width, "encoding": encoding, "step": step}
        data = np.ascontiguousarray(pixels).view(np.uint8).ravel()
        return new_message("sensor_msgs/msg/Image", {"header": cls.header(stamp_s, frame_id), "data": data, **fields})

    @classmethod
    def pose_with_covariance(cls, x: float, y: float, theta: float, covariance: np.ndarray | None = None) -> Any:
        fields: dict[str, Any] = {"pose": cls.pose(x, y, theta)}
        if covariance is not None:
            fields["covariance"] = covariance
        pose = new_message("geometry_msgs/msg/PoseWithCovariance", fields)
        head = cls.header(frame_id="map")
        return new_message("geometry_msgs/msg/PoseWithCovarianceStamped", {"header": head, "pose": pose})


@pytest.fixture
def messages() -> type[Messages]:
    """Return what makes messages."""
    return Messages


def wait_for(holds: Callable[[], Any], timeout_s: float = 10.0) -> Any:
    """Return what becomes true, or the last answer when the time is up."""
    deadline_s = time.monotonic() + timeout_s
    while not (answer := holds()) and time.monotonic() < deadline_s:
        time.sleep(0.01)
    return answer


@pytest.fixture(name="wait_for")
def wait_for_fixture() -> Callable[..., Any]:
    """Return what waits."""
    return wait_for
