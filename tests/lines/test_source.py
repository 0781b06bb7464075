"""A robot of any language: lines in, commands out."""

from __future__ import annotations

import base64
import contextlib
import errno
import io
import itertools
import json
import math
import os
import pty
import re
import socket
import subprocess
import sys
import textwrap
import threading
import time
import tty
from pathlib import Path

import cv2
import numpy as np
import pytest

from trailmark.api import create
from trailmark.commands import Steer4WS, Stop, Velocity
from trailmark.errors import ConfigError, SourceError
from trailmark.interfaces import Session
from trailmark.plugins import load_plugins
from trailmark.testing import source_checks
from trailmark_lines.channels import StandardChannel
from trailmark_lines.readings import LineReader

GREY = np.random.default_rng(7).integers(0, 255, (48, 64), dtype=np.uint8)


def line(sensor: str, stamp_s: float | None = None, **fields) -> bytes:
    document = {"sensor": sensor, **fields} | ({} if stamp_s is None else {"stamp_s": stamp_s})
    return json.dumps(document).encode() + b"\n"


def wheels(stamp_s: float) -> bytes:
    return line("wheels", stamp_s, pose_start_base=[stamp_s, 0.0, 0.0])


@pytest.fixture
def opened():
    sources = []

    def open_source(mode="replay", session=None, **keys):
        source = create("source", "lines", **{"sensors": {"wheels": "odometry"}, "port": 0, **keys})
        sources.append(source)
        source.start(session or Session("robot", mode))
        return source

    yield open_source
    for source in sources:
        source.close()


def drive_on(source) -> None:
    """Give commands, until they do not fit anywhere any more."""
    for _ in range(200_000):
        source.drive(Velocity(0.3))


def read(kinds, document, pictures=None):
    return LineReader(kinds, pictures).frame(document, 5.0)


class TestReadings:
    def test_odometry_is_a_pose_or_a_distance(self) -> None:
        frame = read(
            {"w": "odometry"}, {"sensor": "w", "stamp_s": 1.5, "pose_start_base": [1, 2, 0.5], "twist": [0.3, 0, 0.1]}
        )

        assert frame.stamp_s == 1.5
        assert (frame.payload.pose_start_base.y, frame.payload.twist.yaw_radps) == (2.0, 0.1)
        assert read({"w": "odometry"}, {"sensor": "w", "distance_m": 3}).payload.distance_m == 3.0

    def test_a_frame_without_a_stamp_is_of_its_arrival(self) -> None:
        assert read({"light": "scalar"}, {"sensor": "light", "value": 0.7}).stamp_s == 5.0

    def test_pictures_come_as_base64(self) -> None:
        data = base64.b64encode(cv2.imencode(".png", GREY)[1]).decode()

        assert np.array_equal(read({"front": "image"}, {"sensor": "front", "png": data}).payload.pixels, GREY)

    def test_pictures_come_as_files_of_one_folder(self, tmp_path: Path) -> None:
        cv2.imwrite(str(tmp_path / "a.png"), GREY)

        frame = read({"front": "image"}, {"sensor": "front", "path": "a.png"}, tmp_path)

        assert np.array_equal(frame.payload.pixels, GREY)

    def test_no_other_file_is_opened(self, tmp_path: Path) -> None:
        (tmp_path / "in").mkdir()
        cv2.imwrite(str(tmp_path / "a.png"), GREY)

        with pytest.raises(SourceError, match="lies outside of"):
            read({"front": "image"}, {"sensor": "front", "path": "../a.png"}, tmp_path / "in")
        with pytest.raises(SourceError, match="names no folder"):
            read({"front": "image"}, {"sensor": "front", "path": "/etc/passwd"})

    def test_scans_know_what_they_did_not_see(self) -> None:
        document = {"sensor": "laser", "ranges_m": [1.0, None, 2.5], "angle_min_rad": -0.1, "angle_step_rad": 0.1}

        assert np.array_equal(read({"laser": "scan"}, document).payload.ranges_m, [1.0, np.nan, 2.5], equal_nan=True)

    def test_inertial_readings_and_poses(self) -> None:
        imu = read({"imu": "imu"}, {"sensor": "imu", "angular_velocity_radps": [0, 0, 0.2]}).payload
        pose = read({"gps": "pose"}, {"sensor": "gps", "pose": [1, 2, 0]}).payload

        assert imu.angular_velocity_radps[2] == 0.2
        assert imu.linear_acceleration_mps2 is None
        assert pose.arrays["pose"].tolist() == [1.0, 2.0, 0.0]
        assert np.isnan(pose.arrays["covariance"]).all()

    @pytest.mark.parametrize(
        ("document", "said"),
        [
            ({"sensor": "other"}, "a line of sensor 'other'; the config names wheels"),
            ({"sensor": "wheels", "pose_start_base": [1.0, 2.0]}, "2 numbers where there should be 3"),
            ({"sensor": "wheels"}, "odometry needs a pose or a distance"),
            ({"sensor": "wheels", "pose_start_base": [math.nan, 0.0, 0.0]}, "pose is not finite"),
            ({"sensor": "wheels", "distance_m": 1.0, "stamp_s": math.inf}, "not finite"),
        ],
    )
    def test_what_cannot_be_used_is_said(self, document, said) -> None:
        with pytest.raises(SourceError, match=said.replace("(", r"\(")):
            read({"wheels": "odometry"}, document)


