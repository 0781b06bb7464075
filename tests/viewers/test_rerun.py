"""The sink for Rerun: what stands in the recording, and what a viewer is sent."""

from __future__ import annotations

import math
import os
import signal
import socket
import subprocess
import sys
import time
import warnings
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from trailmark import Session
from trailmark.api import create
from trailmark.commands import Stop, Velocity
from trailmark.errors import ConfigError
from trailmark.estimates import Applied, Belief, Fix, Lost, PathOffset, information_from_sigmas
from trailmark.frames import (
    RGBD,
    Arrays,
    DepthCamera,
    Frame,
    Image,
    Odometry,
    Pinhole,
    Record,
    Scalar,
    Scan,
    SensorInfo,
)
from trailmark.geometry import Pose2, Pose3, Twist2
from trailmark.interfaces import RunEnd
from trailmark.paths import Path as TaughtPath
from trailmark.paths import Waypoint

pytest.importorskip("rerun", reason="the extra [rerun] is not installed")
reading = pytest.importorskip("rerun.chunk", reason="this rerun-sdk cannot read recordings")
from trailmark_viewers.rerun_sink import _blueprint  # noqa: E402

GOOD = information_from_sigmas(0.01, 0.01, 0.01)
GREY = np.tile(np.arange(64, dtype=np.uint8) * 4, (48, 1))
LENS = Pinhole(60.0, 61.0, 31.5, 23.5)
BASE = "/map/odom/base"
HERE = Pose2(1.0, 2.0, 0.5)


def belief(stamp_s: float, pose: Pose2 | None = HERE, **more: Any) -> Belief:
    fields = {"covariance": None if pose is None else np.eye(3), "pose_odom_base": Pose2(0.5, 0.0, 0.0)}
    known = {"twist": Twist2(0.3, 0.0, 0.1), "travelled_m": 0.5, "fix_age_m": math.inf, "motion_age_s": 0.0}
    return Belief(stamp_s=stamp_s, pose_map_base=pose, **{**fields, **known, "on_path": None, **more})


def read(path: Path) -> dict[str, list[dict[str, Any]]]:
    """Return the rows of each entity; a row names its components, and ``time`` unless it holds all the time."""
    found: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for chunk in reading.RrdReader(path).stream().to_chunks():
        columns = chunk.to_record_batch().to_pydict()
        for row in range(chunk.num_rows):
            found[chunk.entity_path].append({name: values[row] for name, values in columns.items()})
    return found


def sink_in(tmp_path: Path, **config: Any) -> Any:
    return create("sink", "rerun", path=str(tmp_path / "run.rrd"), **config)


def seconds(value: Any) -> float:
    """Return a time of a recording: a duration, or a date."""
    return value.total_seconds() if hasattr(value, "total_seconds") else value.timestamp()


