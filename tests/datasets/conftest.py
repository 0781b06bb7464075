"""Tiny recordings, and a way to play them."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from trailmark.frames import Frame
from trailmark.geometry import Pose3
from trailmark.interfaces import FrameSource, Session


@pytest.fixture
def write_picture() -> Callable[..., Path]:
    """Write a picture whose pixels all have one value, so that a test knows it again."""

    def write(
        path: Path, value: int = 7, size: tuple[int, int] = (12, 8), colour: bool = False, dtype: type = np.uint8
    ) -> Path:
        shape = (size[1], size[0], 3) if colour else (size[1], size[0])
        path.parent.mkdir(parents=True, exist_ok=True)
        assert cv2.imwrite(str(path), np.full(shape, value, dtype))
        return path

    return write


@pytest.fixture
def play() -> Callable[..., list[Frame]]:
    """Start a source under a name and return its frames."""

    def played(source: FrameSource, name: str = "front") -> list[Frame]:
        source.start(Session(name=name))
        return list(source.frames())

    return played


class Recording:
    """Collects messages of ROS and writes them as a tiny recording.

    Parameters
    ----------
    kind : str
        ``ros1``, ``sqlite`` or ``mcap``.
    """

    def __init__(self, kind: str = "ros1") -> None:
        self.kind = kind
        self.store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
        if kind == "ros1":  # rosbags brings no transforms of ROS 1; a bag brings its own definitions
            self.store.register(
                get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
            )
        self.types = self.store.types
        self.messages: list[tuple[str, float, Any]] = []

    def add(self, topic: str, message: Any, receive_s: float) -> None:
        self.messages.append((topic, receive_s, message))

    def write(self, folder: Path) -> Path:
        """Write and return the path that a config names."""
        path = folder / ("a.bag" if self.kind == "ros1" else f"a_{self.kind}")
        writer: Any
        if self.kind == "ros1":
            writer = Writer1(path)
        else:
            plugin = StoragePlugin.MCAP if self.kind == "mcap" else StoragePlugin.SQLITE3
            writer = Writer2(path, version=9, storage_plugin=plugin)
        serialize = self.store.serialize_ros1 if self.kind == "ros1" else self.store.serialize_cdr
        connections: dict[str, Any] = {}
        with writer:
            for topic, receive_s, message in self.messages:
                name = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, name, typestore=self.store)
                writer.write(connections[topic], round(receive_s * 1e9), serialize(message, name))
        return next(path.glob("*.mcap")) if self.kind == "mcap" else path

    def header(self, stamp_s: float, frame_id: str = "") -> Any:
        sec = math.floor(stamp_s)
        stamp = self.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=round((stamp_s - sec) * 1e9))
        extra = {"seq": 0} if self.kind == "ros1" else {}
        return self.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id, **extra)

    def image(
        self, stamp_s: float, data: np.ndarray, encoding: str, frame_id: str = "", padding: int = 0, big: bool = False
    ) -> Any:
        rows = np.ascontiguousarray(data).view(np.uint8).reshape(data.shape[0], -1)
        rows = np.pad(rows, ((0, 0), (0, padding)))
        return self.types["sensor_msgs/msg/Image"](
            header=self.header(stamp_s, frame_id),
            height=data.shape[0],
            width=data.shape[1],
            encoding=encoding,
            is_bigendian=int(big),
            step=rows.shape[1],
            data=rows.ravel(),
        )

    def compressed(self, stamp_s: float, data: bytes, format_: str) -> Any:
        return self.types["sensor_msgs/msg/CompressedImage"](
            header=self.header(stamp_s), format=format_, data=np.frombuffer(data, np.uint8)
        )

    def info(self, fx: float, distortion: tuple[float, ...] = (), model: str = "plumb_bob") -> Any:
        names = ("D", "K", "R", "P") if self.kind == "ros1" else ("d", "k", "r", "p")
        matrix = np.array([fx, 0, 2.0, 0, fx, 1.0, 0, 0, 1.0])
        projection = np.array([fx + 1, 0, 2.0, 0, 0, fx + 1, 1.0, 0, 0, 0, 1.0, 0])
        values = (np.array(distortion, float), matrix, np.eye(3).ravel(), projection)
        roi = self.types["sensor_msgs/msg/RegionOfInterest"](
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        return self.types["sensor_msgs/msg/CameraInfo"](
            header=self.header(1.0),
            height=3,
            width=4,
            distortion_model=model,
            binning_x=0,
            binning_y=0,
            roi=roi,
            **dict(zip(names, values, strict=True)),
        )

    def odometry(self, stamp_s: float, x: float, y: float, yaw: float) -> Any:
        t = self.types
        pose = t["geometry_msgs/msg/Pose"](position=self.point(x, y), orientation=self.turned(yaw))
        twist = t["geometry_msgs/msg/Twist"](linear=self.vector(0.5, 0.1, 0), angular=self.vector(0, 0, 0.2))
        zeros = np.zeros(36)
        return t["nav_msgs/msg/Odometry"](
            header=self.header(stamp_s),
            child_frame_id="base_link",
            pose=t["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=zeros),
            twist=t["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=zeros),
        )

    def pose(self, stamp_s: float, x: float, y: float, yaw: float, covariance: np.ndarray | None = None) -> Any:
        t = self.types
        pose = t["geometry_msgs/msg/Pose"](position=self.point(x, y), orientation=self.turned(yaw))
        if covariance is None:
            return t["geometry_msgs/msg/PoseStamped"](header=self.header(stamp_s), pose=pose)
        spread = t["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=covariance.ravel())
        return t["geometry_msgs/msg/PoseWithCovarianceStamped"](header=self.header(stamp_s), pose=spread)

    def satellites(self, stamp_s: float, latitude: float, longitude: float, status: int = 0, sigma: float = 0.0) -> Any:
        t = self.types
        return t["sensor_msgs/msg/NavSatFix"](
            header=self.header(stamp_s),
            status=t["sensor_msgs/msg/NavSatStatus"](status=status, service=1),
            latitude=latitude,
            longitude=longitude,
            altitude=0.0,
            position_covariance=np.eye(3).ravel() * sigma**2,
            position_covariance_type=2 if sigma else 0,
        )

    def transform(self, stamp_s: float, parent: str, child: str, x: float, yaw: float) -> Any:
        t = self.types
        move = t["geometry_msgs/msg/Transform"](translation=self.vector(x, 0, 0), rotation=self.turned(yaw))
        stamped = t["geometry_msgs/msg/TransformStamped"](
            header=self.header(stamp_s, parent), child_frame_id=child, transform=move
        )
        return t["tf2_msgs/msg/TFMessage"](transforms=[stamped])

    def mounting(self, parent: str, child: str, pose: Pose3, quat_xyzw: tuple[float, ...] | None = None) -> Any:
        """Return a message of ``/tf_static``; the quaternion is that of the pose unless it is given."""
        t = self.types
        x, y, z, w = Rotation.from_matrix(pose.rotation()).as_quat() if quat_xyzw is None else quat_xyzw
        turned = t["geometry_msgs/msg/Quaternion"](x=float(x), y=float(y), z=float(z), w=float(w))
        move = t["geometry_msgs/msg/Transform"](translation=self.vector(pose.x, pose.y, pose.z), rotation=turned)
        stamped = t["geometry_msgs/msg/TransformStamped"](
            header=self.header(0.0, parent), child_frame_id=child, transform=move
        )
        return t["tf2_msgs/msg/TFMessage"](transforms=[stamped])

    def scan(self, stamp_s: float, ranges: list[float], frame_id: str = "") -> Any:
        return self.types["sensor_msgs/msg/LaserScan"](
            header=self.header(stamp_s, frame_id),
            angle_min=-1.0,
            angle_max=1.0,
            angle_increment=0.5,
            time_increment=0.0,
            scan_time=0.0,
            range_min=0.25,
            range_max=10.0,
            ranges=np.array(ranges, np.float32),
            intensities=np.empty(0, np.float32),
        )

    def imu(self, stamp_s: float, unknown: bool = False) -> Any:
        covariance = np.zeros(9)
        covariance[0] = -1.0 if unknown else 0.0
        return self.types["sensor_msgs/msg/Imu"](
            header=self.header(stamp_s),
            orientation=self.turned(math.pi / 2),
            orientation_covariance=covariance,
            angular_velocity=self.vector(1, 2, 3),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=self.vector(4, 5, 6),
            linear_acceleration_covariance=covariance,
        )

    def text(self, words: str) -> Any:
        return self.types["std_msgs/msg/String"](data=words)

    def vector(self, x: float, y: float, z: float) -> Any:
        return self.types["geometry_msgs/msg/Vector3"](x=float(x), y=float(y), z=float(z))

    def point(self, x: float, y: float) -> Any:
        return self.types["geometry_msgs/msg/Point"](x=float(x), y=float(y), z=0.0)

    def turned(self, yaw: float) -> Any:
        half = yaw / 2
        return self.types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=math.sin(half), w=math.cos(half))


@pytest.fixture
def recording() -> type[Recording]:
    """Collect messages and write them."""
    return Recording
