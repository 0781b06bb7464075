"""What the sink tells ROS, heard by a participant of its own."""

from __future__ import annotations

import math
import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="the extra [ros2] is not installed")


from trailmark.api import create
from trailmark.estimates import Applied, Belief, EstimateRecord, Fix, Lost, Motion, information_from_sigmas
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import RunEnd, Session
from trailmark.paths import Path, Waypoint
from trailmark_ros2 import dds
from trailmark_ros2.believing import BeliefMessages, covariance_of_six, path_bytes
from trailmark_ros2.lostness import Lostness
from trailmark_ros2.message_types import deserialize, new_message, serialize
from trailmark_ros2.robot_odometry import RobotOdometry
from trailmark_ros2.writers import WriterChoice

GOOD = information_from_sigmas(0.01, 0.01, 0.01)
THERE = Pose2(3.0, -2.0, 0.7)
TYPES = {
    "/tf": "tf2_msgs/msg/TFMessage",
    "/trailmark/odometry": "nav_msgs/msg/Odometry",
    "/trailmark/pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}


def belief(stamp_s: float, pose: Pose2 | None = THERE) -> Belief:
    covariance = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.002], [0.0, 0.002, 0.01]])
    return Belief(stamp_s, pose, None if pose is None else covariance, Pose2(), Twist2(0.4, 0.05, -0.1))


def record(source: str, estimate, status="accepted") -> EstimateRecord:
    return EstimateRecord(estimate.stamp_s, source, estimate, Applied(status))


@pytest.fixture
def listening(domain, robot, wait_for):
    """Return a started sink, with what is heard of it by topic."""
    sinks = []

    def start(session=None, **keys):
        heard = {topic: robot.hear(topic, type_name) for topic, type_name in TYPES.items()}
        sink = create("sink", "ros2", domain=domain, **keys)
        sinks.append(sink)
        sink.start(session or Session("ros"))
        unsent = {"/tf"} if "tf_topic" in keys or keys.get("tf") == "none" else set()
        unsent |= {"/trailmark/pose"} if "pose" in keys else set()
        sent = TYPES.keys() - unsent
        assert wait_for(lambda: all(heard[topic].n_matched for topic in sent))
        return sink, heard

    yield start
    for sink in sinks:
        sink.close()


def matrix(transform) -> np.ndarray:
    theta = 2.0 * math.atan2(transform.rotation.z, transform.rotation.w)
    return Pose2(transform.translation.x, transform.translation.y, theta).matrix()


def with_odometry(sink, robot, messages, wait_for, pose: Pose2, stamp_s: float) -> None:
    """Let the sink hear the robot's odometry, at the stamp and 20 ms before and after."""
    assert wait_for(lambda: [reader for reader in robot.network.readers() if reader.topic == "/odom"])
    for dt_s in (-0.02, 0.0, 0.02):
        robot.send("/odom", messages.odometry(pose.x, pose.y, pose.theta, stamp_s=stamp_s + dt_s))
        time.sleep(0.1)  # the first may come before the match


def test_the_transform_completes_the_robots_own_odometry(listening, robot, messages, wait_for) -> None:
    sink, heard = listening()
    now_s = time.time()
    pose_odom_base, believed = Pose2(10.0, 5.0, -1.2), belief(now_s)
    with_odometry(sink, robot, messages, wait_for, pose_odom_base, now_s)
    with_odometry(sink, robot, messages, wait_for, pose_odom_base, now_s + 0.1)

    sink.on_belief(believed)
    ((stamped,),) = [message.transforms for message in wait_for(heard["/tf"].messages)]

    assert (stamped.header.frame_id, stamped.child_frame_id) == ("map", "odom")
    product = matrix(stamped.transform) @ pose_odom_base.matrix()
    np.testing.assert_allclose(product, believed.pose_map_base.matrix(), atol=1e-9)
    stamp_s = stamped.header.stamp.sec + stamped.header.stamp.nanosec / 1e9
    assert stamp_s == pytest.approx(now_s + 1.0, abs=1e-6)  # ahead, as AMCL's


def test_the_transform_may_lead_to_base(listening, wait_for) -> None:
    sink, heard = listening(tf="map_base")
    believed = belief(time.time())

    sink.on_belief(believed)
    ((stamped,),) = [message.transforms for message in wait_for(heard["/tf"].messages)]

    assert stamped.child_frame_id == "base_link"
    np.testing.assert_allclose(matrix(stamped.transform), believed.pose_map_base.matrix(), atol=1e-9)


def test_a_robot_in_a_namespace_has_transforms_of_its_own(listening, robot, wait_for) -> None:
    heard = robot.hear("/robot1/tf", TYPES["/tf"])
    sink, _ = listening(tf="map_base", tf_topic="/robot1/tf", base_frame="robot1/base_link")
    assert wait_for(lambda: heard.n_matched)

    sink.on_belief(belief(time.time()))

    ((stamped,),) = [message.transforms for message in wait_for(heard.messages)]
    assert stamped.child_frame_id == "robot1/base_link"