def test_a_run_stands_in_the_recording(tmp_path: Path) -> None:
    sink = sink_in(tmp_path)
    path = TaughtPath([Waypoint(0, 0.0, Pose2()), Waypoint(1, 1.0, Pose2(1.0, 0.0, 0.0))])
    mounting = Pose3(0.1, 0.0, 0.2, yaw=math.pi / 2)
    camera = SensorInfo("front", "image", pose_base_sensor=mounting, calibration=LENS)
    sink.start(Session(name="rerun", sensors={"front": camera}, path=path))

    sink.on_frame(Frame("front", 12.5, Image(GREY)))
    sink.on_frame(Frame("laser", 12.5, Scan(np.array([1.0, np.nan, 3.0]), -0.1, 0.1)))
    sink.on_frame(Frame("wheels", 12.5, Odometry(Pose2(1.0, 0.0, 0.25))))
    sink.on_frame(Frame("light", 12.5, Scalar(320.0)))
    sink.on_estimate("eye", Fix(12.4, HERE, GOOD, {"inliers": 9.0}), Applied("accepted", nis=2.5, dof=3))
    sink.on_estimate("eye", Lost(12.5, "too dark"), Applied("refused", reason="lost"))
    sink.on_belief(belief(12.5))
    sink.on_belief(belief(12.6, Pose2(1.1, 2.0, 0.5), on_path=PathOffset(12.6, 1.5, -0.25, 0.1, GOOD)))
    sink.on_command(12.5, Velocity(0.3, 0.0, 0.1))
    sink.on_command(12.6, Stop("at the goal", done=True))
    sink.on_end(RunEnd("done", "at the goal"))
    sink.close()

    found = read(tmp_path / "run.rrd")
    (path_row,) = found["/map/path"]
    assert "time" not in path_row
    assert path_row["LineStrips3D:strips"] == [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]]
    (way,) = found["/map/way"]
    np.testing.assert_allclose(way["LineStrips3D:strips"], [[[1.0, 2.0, 0.0], [1.1, 2.0, 0.0]]], atol=1e-6)
    odom, base = found["/map/odom"][0], found[BASE][0]
    x, y = odom["Transform3D:translation"][0][:2]
    odom_yaw = 2.0 * math.atan2(*odom["Transform3D:quaternion"][0][2:])
    pose = Pose2(x, y, odom_yaw) @ Pose2(*base["Transform3D:translation"][0][:2], 0.0)
    np.testing.assert_allclose([pose.x, pose.y, pose.theta], [1.0, 2.0, 0.5], atol=1e-6)
    (mounted,) = found[f"{BASE}/front"]
    np.testing.assert_allclose(mounted["Transform3D:quaternion"], [[0, 0, math.sqrt(0.5), math.sqrt(0.5)]], atol=1e-6)
    fix = found["/map/fixes/eye"][0]
    assert seconds(fix["time"]) == pytest.approx(12.4)
    assert fix["Points3D:positions"] == [[1.0, 2.0, 0.0]]
    said = {row["TextLog:text"][0]: row["TextLog:level"][0] for row in found["/estimates/eye"]}
    assert said == {"Fix: accepted": "INFO", "Lost, too dark: refused lost": "WARN"}
    numbers = {
        "/estimates/eye/nis": [2.5],
        "/estimates/eye/inliers": [9.0],
        "/sensors/wheels/pose": [1.0, 0.0, 0.25],
        "/sensors/light/value": [320.0],
        "/belief/travelled_m": [0.5],
        "/belief/on_path/lateral_m": [-0.25],
        "/commands/forward_mps": [0.3],
    }
    assert {name: found[name][0]["Scalars:scalars"] for name in numbers} == numbers
    assert "/belief/fix_age_m" not in found  # endless: there was no fix yet
    assert found["/log"][0]["TextLog:text"] == ["done at the goal"]
    assert any("at the goal" in row["TextLog:text"][0] for row in found["/commands"])
    beams = np.array(found[f"{BASE}/laser/scan"][0]["Points3D:positions"])
    np.testing.assert_allclose(
        beams, [[math.cos(0.1), -math.sin(0.1), 0], [3 * math.cos(0.1), 3 * math.sin(0.1), 0]], atol=1e-6
    )


def test_a_picture_comes_with_its_lens_once(tmp_path: Path) -> None:
    sink = sink_in(tmp_path)
    sink.start(Session(sensors={"front": SensorInfo("front", "image", calibration=LENS)}))
    for stamp_s in (1.0, 2.0):
        sink.on_frame(Frame("front", stamp_s, Image(GREY)))
    sink.close()

    rows = read(tmp_path / "run.rrd")[f"{BASE}/front/picture"]
    (lens,) = [row for row in rows if "Pinhole:image_from_camera" in row]
    assert np.array(lens["Pinhole:image_from_camera"][0]).reshape(3, 3).T.tolist() == LENS.matrix().tolist()
    assert lens["Pinhole:resolution"] == [[64.0, 48.0]]
    pictures = [row for row in rows if "EncodedImage:blob" in row]
    assert [seconds(row["time"]) for row in pictures] == [1.0, 2.0]
    content = np.frombuffer(bytes(pictures[0]["EncodedImage:blob"][0]), np.uint8)
    assert np.abs(cv2.imdecode(content, cv2.IMREAD_GRAYSCALE).astype(int) - GREY).mean() < 3.0


def test_the_scene_leaves_out_pictures_whose_lens_is_not_known() -> None:
    sensors = {
        "floor": SensorInfo("floor", "image"),
        "front": SensorInfo("front", "image", calibration=LENS),
        "rgbd": SensorInfo("rgbd", "rgbd", calibration=DepthCamera(LENS)),
    }

    scene, *_ = _blueprint(sensors).root_container.contents

    assert "- map/odom/base/floor/picture" in scene.contents, "the viewer shows it as an error"
    assert not [one for one in scene.contents if "front/picture" in one or "rgbd" in one]


