"""Teach, replay and stop by a topic."""

from __future__ import annotations

import signal
import sys

import pytest

pytest.importorskip("cyclonedds", reason="the extra [ros2] is not installed")

from click.testing import CliRunner

from trailmark_ros2 import dds
from trailmark_ros2.commands import ros2
from trailmark_ros2.message_types import new_message
from trailmark_ros2.tasks import STRING, TaskServer

LATCHED = dds.Quality(is_latched=True, depth=1)


@pytest.fixture
def server(domain, tmp_path, endless_program):
    network = dds.Network(domain)
    lines = {
        "teach": [sys.executable, "-c", endless_program, str(tmp_path / "teach")],
        "replay": [sys.executable, "-c", "import sys; sys.exit(3)"],
    }
    server = TaskServer(network, task="/trailmark/task", state="/trailmark/state", command_of=lines.__getitem__)
    yield server
    server.serve(lambda: True)  # ends what is going on
    network.close()


@pytest.fixture
def told(server, robot, wait_for):
    """Return what tells a task and waits until the state begins with a word; returns the state."""
    states = robot.hear("/trailmark/state", STRING, LATCHED)
    heard: list[str] = []

    def state_is(beginning: str) -> bool:
        server.step()
        heard.extend(message.data for message in states.messages())
        return bool(heard) and heard[-1].startswith(beginning)

    def tell(task: str, beginning: str) -> str:
        robot.send("/trailmark/task", new_message(STRING, {"data": task}))
        assert wait_for(lambda: state_is(beginning)), heard
        return heard[-1]

    robot.send("/trailmark/task", new_message(STRING, {"data": "hello"}))
    wait_for(lambda: server._tasks.n_matched and states.n_matched)
    return tell


def test_a_run_is_started_and_stopped_as_ctrl_c_does(told, tmp_path, wait_for) -> None:
    told("teach", "teach")
    assert wait_for(lambda: (tmp_path / "teach").exists())

    state = told("stop", "idle")

    assert state == "idle: teach was stopped"
    assert (tmp_path / "teach").read_text() == str(int(signal.SIGINT))


def test_how_a_run_ended_is_said(told) -> None:
    assert told("replay", "idle") == "idle: replay ended with exit code 3"


def test_one_run_at_a_time_and_no_other_words(told, server, caplog) -> None:
    told("teach", "teach")
    for word in ("replay", "rm -rf /"):
        told(word, "teach")
        for _ in range(20):
            server.step()

    assert "replay is refused: teach is going on" in caplog.text
    assert "'rm -rf /' is no task" in caplog.text


def test_a_server_that_ends_ends_its_run(told, server, tmp_path, wait_for) -> None:
    told("teach", "teach")
    assert wait_for(lambda: (tmp_path / "teach").exists())

    server.serve(lambda: True)

    assert (tmp_path / "teach").read_text() == str(int(signal.SIGINT))


def test_the_commands_say_what_they_need() -> None:
    runner = CliRunner()

    assert "Missing option '--store'" in runner.invoke(ros2, ["serve", "robot.yaml"]).output
    assert "/NAME/image_raw" in runner.invoke(ros2, ["robot", "--help"]).output