def test_what_nobody_reads_is_not_even_built(listening, monkeypatch) -> None:
    def unread(*_):
        raise AssertionError("nobody reads /unread")

    sink, _ = listening(tf="none", path=None, pose="/unread")
    monkeypatch.setattr("trailmark_ros2.believing.BeliefMessages.pose", unread)

    sink.on_belief(belief(time.time()))


def test_pose_odometry_and_covariance_are_those_believed(listening, wait_for) -> None:
    sink, heard = listening(tf="none")
    believed = belief(time.time())

    sink.on_belief(believed)
    (odometry,) = wait_for(heard["/trailmark/odometry"].messages)
    (pose,) = wait_for(heard["/trailmark/pose"].messages)

    assert (odometry.header.frame_id, odometry.child_frame_id) == ("map", "base_link")
    assert (pose.pose.pose.position.x, pose.pose.pose.position.y) == (3.0, -2.0)
    assert 2.0 * math.asin(pose.pose.pose.orientation.z) == pytest.approx(0.7)
    twist = odometry.twist.twist
    assert (twist.linear.x, twist.linear.y, twist.angular.z) == (0.4, 0.05, -0.1)
    six = pose.pose.covariance
    assert (six[0], six[7], six[35]) == (0.04, 0.09, 0.01)  # x, y, yaw
    assert (six[1], six[11]) == (0.01, 0.002)  # x with y, y with yaw


@pytest.mark.parametrize("map_frame", ["map", "m", "robot1/map"])
def test_bytes_of_beliefs_are_those_of_the_messages(messages, map_frame: str) -> None:
    believed = belief(1.5e9 + 0.123456)
    made = BeliefMessages(map_frame, "base")

    for cdr, type_name, stamp_s in (
        (made.pose(believed), TYPES["/trailmark/pose"], believed.stamp_s),
        (made.odometry(believed), TYPES["/trailmark/odometry"], believed.stamp_s),
        (made.transform(THERE, 7.5, "odom"), TYPES["/tf"], 7.5),
    ):
        message = deserialize(cdr, type_name)
        assert serialize(message) == cdr
        part = message.transforms[0] if type_name == TYPES["/tf"] else message
        assert part.header == messages.header(stamp_s, map_frame)


@pytest.mark.parametrize("map_frame", ["map", "m", "robot1/map"])
@pytest.mark.parametrize("n_poses", [0, 1, 2, 5])
def test_a_path_is_written_as_its_poses_are(messages, map_frame: str, n_poses: int) -> None:
    poses = [Pose2(0.5 * k, -k, 0.3 * k) for k in range(n_poses)]

    cdr = path_bytes(poses, 12.25, map_frame)

    head = messages.header(12.25, map_frame)
    parts = [messages.pose(pose.x, pose.y, pose.theta) for pose in poses]
    stamped = [new_message("geometry_msgs/msg/PoseStamped", {"header": head, "pose": part}) for part in parts]
    assert cdr == serialize(new_message("nav_msgs/msg/Path", {"header": head, "poses": stamped}))


def test_an_unknown_covariance_is_huge() -> None:
    six = covariance_of_six(None).reshape(6, 6)

    assert six[0, 0] == six[1, 1] == six[5, 5] == 1e6


@pytest.mark.parametrize(
    "covariance",
    [
        np.array([[1e8, 9900.0, 0.0], [9900.0, 1.0, 0.0], [0.0, 0.0, 0.01]]),
        np.array([[1e8, -9.9e7, 100.0], [-9.9e7, 1e8, 0.0], [100.0, 0.0, 0.01]]),
        np.array([[np.inf, np.nan, 0.0], [np.nan, 1.0, 0.05], [0.0, 0.05, 0.01]]),
    ],
)
def test_a_covariance_that_is_too_large_to_tell_is_one_still(covariance: np.ndarray) -> None:
    six = covariance_of_six(covariance).reshape(6, 6)
    planar = six[np.ix_((0, 1, 5), (0, 1, 5))]

    np.testing.assert_array_equal(six, six.T)
    assert np.all(np.linalg.eigvalsh(planar) > 0.0)
    assert planar.max() == 1e6
    known = np.isfinite(covariance).all(axis=0) & (np.diag(covariance) < 1e6)
    np.testing.assert_allclose(planar[np.ix_(known, known)], covariance[np.ix_(known, known)])