def test_depth_and_deep_pictures_are_exact_and_unknown_depth_is_zero(tmp_path: Path) -> None:
    sink = sink_in(tmp_path)
    depth = np.linspace(0.5, 4.0, 48 * 64, dtype=np.float32).reshape(48, 64).copy()
    depth[0, 0] = np.nan
    deep = (GREY.astype(np.uint16) << 8).copy()
    kinect = SensorInfo("kinect", "rgbd", calibration=DepthCamera(LENS, LENS, Pose3(0.0, -0.025, 0.0)))
    sink.start(Session(sensors={"kinect": kinect}))

    sink.on_frame(Frame("kinect", 1.0, RGBD(np.dstack([GREY] * 3), depth)))
    sink.on_frame(Frame("deep", 1.0, Image(deep)))
    sink.close()

    found = read(tmp_path / "run.rrd")
    rows = found[f"{BASE}/kinect/depth"]
    (buffer,) = [row["DepthImage:buffer"][0] for row in rows if row.get("DepthImage:buffer")]
    np.testing.assert_array_equal(np.frombuffer(bytes(buffer), np.float32).reshape(48, 64), np.nan_to_num(depth))
    (beside,) = [row for row in rows if row.get("Transform3D:translation")]
    np.testing.assert_allclose(beside["Transform3D:translation"], [[0.0, -0.025, 0.0]], atol=1e-9)
    (raw,) = [row["Image:buffer"][0] for row in found[f"{BASE}/deep/picture"]]
    assert bytes(raw) == deep.tobytes()


def test_landmarks_stand_where_they_are_known_and_where_they_were_seen(tmp_path: Path) -> None:
    sink = sink_in(tmp_path)
    known = Arrays({"ids": np.array([7, 9]), "positions_map": np.array([[1.0, 2.0], [3.0, 4.0]])})
    sink.start(Session(sensors={"sightings": SensorInfo("sightings", "range_bearing", calibration=known)}))
    seen = {"ids": np.array([9, 7]), "ranges_m": np.array([2.0, np.inf]), "bearings_rad": np.array([math.pi / 2, 0.0])}

    sink.on_frame(Frame("sightings", 1.0, Record(seen)))
    sink.on_frame(Frame("radio", 1.0, Record({"strengths_db": np.array([1.0])})))
    sink.close()

    found = read(tmp_path / "run.rrd")
    (there,) = found["/map/landmarks/sightings"]
    assert there["Points3D:positions"] == [[1.0, 2.0, 0.0], [3.0, 4.0, 0.0]]
    assert there["Points3D:labels"] == ["7", "9"]
    (here,) = found[f"{BASE}/sightings/sightings"]
    np.testing.assert_allclose(here["Points3D:positions"], [[0.0, 2.0, 0.0]], atol=1e-6)
    assert here["Points3D:labels"] == ["9"]


def test_where_no_pose_is_known_the_way_stands_in_odom(tmp_path: Path) -> None:
    sink = sink_in(tmp_path, pictures="none")
    sink.start(Session())
    sink.on_frame(Frame("front", 1.0, Image(GREY)))
    sink.on_belief(belief(1.0, None))
    sink.on_belief(belief(2.0, None, pose_odom_base=Pose2(0.75, 0.0, 0.0)))
    sink.on_belief(belief(3.0))
    sink.close()

    found = read(tmp_path / "run.rrd")
    assert [row["LineStrips3D:strips"] for row in found["/map/odom/way"]] == [[[[0.5, 0.0, 0.0], [0.75, 0.0, 0.0]]]]
    assert "/map/way" not in found  # a known pose and an unknown one are no line
    assert not any("picture" in entity for entity in found)


def test_stamps_of_the_epoch_are_dates(tmp_path: Path) -> None:
    sink = sink_in(tmp_path)
    sink.start(Session())
    sink.on_belief(belief(1_305_031_102.25))
    sink.close()

    (row,) = read(tmp_path / "run.rrd")["/belief/travelled_m"]
    assert row["time"].year == 2011
    assert seconds(row["time"].tz_localize("UTC")) == pytest.approx(1_305_031_102.25, abs=1e-6)