def test_a_program_in_a_pipe_is_a_robot(tmp_path: Path) -> None:
    """The whole way: a program's lines into `trailmark run`, beliefs out."""
    robot = "".join(wheels(0.1 * k).decode() for k in range(50)) + '{"type": "end"}\n'
    config = tmp_path / "robot.yaml"
    config.write_text(
        textwrap.dedent("""\
            sources:
              robot: {plugin: lines, sensors: {wheels: odometry}}
            localizers: {wheels: {plugin: odometry}}
            estimator: {plugin: kalman}
            sinks: [{plugin: jsonl}]
            """)
    )
    command = [sys.executable, "-m", "trailmark.cli", "run", str(config), "--out", str(tmp_path / "run"), "--no-report"]

    done = subprocess.run(command, input=robot, capture_output=True, text=True, check=False, timeout=120.0)

    assert done.returncode == 0, done.stderr
    beliefs = [json.loads(said) for said in done.stdout.splitlines() if said.startswith('{"type":"belief"')]
    assert len(beliefs) == 50
    assert beliefs[-1]["pose_map_base"][0] == pytest.approx(4.9, abs=1e-6)


def test_a_robot_over_tcp_gets_its_commands_back(opened) -> None:
    source = opened(over="tcp", command="velocity")
    with socket.create_connection(("127.0.0.1", source.port)) as robot:
        robot.sendall(wheels(1.0) + wheels(2.0))
        assert [frame.stamp_s for frame in itertools.islice(source.frames(), 2)] == [1.0, 2.0]

        source.drive(Velocity(0.4, 0.0, 0.1))
        said = json.loads(robot.makefile().readline())

    assert (said["kind"], said["forward_mps"], said["yaw_radps"]) == ("Velocity", 0.4, 0.1)


def test_a_robot_that_connects_again_goes_on(opened) -> None:
    source = opened(over="tcp")
    frames = source.frames()
    with socket.create_connection(("127.0.0.1", source.port)) as robot:
        robot.sendall(wheels(1.0) + b'{"sensor": "wheels", "half')
        assert next(frames).stamp_s == 1.0

    with socket.create_connection(("127.0.0.1", source.port)) as robot:
        robot.sendall(wheels(2.0))
        assert next(frames).stamp_s == 2.0

    assert source.counters() == {"skipped": 1}


