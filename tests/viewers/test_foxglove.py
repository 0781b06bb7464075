"""The sink for Foxglove: what stands in the file, and who can connect."""

from __future__ import annotations

import json
import math
import socket
from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from trailmark import Session
from trailmark.api import create
from trailmark.commands import Velocity
from trailmark.errors import ConfigError
from trailmark.estimates import Applied, Belief, Fix, Lost, information_from_sigmas
from trailmark.frames import RGBD, Frame, Image, Odometry, Record, Scan, SensorInfo
from trailmark.geometry import Pose2, Pose3, Twist2
from trailmark.interfaces import RunEnd
from trailmark.paths import Path as TaughtPath
from trailmark.paths import Waypoint

pytest.importorskip("foxglove", reason="the extra [foxglove] is not installed")
reading = pytest.importorskip("mcap.reader", reason="mcap is not installed")

GOOD = information_from_sigmas(0.01, 0.01, 0.01)
GREY = np.tile(np.arange(64, dtype=np.uint8) * 4, (48, 1))


def belief(stamp_s: float, **more: Any) -> Belief:
    fields = {"pose_map_base": Pose2(1.0, 2.0, 0.5), "covariance": np.eye(3), "pose_odom_base": Pose2(0.5, 0.0, 0.0)}
    known = {"twist": Twist2(0.3, 0.0, 0.1), "travelled_m": 0.5, "fix_age_m": math.inf, "motion_age_s": 0.0}
    return Belief(stamp_s=stamp_s, on_path=None, **{**fields, **known, **more})


def written(path: Path) -> dict[str, list[tuple[str, int, bytes]]]:
    """Return schema, log time and content of the messages of each topic."""
    found: dict[str, list[tuple[str, int, bytes]]] = defaultdict(list)
    with path.open("rb") as file:
        for schema, channel, message in reading.make_reader(file).iter_messages():
            found[channel.topic].append((schema.name if schema else "", message.log_time, message.data))
    return found


def sink_in(tmp_path: Path, **config: Any) -> Any:
    return create("sink", "foxglove", path=str(tmp_path / "run.mcap"), **config)


def test_a_run_stands_in_the_file(tmp_path: Path) -> None:
    sink = sink_in(tmp_path)
    path = TaughtPath([Waypoint(0, 0.0, Pose2()), Waypoint(1, 1.0, Pose2(1.0, 0.0, 0.0))])
    camera = SensorInfo("front", "image", pose_base_sensor=Pose3(0.1, 0.0, 0.2, yaw=math.pi / 2))
    sink.start(Session(name="foxglove", sensors={"front": camera}, path=path))

    sink.on_frame(Frame("front", 12.5, Image(GREY)))
    sink.on_frame(Frame("laser", 12.5, Scan(np.array([1.0, np.nan, 3.0]), -0.1, 0.1)))
    sink.on_frame(Frame("wheels", 12.5, Odometry(Pose2(1.0, 0.0, 0.0))))
    sink.on_frame(Frame("marks", 12.5, Record({"ids": np.array([3, 4])})))
    sink.on_estimate("eye", Fix(12.4, Pose2(1.0, 2.0, 0.5), GOOD), Applied("accepted", nis=2.5, dof=3))
    sink.on_estimate("eye", Lost(12.5, "too dark"), Applied("refused", reason="lost"))
    sink.on_belief(belief(12.5))
    sink.on_command(12.5, Velocity(0.3, 0.0, 0.1))
    sink.on_end(RunEnd("done", "at the goal"))
    sink.close()

    found = written(tmp_path / "run.mcap")
    schemas = {
        "/sensors/front": "foxglove.CompressedImage",
        "/sensors/laser": "foxglove.LaserScan",
        "/belief": "foxglove.PoseInFrame",
        "/path": "foxglove.PosesInFrame",
        "/fixes/eye": "foxglove.PoseInFrame",
        "/tf": "foxglove.FrameTransform",
        "/log": "foxglove.Log",
    }
    assert {topic: found[topic][0][0] for topic in schemas} == schemas
    assert [stamp_ns for _, stamp_ns, _ in found["/estimates/eye"]] == [12_400_000_000, 12_500_000_000]
    fix, lost = (json.loads(data) for _, _, data in found["/estimates/eye"])
    assert (fix["kind"], fix["status"], fix["nis"], fix["pose_map_base"]) == ("Fix", "accepted", 2.5, [1.0, 2.0, 0.5])
    assert (lost["kind"], lost["lost"]) == ("Lost", "too dark")
    numbers = json.loads(found["/belief/numbers"][0][2])
    assert (numbers["travelled_m"], numbers["fix_age_m"]) == (0.5, None)
    assert json.loads(found["/commands"][0][2])["kind"] == "Velocity"
    assert json.loads(found["/sensors/marks"][0][2])["ids"] == [3, 4]
    assert len(found["/tf"]) == 3  # the mounting, map to odom, odom to base
    assert b"at the goal" in found["/log"][0][2]
    content = found["/sensors/front"][0][2]
    picture = cv2.imdecode(np.frombuffer(content[content.index(b"\xff\xd8") :], np.uint8), cv2.IMREAD_GRAYSCALE)
    assert np.abs(picture.astype(int) - GREY).mean() < 3.0