def without_ids(row: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in row.items() if "RowId" not in name}


def test_the_same_run_gives_the_same_rows_and_starts_again_as_new(tmp_path: Path) -> None:
    sink = sink_in(tmp_path)
    runs = []
    for _ in range(2):
        sink.start(Session())
        sink.on_belief(belief(1.0))
        sink.close()
        rows = read(tmp_path / "run.rrd")
        runs.append(
            {entity: [{k: v for k, v in row.items() if "RowId" not in k} for row in rows[entity]] for entity in rows}
        )
    sink.close()

    assert runs[0] == runs[1]
    assert len(runs[1]["/belief/travelled_m"]) == 1


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({}, "it would go nowhere"),
        ({"path": "/no/such/folder/run.rrd"}, "rerun cannot write to /no/such/folder/run.rrd: No such file"),
        ({"spawn": True, "host": "10.0.0.1"}, "spawn opens a viewer on this machine"),
    ],
)
def test_what_cannot_be_written_is_told(config: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        create("sink", "rerun", **config).start(Session())


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def test_a_viewer_that_does_not_answer_is_told(tmp_path: Path) -> None:
    sink = sink_in(tmp_path, live=True, port=free_port())

    with pytest.raises(ConfigError, match=r"no Rerun viewer answers at 127\.0\.0\.1:\d+: .*; open one with 'rerun'"):
        sink.start(Session())
    sink.close()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a display")
def test_a_viewer_that_cannot_be_opened_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    for display in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(display, raising=False)

    with pytest.raises(ConfigError, match=r"does not come up at port \d+: .*; write path: run\.rrd instead"):
        create("sink", "rerun", spawn=True, port=free_port()).start(Session())


def is_open(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port), timeout=1).close()
    except OSError:
        return False
    return True


@pytest.fixture
def viewer(tmp_path: Path) -> Iterator[tuple[int, Path, int]]:
    """Run Rerun's own receiver without a window: it keeps what it is sent in a file."""
    port, file = free_port(), tmp_path / "received.rrd"
    command = [sys.executable, "-m", "rerun_cli", "--save", str(file), "--port", str(port), "--bind", "127.0.0.1"]
    environment = os.environ | {"HOME": str(tmp_path)}
    with (tmp_path / "viewer.log").open("wb") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, env=environment, start_new_session=True)
    try:
        assert any(is_open(port) or time.sleep(0.05) for _ in range(600)), (tmp_path / "viewer.log").read_text()
        yield port, file, process.pid
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@pytest.mark.parametrize("way", ["live", "spawn"])  # one that listens already is taken
def test_a_viewer_is_sent_what_the_file_holds(tmp_path: Path, viewer: tuple[int, Path, int], way: str) -> None:
    port, received, _ = viewer
    sink = sink_in(tmp_path, port=port, **{way: True})
    sink.start(Session(name="live"))
    for step in range(20):
        sink.on_belief(belief(1.0 + 0.1 * step, Pose2(0.1 * step, 0.0, 0.0)))
    sink.close()

    kept = [row["LineStrips3D:strips"] for row in read(tmp_path / "run.rrd")["/map/way"]]
    assert len(kept) == 19
    until_s = time.monotonic() + 30.0
    sent: list[Any] = []
    while len(sent) < 19 and time.monotonic() < until_s:
        time.sleep(0.1)
        with warnings.catch_warnings(), suppress(ValueError):  # it is being written, and has no end yet
            warnings.simplefilter("ignore")
            sent = [row["LineStrips3D:strips"] for row in read(received)["/map/way"]]
    assert sent == kept


def test_a_viewer_that_is_closed_in_the_middle_costs_neither_run_nor_file(
    tmp_path: Path, viewer: tuple[int, Path, int]
) -> None:
    port, _, pid = viewer
    sink = sink_in(tmp_path, live=True, port=port)
    sink.start(Session())
    sink.on_belief(belief(1.0))
    os.killpg(pid, signal.SIGKILL)

    for step in range(200):
        sink.on_belief(belief(1.1 + 0.1 * step))
    began_s = time.monotonic()
    sink.close()

    assert time.monotonic() - began_s < 15.0
    assert len(read(tmp_path / "run.rrd")["/belief/travelled_m"]) == 201