def test_a_robot_over_udp_is_answered_where_it_sent_from(opened) -> None:
    source = opened(over="udp", command="steer_4ws")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        robot.settimeout(10.0)
        robot.sendto(wheels(1.0), ("127.0.0.1", source.port))
        assert next(source.frames()).stamp_s == 1.0

        source.drive(Steer4WS(0.1, -0.1, 0.3))
        said = json.loads(robot.recv(2000))

    assert (said["front_rad"], said["rear_rad"], said["speed_mps"]) == (0.1, -0.1, 0.3)


def test_a_robot_on_a_serial_line(opened) -> None:
    """Tried against a pseudo terminal: what a microcontroller on USB looks like."""
    robot, port = pty.openpty()
    tty.setraw(robot)
    source = opened(over="device", device=os.ttyname(port), command="velocity")
    os.write(robot, wheels(1.0))
    assert next(source.frames()).stamp_s == 1.0

    source.drive(Stop("enough"))
    said = json.loads(os.read(robot, 2000))

    assert (said["kind"], said["reason"]) == ("Stop", "enough")
    os.close(robot)
    os.close(port)


def test_half_a_command_on_a_serial_line_does_not_spoil_the_next(opened) -> None:
    master, slave = pty.openpty()
    tty.setraw(master)
    source = opened(over="device", device=os.ttyname(slave), command="velocity")

    with pytest.raises(SourceError, match="takes no commands"):
        drive_on(source)
    os.set_blocking(master, False)
    stuck = b""
    with contextlib.suppress(BlockingIOError):
        while True:
            stuck += os.read(master, 4096)
    source.drive(Stop("enough"))
    time.sleep(0.1)
    told = (stuck + os.read(master, 4096)).splitlines()
    os.close(master)
    os.close(slave)

    assert json.loads(told[-1])["kind"] == "Stop"
    assert {json.loads(command)["kind"] for command in told[:-2]} == {"Velocity"}


def test_who_connects_and_does_not_read_does_not_hold_the_run(opened) -> None:
    source = opened(over="tcp", command="velocity")
    with socket.create_connection(("127.0.0.1", source.port)) as robot:
        robot.sendall(wheels(1.0))
        next(source.frames())
        began_s = time.monotonic()
        threading.Timer(10.0, robot.close).start()  # so that the test ends if it fails

        with pytest.raises(SourceError, match="does not read the commands"):
            drive_on(source)

    assert time.monotonic() - began_s < 9.0


def test_a_device_that_is_not_there_is_said(opened) -> None:
    with pytest.raises(SourceError, match="cannot open /dev/no_such_port"):
        opened(over="device", device="/dev/no_such_port")


def test_a_port_that_is_taken_is_said(opened) -> None:
    first = opened(over="tcp")

    with pytest.raises(SourceError, match=f"cannot listen at 127.0.0.1:{first.port}"):
        opened(over="tcp", port=first.port)


def test_a_pose_that_is_told_is_passed_on(opened) -> None:
    told = []
    session = Session("robot", tell_pose=lambda pose, covariance: told.append((pose.array().tolist(), covariance)))
    source = opened(session=session, over="udp")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        robot.sendto(b'{"type": "pose", "pose_map_base": [1, 2, 0.5]}\n' + wheels(1.0), ("127.0.0.1", source.port))
        next(source.frames())

    assert told == [([1.0, 2.0, 0.5], None)]


def test_lines_that_are_none_are_counted_and_end_nothing(opened) -> None:
    source = opened(over="udp")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        rubbish = (
            b"hello",
            b"[1, 2]",
            b'{"sensor": "nobody"}',
            b"[" * 5000,
            b"\xff\xfe",
            b'{"type": "pose"}',
            b'{"type": "pose", "pose_map_base": [0, 0, %d]}' % 10**400,
        )
        for data in rubbish:
            robot.sendto(data + b"\n", ("127.0.0.1", source.port))
        robot.sendto(wheels(2.0) + wheels(1.0) + wheels(2.0) + wheels(3.0), ("127.0.0.1", source.port))
        frames = list(itertools.islice(source.frames(), 2))

    assert [frame.stamp_s for frame in frames] == [2.0, 3.0]
    assert source.counters() == {"skipped": len(rubbish), "went_back": 1, "repeated": 1}


