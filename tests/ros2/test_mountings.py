"""Where the sensors of a live robot sit: `/tf_static`, and what is said where it does not tell."""

from __future__ import annotations

import logging
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="the extra [ros2] is not installed")

from trailmark.api import create
from trailmark.frames import SensorOrigin
from trailmark.geometry import Pose3
from trailmark.interfaces import Session
from trailmark_ros2 import dds
from trailmark_ros2.message_types import new_message
from trailmark_ros2.mountings import static_tree, tell_of_frames

GREY = np.zeros((48, 64), np.uint8)
AHEAD_OPTICAL = (-0.5, 0.5, -0.5, 0.5)  # x right, y down, z forward
LEVEL = (0.0, 0.0, 0.0, 1.0)


@pytest.fixture
def tree_message(messages):
    """Return what makes a message of links (parent, child, x [m], quaternion xyzw)."""

    def transform(parent, child, x, quat_xyzw):
        fields = {
            "translation": new_message("geometry_msgs/msg/Vector3", {"x": x}),
            "rotation": new_message("geometry_msgs/msg/Quaternion", dict(zip("xyzw", quat_xyzw))),
        }
        return new_message(
            "geometry_msgs/msg/TransformStamped",
            {
                "header": messages.header(0.0, parent),
                "child_frame_id": child,
                "transform": new_message("geometry_msgs/msg/Transform", fields),
            },
        )

    return lambda *links: new_message("tf2_msgs/msg/TFMessage", {"transforms": [transform(*link) for link in links]})


@pytest.fixture
def send_tree(robot, tree_message):
    latched = dds.Quality(is_reliable=True, is_latched=True, depth=1)
    return lambda *links: robot.send("/tf_static", tree_message(*links), latched)


@pytest.fixture
def mounting_of_camera(domain, robot, messages):
    sources = []

    def mounting(frame: str) -> Pose3:
        robot.repeat("/image_raw", 30, lambda k: messages.image(GREY, "mono8", frame_id=frame))
        sources.append(create("source", "ros2", domain=domain, topics={"front": "/image_raw"}))
        sources[0].start(Session("robot", "track"))
        return sources[0].sensors["front"].pose_base_sensor

    yield mounting
    for source in sources:
        source.close()


@pytest.mark.parametrize("frame", ["cam_optical", "cam"])
def test_pictures_are_in_optical_axes_whatever_their_frame_is_called(send_tree, mounting_of_camera, frame) -> None:
    send_tree(("base_link", "mast", 0.3, LEVEL), ("mast", frame, 0.2, AHEAD_OPTICAL))

    mounting = mounting_of_camera(frame)

    np.testing.assert_allclose(mounting.matrix(), Pose3(0.5, 0.0, 0.0).matrix(), atol=1e-9)


def test_pictures_of_a_link_are_in_its_axes(send_tree, mounting_of_camera) -> None:
    send_tree(("base_link", "cam_link", 0.5, LEVEL))

    mounting = mounting_of_camera("cam_link")

    np.testing.assert_allclose(mounting.matrix(), Pose3(0.5, 0.0, 0.0).matrix(), atol=1e-9)


@pytest.mark.parametrize("quat_xyzw", [(0.0, 0.0, 0.0, 0.0), (float("nan"), 0.0, 0.0, 1.0), (1.5e308, 1.5e308, 0, 0)])
def test_a_transform_without_orientation_is_named(send_tree, mounting_of_camera, caplog, quat_xyzw) -> None:
    send_tree(("base_link", "cam", 0.5, quat_xyzw))

    with caplog.at_level(logging.WARNING):
        mounting = mounting_of_camera("cam")

    assert mounting == Pose3()
    assert "front: /tf_static gives base_link -> cam a quaternion that is zero or not finite" in caplog.text
    assert "it sits at base" in caplog.text


def test_a_frame_to_which_nothing_leads_is_named(send_tree, mounting_of_camera, caplog) -> None:
    send_tree(("base_footprint", "cam", 0.5, LEVEL))

    with caplog.at_level(logging.WARNING):
        mounting = mounting_of_camera("cam")

    assert mounting == Pose3()
    assert "front: nothing in /tf_static leads from 'base_link' (base_frame) to 'cam'" in caplog.text


def test_where_mountings_and_lenses_come_from_is_told(domain, robot, messages, send_tree) -> None:
    robot.repeat("/front/image_raw", 30, lambda k: messages.image(GREY, "mono8", frame_id="cam"))
    robot.repeat("/odom", 30, lambda k: messages.odometry())
    lens = {"height": 48, "width": 64, "distortion_model": "plumb_bob", "d": np.zeros(5)}
    lens |= {"k": np.array([55.0, 0.0, 31.5, 0.0, 55.0, 23.5, 0.0, 0.0, 1.0]), "header": messages.header(0.0, "cam")}
    robot.repeat("/front/camera_info", 30, lambda k: new_message("sensor_msgs/msg/CameraInfo", lens))
    send_tree(("base_link", "cam", 0.5, AHEAD_OPTICAL))
    source = create("source", "ros2", domain=domain, topics={"front": "/front/image_raw", "wheels": "/odom"})
    try:
        source.start(Session("robot", "track"))
    finally:
        source.close()

    assert source.origins()["front"] == SensorOrigin("/tf_static (base_link -> cam: x: 0.5)", "/front/camera_info")
    assert source.origins()["wheels"] == SensorOrigin()


def test_a_frame_with_two_parents_is_said(tree_message, caplog) -> None:
    first, second = (tree_message((parent, "cam", 0.5, LEVEL)) for parent in ("base_link", "mast"))

    assert static_tree([first, second]).parents["cam"][0] == "mast"
    assert "/tf_static gives cam two parents, base_link and mast; the latter is used" in caplog.text


def test_a_frame_with_two_parents_in_one_message_is_said_with_the_topic(tree_message, caplog) -> None:
    message = tree_message(("base_link", "cam", 0.5, LEVEL), ("mast", "cam", 0.5, LEVEL))

    static_tree([message], "/robot1/tf_static")

    assert "/robot1/tf_static gives cam two parents, base_link and mast; the latter is used" in caplog.text


@pytest.mark.parametrize(
    ("child", "links", "is_said"),
    [
        ("camera_link", [("base_link", "camera_link", 0.3, LEVEL)], True),
        ("camera_link", [], True),
        ("base_link_frd", [("base_link", "base_link_frd", 0.0, (1.0, 0.0, 0.0, 0.0))], True),  # left is right there
        ("base_footprint", [("base_footprint", "base_link", 0.0, LEVEL)], False),
        ("base_link", [], False),
        ("", [], False),
    ],
)
def test_odometry_of_something_else_than_base_is_said(tree_message, caplog, child, links, is_said) -> None:
    subscription = SimpleNamespace(type_name="nav_msgs/msg/Odometry")
    feed = SimpleNamespace(topic="/odom", frame_id="odom", child_frame_id=child, subscription=subscription)

    tell_of_frames(feed, static_tree([tree_message(*links)]), base_frame="base_link", map_frame="map")

    assert (f"/odom tells the way of {child!r}, and is taken as that of base, 'base_link'" in caplog.text) == is_said


def test_poses_that_are_not_in_the_map_are_said(caplog) -> None:
    subscription = SimpleNamespace(type_name="geometry_msgs/msg/PoseStamped")
    feed = SimpleNamespace(topic="/place", frame_id="odom", child_frame_id="", subscription=subscription)

    tell_of_frames(feed, static_tree([]), base_frame="base_link", map_frame="map")

    assert "/place tells poses in 'odom', and they are taken as in the map, 'map'" in caplog.text