def test_nothing_is_told_while_the_robot_is_lost_but_why(listening, wait_for) -> None:
    sink, heard = listening(tf="map_base")
    now_s = time.time()
    sink.on_estimate_record(record("eye", Lost(now_s, "too dark"), "unused"))

    sink.on_belief(belief(now_s))
    (diagnosis,) = wait_for(heard["/diagnostics"].messages)
    time.sleep(0.2)

    (status,) = diagnosis.status
    assert (status.level, status.message) == (2, "lost: eye: too dark")
    assert not [topic for topic in ("/tf", "/trailmark/odometry", "/trailmark/pose") if heard[topic].messages()]


def test_a_robot_that_is_found_again_is_told_again(listening, wait_for) -> None:
    sink, heard = listening(tf="map_base")
    now_s = time.time()
    sink.on_estimate_record(record("eye", Lost(now_s, "too dark"), "unused"))
    sink.on_belief(belief(now_s))

    sink.on_estimate_record(record("eye", Fix(now_s + 0.1, Pose2(3.0, -2.0, 0.7), GOOD)))
    sink.on_belief(belief(now_s + 0.1))

    assert wait_for(heard["/tf"].messages)


def test_nothing_is_told_before_a_pose_is_known(listening, wait_for) -> None:
    sink, heard = listening(tf="map_base")

    sink.on_belief(belief(time.time(), None))
    (diagnosis,) = wait_for(heard["/diagnostics"].messages)

    assert diagnosis.status[0].message == "lost: no pose is known yet"
    assert not heard["/tf"].messages()


def test_without_the_robots_odometry_there_is_no_transform_and_it_is_said(listening, wait_for) -> None:
    sink, heard = listening()
    now_s = time.time()

    sink.on_belief(belief(now_s))
    sink.on_belief(belief(now_s + 1.5))

    said = [diagnosis.status[0] for diagnosis in wait_for(heard["/diagnostics"].messages)]
    assert said[0].level == 1
    assert "/odom has no pose of the belief's stamp" in said[0].message
    assert not heard["/tf"].messages()


def test_while_nobody_asks_for_transforms_odometry_is_read_little_by_little(listening, messages) -> None:
    sink, _ = listening(tf_topic="/nobody")
    now_s = time.time()
    waiting = [messages.odometry(3.0, stamp_s=now_s - 0.01 * k) for k in range(100)][::-1]
    left = []
    sink._odom = SimpleNamespace(
        take=lambda n: [SimpleNamespace(writer=1, message=waiting.pop(0)) for _ in range(min(n, len(waiting)))],
        message_of=lambda sample: sample.message,
    )

    for k in range(6):
        sink.on_belief(belief(now_s + 0.001 * k))
        left.append(len(waiting))

    assert left == [80, 60, 40, 20, 0, 0]


def test_the_taught_path_waits_for_who_comes_late(listening, robot, wait_for) -> None:
    path = Path([Waypoint(0, 0.0, Pose2()), Waypoint(1, 1.0, Pose2(1.0, 0.5, 0.2))])
    listening(Session("ros", "replay", path=path))

    late = robot.hear("/trailmark/taught_path", "nav_msgs/msg/Path", dds.Quality(is_latched=True))
    (message,) = wait_for(late.messages)

    assert [(pose.pose.position.x, pose.pose.position.y) for pose in message.poses] == [(0.0, 0.0), (1.0, 0.5)]


def test_the_end_is_said(listening, wait_for) -> None:
    sink, heard = listening()

    sink.on_end(RunEnd("failed", "the camera burnt"))

    (diagnosis,) = wait_for(heard["/diagnostics"].messages)
    assert diagnosis.status[0].message == "the run is over: failed the camera burnt"


def test_the_end_is_said_to_who_has_just_come(listening, wait_for) -> None:
    sink, heard = listening()
    diagnostics = sink._publishers["diagnostics"]
    diagnostics._looked_s, diagnostics._is_read = time.monotonic(), False  # as before the match

    sink.on_end(RunEnd("ended", ""))

    assert wait_for(heard["/diagnostics"].messages)