def test_a_clock_that_begins_anew_is_said_once(opened, caplog) -> None:
    source = opened(over="udp")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        for stamp_s in (100.0, 1.0, 2.0, 101.0):
            robot.sendto(wheels(stamp_s), ("127.0.0.1", source.port))
        frames = list(itertools.islice(source.frames(), 2))

    assert [frame.stamp_s for frame in frames] == [100.0, 101.0]
    assert source.counters() == {"went_back": 2}
    assert caplog.text.count("wheels: stamp_s went back from 100 s to 1 s") == 1
    assert caplog.text.count("went back") == 1


def test_one_stamp_of_the_future_costs_its_own_line_alone(opened) -> None:
    source = opened(over="udp")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        for stamp_s in (1.0, 1.1, 1.2, 1.3, 1.4, 4e9, 1.5, 1.6):
            robot.sendto(wheels(stamp_s), ("127.0.0.1", source.port))
        frames = list(itertools.islice(source.frames(), 7))

    assert [frame.stamp_s for frame in frames] == [1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6]
    assert source.counters() == {"skipped": 1}


def test_one_line_without_a_stamp_among_others_costs_itself_alone(opened, caplog) -> None:
    source = opened(over="udp")
    now_s = time.time()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        for stamp_s in (now_s - 5.0, None, now_s - 4.9, now_s - 4.8):  # it would be of now, and those after it older
            robot.sendto(line("wheels", stamp_s, distance_m=1.0), ("127.0.0.1", source.port))
        frames = list(itertools.islice(source.frames(), 3))

    assert [frame.stamp_s for frame in frames] == [now_s - 5.0, now_s - 4.9, now_s - 4.8]
    assert source.counters() == {"skipped": 1}
    assert "a line of 'wheels' came without a stamp_s, those before it were not so: two clocks" in caplog.text


def test_a_first_line_that_alone_has_no_stamp_costs_few_of_those_after_it(opened, caplog) -> None:
    source = opened(over="udp")
    now_s = time.time() + 5.0  # a clock that is ahead of ours, so that none goes back
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        for stamp_s in (None, *(now_s + i / 10 for i in range(6))):
            robot.sendto(line("wheels", stamp_s, distance_m=1.0), ("127.0.0.1", source.port))
        frames = list(itertools.islice(source.frames(), 6))

    assert [frame.stamp_s for frame in frames[1:]] == [now_s + i / 10 for i in range(1, 6)]
    assert source.counters() == {"skipped": 1}
    assert "most lines of 'wheels' come with a stamp_s now: they are used" in caplog.text


def test_a_robot_that_begins_to_stamp_late_is_heard_again(opened) -> None:
    source = opened(over="udp")
    now_s = time.time() + 5.0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        for stamp_s in (*[None] * 50, *(now_s + i / 10 for i in range(10))):
            robot.sendto(line("wheels", stamp_s, distance_m=1.0), ("127.0.0.1", source.port))
        frames = list(itertools.islice(source.frames(), 55))

    assert frames[-1].stamp_s == pytest.approx(now_s + 0.9)
    assert source.counters() == {"skipped": 5}


def test_each_problem_of_each_sensor_is_told_once(opened, caplog) -> None:
    source = opened(over="udp", sensors={"wheels": "odometry", "lamp": "scalar"})
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        for data in (b"hello", line("lamp", 1.0), line("lamp", 1.0), wheels(1.0), line("wheels", distance_m=1.0)):
            robot.sendto(data, ("127.0.0.1", source.port))
        robot.sendto(line("wheels", 1.1), ("127.0.0.1", source.port))
        robot.sendto(wheels(1.2) + wheels(1.3), ("127.0.0.1", source.port))
        list(itertools.islice(source.frames(), 2))

    assert source.counters() == {"skipped": 5}
    assert [
        caplog.text.count(said) for said in ("is no JSON", "'lamp' lacks", "two clocks", "a line of 'wheels' cannot")
    ] == [1, 1, 1, 1]