def test_depth_and_deep_pictures_are_raw_and_exact(tmp_path: Path) -> None:
    sink = sink_in(tmp_path)
    depth = np.linspace(0.5, 4.0, 48 * 64, dtype=np.float32).reshape(48, 64)
    deep = (GREY.astype(np.uint16) << 8).copy()
    sink.start(Session())

    sink.on_frame(Frame("kinect", 1.0, RGBD(np.dstack([GREY] * 3), depth)))
    sink.on_frame(Frame("deep", 1.0, Image(deep)))
    sink.close()

    found = written(tmp_path / "run.mcap")
    assert found["/sensors/kinect/depth"][0][0] == "foxglove.RawImage"
    assert depth.tobytes() in found["/sensors/kinect/depth"][0][2]
    assert deep.tobytes() in found["/sensors/deep"][0][2]


def test_pictures_may_be_left_out(tmp_path: Path) -> None:
    sink = sink_in(tmp_path, pictures="none")
    sink.start(Session())
    sink.on_frame(Frame("front", 1.0, Image(GREY)))
    sink.on_belief(belief(1.0, pose_map_base=None, covariance=None))
    sink.close()

    assert set(written(tmp_path / "run.mcap")) == {"/tf", "/belief/numbers"}


def test_a_sink_starts_again_as_new_and_closes_twice(tmp_path: Path) -> None:
    sink = sink_in(tmp_path)
    for stamp_s in (1.0, 2.0):
        sink.start(Session())
        sink.on_belief(belief(stamp_s))
        sink.close()
    sink.close()

    assert [stamp_ns for _, stamp_ns, _ in written(tmp_path / "run.mcap")["/belief"]] == [2_000_000_000]


def test_who_is_connected_is_served_while_it_runs() -> None:
    sink = create("sink", "foxglove", live=True, port=0)
    sink.start(Session(name="foxglove"))
    try:
        with socket.create_connection(("127.0.0.1", sink.port), timeout=5) as client:
            head = "GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            head += "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
            client.sendall(f"{head}Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode())
            answer = client.recv(200)
        sink.on_belief(belief(1.0))
    finally:
        sink.close()

    assert answer.startswith(b"HTTP/1.1 101")
    assert sink.port is None


@pytest.mark.parametrize(
    ("config", "message"),
    [({}, "it would go nowhere"), ({"path": "/no/such/folder/run.mcap"}, "foxglove cannot write to /no/such/folder")],
)
def test_what_cannot_be_written_is_told(config: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        create("sink", "foxglove", **config).start(Session())