class TestLostness:
    def test_wheels_that_turn_do_not_find_a_lost_camera(self) -> None:
        lostness = Lostness()
        lostness.note_estimate(record("wheels", Motion(0.0, 0.1, Pose2(0.1), GOOD)))
        assert lostness.reason(belief(0.1)) == ""

        lostness.note_estimate(record("eye", Lost(0.1, "too dark"), "unused"))

        assert lostness.reason(belief(0.1)) == "eye: too dark"

    def test_one_of_two_eyes_is_enough(self) -> None:
        lostness = Lostness()
        lostness.note_estimate(record("left", Lost(0.1, "too dark"), "unused"))
        lostness.note_estimate(record("right", Fix(0.1, Pose2(), GOOD)))

        assert lostness.reason(belief(0.1)) == ""

    def test_a_camera_of_the_floor_that_lost_its_track_is_covered_by_the_wheels(self) -> None:
        lostness = Lostness()
        for name in ("floor", "wheels"):
            lostness.note_estimate(record(name, Motion(0.0, 0.1, Pose2(0.1), GOOD)))

        lostness.note_estimate(record("floor", Lost(0.2, "blurred"), "unused"))
        assert lostness.reason(belief(0.2)) == ""

        lostness.note_estimate(record("wheels", Lost(0.3, "slipping"), "unused"))
        assert lostness.reason(belief(0.3)) == "floor: blurred; wheels: slipping"

    def test_a_place_that_is_not_accepted_finds_nobody(self) -> None:
        lostness = Lostness()
        lostness.note_estimate(record("eye", Lost(0.1, "too dark"), "unused"))

        lostness.note_estimate(record("eye", Fix(0.2, Pose2(), GOOD), "gated"))

        assert lostness.reason(belief(0.2)) == "eye: too dark"


class TestRobotOdometry:
    def test_poses_between_messages_are_interpolated(self, messages) -> None:
        odometry = RobotOdometry()
        odometry.add(messages.odometry(1.0, stamp_s=10.0))
        odometry.add(messages.odometry(2.0, stamp_s=11.0))

        assert odometry.pose_odom_base(10.25).x == pytest.approx(1.25)
        assert odometry.pose_odom_base(9.9) is None

    def test_it_is_predicted_by_its_velocity_for_a_short_time(self, messages) -> None:
        odometry, message = RobotOdometry(), messages.odometry(1.0, stamp_s=10.0)
        message.twist.twist.linear.x = 0.5
        odometry.add(message)

        assert odometry.pose_odom_base(10.1).x == pytest.approx(1.05)
        assert odometry.pose_odom_base(10.3) is None

    def test_odometry_that_goes_back_in_time_begins_anew(self, messages) -> None:
        odometry = RobotOdometry()
        odometry.add(messages.odometry(1.0, stamp_s=10.0))

        odometry.add(messages.odometry(0.0, stamp_s=2.0))

        assert odometry.pose_odom_base(2.0).x == 0.0

    def test_of_another_program_nothing_is_told_before_it_is_certain_that_it_counts(self, messages) -> None:
        """The first messages of a second program count, until the first one is found to speak on."""
        odometry, writers, told = RobotOdometry(), WriterChoice(), []
        for k in range(10):
            for writer, x in ((1, 1.0), (2, 50.0)):
                stamp_s = 5.0 + 0.02 * k + 0.01 * (writer - 1)
                if (k > 0 or writer == 1) and writers.counts(writer, stamp_s):
                    odometry.add(messages.odometry(x, stamp_s=stamp_s), writer)
                told += [odometry.pose_odom_base(stamp_s), odometry.pose_odom_base(stamp_s - 0.01)]

        assert {pose.x for pose in told if pose is not None} == {1.0}
        assert told[-1] is not None

    def test_a_driver_that_is_started_again_in_another_frame_goes_on(self, messages) -> None:
        odometry = RobotOdometry()
        odometry.add(messages.odometry(1.0, stamp_s=10.0), 1)
        for k in range(5):
            message = messages.odometry(7.0, stamp_s=11.0 + k)
            message.header.frame_id = "odom_combined"
            odometry.add(message, 2)

        assert odometry.frame_id == "odom_combined"
        assert odometry.pose_odom_base(10.5) is None
        assert odometry.pose_odom_base(14.5).x == 7.0

    def test_a_message_without_a_frame_is_used(self, messages) -> None:
        odometry, message = RobotOdometry(), messages.odometry(2.0, stamp_s=11.0)
        odometry.add(messages.odometry(1.0, stamp_s=10.0))
        message.header.frame_id = ""
        odometry.add(message)

        assert (odometry.pose_odom_base(11.0).x, odometry.frame_id) == (2.0, "odom")


def test_of_two_programs_that_send_odometry_the_first_completes_the_transform(
    listening, robot, new_robot, messages, wait_for, caplog
) -> None:
    sink, heard = listening()
    with_odometry(sink, robot, messages, wait_for, Pose2(1.0), 5.0)
    other = new_robot(robot.domain)
    sink.on_belief(Belief(5.0, Pose2(3.0)))  # hears the first
    for k in range(4):
        other.send("/odom", messages.odometry(50.0, stamp_s=5.02 + 0.02 * k))
        robot.send("/odom", messages.odometry(1.0, stamp_s=5.02 + 0.02 * k))
        time.sleep(0.1)
    sink.on_belief(Belief(5.06, Pose2(3.0)))

    sent = wait_for(heard["/tf"].messages)
    assert sent[-1].transforms[0].transform.translation.x == pytest.approx(2.0)
    assert "/odom: a message is left out, others silently: two programs send it at once" in caplog.text