def test_a_first_stamp_of_the_future_ends_the_run(opened) -> None:
    source = opened(over="udp")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        for stamp_s in (4e9, 1.5, 1.6, 1.7):
            robot.sendto(wheels(stamp_s), ("127.0.0.1", source.port))

        with pytest.raises(SourceError, match=r"the first stamp of 'wheels' was 399999999\d s ahead of all after it"):
            list(itertools.islice(source.frames(), 2))


@pytest.mark.parametrize("stamp_s", [1.7e12, -1.7e18])
def test_stamps_that_are_no_seconds_are_refused(opened, caplog, stamp_s: float) -> None:
    source = opened(over="udp")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        robot.sendto(wheels(stamp_s) + wheels(1.5), ("127.0.0.1", source.port))

        assert next(source.frames()).stamp_s == 1.5
    assert f"stamp_s is {stamp_s:g}, which are no seconds; milliseconds or nanoseconds?" in caplog.text


class TestBrokenChannels:
    """Whatever the system says of a channel, it is told in words."""

    def test_one_that_cannot_be_read(self, opened, monkeypatch) -> None:
        source = opened(over="udp")

        def fail(*_: object) -> None:
            raise OSError(errno.ENETDOWN, os.strerror(errno.ENETDOWN))

        monkeypatch.setattr(source._channel, "read", fail)

        with pytest.raises(SourceError, match="nothing can be read from udp any more: Network is down"):
            next(source.frames())

    def test_standard_input_that_is_closed(self, opened, monkeypatch) -> None:
        with open(os.devnull) as closed:
            pass
        monkeypatch.setattr(sys, "stdin", closed)
        source = opened(over="stdin")

        with pytest.raises(SourceError, match="nothing can be read from stdin any more: I/O operation on closed file"):
            next(source.frames())

    def test_one_that_cannot_be_written(self, opened) -> None:
        source = opened(over="udp", command="velocity")
        source._channel._peer = ("127.0.0.1", 0)  # a port that nobody can have

        with pytest.raises(SourceError, match=r"no command can be sent to 127\.0\.0\.1: Invalid argument"):
            source.drive(Velocity(0.1))


def test_while_a_person_teaches_nothing_but_stops_is_sent(opened) -> None:
    source = opened("teach", over="tcp", command="velocity")
    with socket.create_connection(("127.0.0.1", source.port)) as robot:
        robot.sendall(wheels(1.0))
        next(source.frames())
        source.drive(Velocity(0.4))
        source.drive(Stop("enough"))

        assert json.loads(robot.makefile().readline())["kind"] == "Stop"


def test_a_command_of_another_robot_is_refused(opened) -> None:
    source = opened(over="udp", command="velocity")

    with pytest.raises(ConfigError, match="takes no Steer4WS"):
        source.drive(Steer4WS(0.1, 0.1, 0.1))


def test_closing_ends_the_frames(opened) -> None:
    source = opened(over="udp")
    threading.Timer(0.2, source.close).start()

    began_s = time.monotonic()
    assert list(source.frames()) == []
    assert time.monotonic() - began_s < 5.0


SPEC = load_plugins().registry.find("source", "lines")


@pytest.mark.parametrize("name", sorted(source_checks(SPEC.load(), lambda: None)))
def test_contract(name, tmp_path) -> None:
    pipe = tmp_path / "robot"
    os.mkfifo(pipe)
    writer = os.open(pipe, os.O_RDWR)
    os.write(writer, b"".join(wheels(0.1 * k) for k in range(400)) + b'{"type": "end"}\n')
    keys = {"sensors": {"wheels": "odometry"}, "over": "device", "device": str(pipe), "command": "velocity"}

    source_checks(SPEC.load(), lambda: SPEC.load_config().model_validate(keys), n_frames=20)[name]()

    os.close(writer)


