"""Writes a recording of ROS 2 to try with, without ROS: ``python write_bag.py FOLDER``; needs the extra ``bags``.

A robot drives ten seconds along a circle. Its odometry turns 5 % too far, its inertial unit lies on its side.
"""

import math
import sys

import numpy as np
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_HUMBLE)


def message(kind, **fields):
    package, name = kind.split("/")
    return store.types[f"{package}/msg/{name}"](**fields)


def header(t, frame):
    stamp = message("builtin_interfaces/Time", sec=int(t), nanosec=round(t % 1 * 1e9))
    return message("std_msgs/Header", stamp=stamp, frame_id=frame)


def vector(x=0.0, y=0.0, z=0.0, kind="Vector3"):
    return message(f"geometry_msgs/{kind}", x=x, y=y, z=z)


def turned(angle, axis="z"):
    sines = {name: math.sin(angle / 2) * (name == axis) for name in "xyz"}
    return message("geometry_msgs/Quaternion", **sines, w=math.cos(angle / 2))


def odometry(t, turn, radius):
    """Return where a robot is that has driven along a circle until it had turned so far."""
    position = vector(radius * math.sin(turn), radius - radius * math.cos(turn), kind="Point")
    pose = message("geometry_msgs/Pose", position=position, orientation=turned(turn))
    pose = message("geometry_msgs/PoseWithCovariance", pose=pose, covariance=np.zeros(36))
    twist = message("geometry_msgs/Twist", linear=vector(0.4), angular=vector(z=0.2))
    twist = message("geometry_msgs/TwistWithCovariance", twist=twist, covariance=np.zeros(36))
    return message("nav_msgs/Odometry", header=header(t, "odom"), child_frame_id="base_link", pose=pose, twist=twist)


def inertial(t):
    """Return what a unit on its left side feels of the same drive: its y axis points up."""
    zeros = {f"{name}_covariance": np.zeros(9) for name in ("orientation", "angular_velocity", "linear_acceleration")}
    felt = {"angular_velocity": vector(y=0.2), "linear_acceleration": vector(y=9.81)}
    return message("sensor_msgs/Imu", header=header(t, "imu_link"), orientation=turned(0.0), **felt, **zeros)


mounting = message("geometry_msgs/Transform", translation=vector(0.1), rotation=turned(math.pi / 2, "x"))
mounting = {"header": header(100, "base_link"), "child_frame_id": "imu_link", "transform": mounting}
with Writer(sys.argv[1], version=8) as bag:
    kinds = {"/odom": "nav_msgs/Odometry", "/truth": "nav_msgs/Odometry", "/imu/data": "sensor_msgs/Imu"}
    kinds["/tf_static"] = "tf2_msgs/TFMessage"
    names = {topic: kind.replace("/", "/msg/") for topic, kind in kinds.items()}
    topics = {topic: bag.add_connection(topic, name, typestore=store) for topic, name in names.items()}

    def write(topic, t, content):
        bag.write(topics[topic], int(t * 1e9), store.serialize_cdr(content, names[topic]))

    tree = message("tf2_msgs/TFMessage", transforms=[message("geometry_msgs/TransformStamped", **mounting)])
    write("/tf_static", 100, tree)
    for i in range(200):
        t, turn = 100 + 0.05 * i, 0.05 * 0.2 * i
        write("/odom", t, odometry(t, 1.05 * turn, 2.0 / 1.05))
        write("/truth", t, odometry(t, turn, 2.0))
        write("/imu/data", t, inertial(t))