def test_a_full_pipe_that_nobody_reads_does_not_hold_the_run(monkeypatch) -> None:
    reading, writing = os.pipe()
    os.set_blocking(writing, True)
    with os.fdopen(writing, "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        channel = StandardChannel()
        began_s = time.monotonic()

        def fill() -> None:
            for _ in range(200_000):
                channel.write(b"x" * 100 + b"\n")

        with pytest.raises(SourceError, match="standard output takes no commands: nobody reads them"):
            fill()
        monkeypatch.undo()
        os.close(reading)
    assert time.monotonic() - began_s < 9.0


@pytest.mark.parametrize(("works_s", "is_said"), [(0.0, True), (0.9, False)], ids=["falls silent", "is not looked at"])
def test_a_robot_that_falls_silent_is_said_but_not_where_the_run_works_meanwhile(
    works_s: float, is_said: bool, opened, monkeypatch, caplog
) -> None:
    monkeypatch.setattr("trailmark_lines.source._SILENCE_S", 0.5)
    source = opened(over="udp")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        robot.sendto(wheels(1.0), ("127.0.0.1", source.port))
        frames = source.frames()
        next(frames)
        threading.Timer(1.0, lambda: robot.sendto(wheels(1.1), ("127.0.0.1", source.port))).start()
        time.sleep(works_s)
        next(frames)

    assert caplog.text.count("the robot is silent: nothing has come over udp") == is_said
    assert bool(re.search(r"back after \d", caplog.text)) == is_said


def test_a_robot_that_goes_while_it_is_driven_fails_the_run(opened) -> None:
    source = opened(over="udp", command="velocity")
    source.drive(Velocity(0.3))
    source._channel.read = lambda timeout_s: None

    with pytest.raises(SourceError, match=r"the robot's program is gone: .* while it was driven"):
        list(source.frames())


def test_commands_go_to_standard_output_that_is_replaced(monkeypatch) -> None:
    replaced = io.StringIO()  # as in a notebook
    monkeypatch.setattr(sys, "stdout", replaced)

    StandardChannel().write(b"{}\n")

    assert replaced.getvalue() == "{}\n"


@pytest.mark.parametrize(("command", "is_said"), [("velocity", True), (None, False)])
def test_a_robot_that_is_driven_and_goes_without_a_word_is_said(opened, tmp_path, caplog, command, is_said) -> None:
    pipe = tmp_path / "robot"
    os.mkfifo(pipe)
    writer = os.open(pipe, os.O_RDWR)
    source = opened(over="device", device=str(pipe), command=command)
    os.write(writer, wheels(1.0))
    monkey = source._channel
    frames = source.frames()
    next(frames)
    monkey.read = lambda timeout_s: None

    assert list(frames) == []
    assert ("the robot's program is gone" in caplog.text) == is_said
    os.close(writer)


@pytest.mark.parametrize(
    ("offset_s", "command", "is_said"),
    [(-1000.0, "velocity", True), (0.0, "velocity", False), (-1000.0, None, False)],  # commands are due by our clock
)
def test_stamps_of_another_clock_are_said_and_lines_that_waited_are_not(
    opened, monkeypatch, caplog, offset_s, command, is_said
) -> None:
    monkeypatch.setattr("trailmark_lines.source._MOST_WAITED_S", 0.2)
    source = opened(over="udp", command=command)
    frames = source.frames()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        for k in range(10):  # the first waits, as those do that are sent while we start
            stamp_s = time.time() + offset_s - (3.0 if k == 0 else 0.0)
            robot.sendto(wheels(stamp_s), ("127.0.0.1", source.port))
            next(frames)
            time.sleep(0.05)

    assert ("stamp_s of 'wheels' are 1e+03 s behind of this machine's clock" in caplog.text) == is_said
    assert caplog.text.count("this machine's clock") == is_said
