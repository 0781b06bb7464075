"""Teach, replay and stop: one run at a time, ended as by Ctrl-C."""

from __future__ import annotations

import errno
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from trailmark.isolation.tasks import TaskRunner, task_command


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
def runner(tmp_path: Path, said: list[str], endless_program: str) -> Iterator[TaskRunner]:
    lines = {
        "teach": [sys.executable, "-S", "-c", endless_program, str(tmp_path / "teach")],
        "replay": [sys.executable, "-S", "-c", "import sys; sys.exit(3)"],
    }
    runner = TaskRunner(lines.__getitem__, said.append)
    runner.begin()
    yield runner
    runner.stop()


def wait_for(path: Path) -> None:
    until_s = time.monotonic() + 60.0
    while not (path.exists() and path.read_text()):
        assert time.monotonic() < until_s
        time.sleep(0.01)


def test_a_run_is_stopped_as_ctrl_c_does(runner: TaskRunner, said: list[str], tmp_path: Path) -> None:
    assert runner.take("teach") == ""
    wait_for(tmp_path / "teach")
    assert runner.is_running

    assert runner.take("stop") == ""

    assert said == ["idle", "teach", "stopping teach", "idle: teach was stopped"]
    assert (tmp_path / "teach").read_text() == str(int(signal.SIGINT))
    assert not runner.is_running


def test_what_cannot_be_done_is_refused(runner: TaskRunner) -> None:
    runner.take("teach")

    assert runner.take("replay") == "replay is refused: teach is going on"
    assert "is no task" in runner.take("rm -rf /")
    assert runner.state == "teach"


@pytest.mark.parametrize("fails_in", ["the command line", "the program"])
def test_a_run_that_cannot_begin_is_refused(said: list[str], tmp_path: Path, fails_in: str) -> None:
    def command_of(task: str) -> list[str]:
        if fails_in == "the program":
            return [str(tmp_path / "nowhere")]
        raise OSError(errno.ENOSPC, "No space left on device")

    runner = TaskRunner(command_of, said.append)
    runner.begin()

    refusal = runner.take("teach")

    assert refusal.startswith("teach cannot begin: ")
    assert refusal.endswith("No such file or directory" if fails_in == "the program" else "No space left on device")
    assert not runner.is_running
    assert said == ["idle"]


def test_what_goes_on_is_looked_at_while_a_run_is_being_stopped(
    runner: TaskRunner, said: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runner.take("teach")
    wait_for(tmp_path / "teach")
    assert runner._running is not None
    end, looked = runner._running.end, []

    def look() -> None:
        runner.look()
        looked.extend([runner.state, runner.is_running, runner.take("replay")])

    def end_when_looked_at(name: str) -> None:
        looker = threading.Thread(target=look, daemon=True)
        looker.start()
        looker.join(10.0)  # it comes back at once, or not before the end
        looked.append("the end")
        end(name)

    monkeypatch.setattr(runner._running, "end", end_when_looked_at)
    assert runner.take("stop") == ""

    assert looked == ["stopping teach", True, "replay is refused: teach is being stopped", "the end"]
    assert said == ["idle", "teach", "stopping teach", "idle: teach was stopped"]
    assert not runner.is_running


def test_how_a_run_ended_by_itself_is_said(runner: TaskRunner, said: list[str]) -> None:
    runner.take("replay")
    while runner.is_running:
        runner.look()
        time.sleep(0.01)

    assert said[-1] == "idle: replay ended with exit code 3"


def test_teaching_replaces_the_path_and_replaying_does_not() -> None:
    teach = task_command("teach", Path("r.yaml"), Path("p.trail"), settings=["seed=1"])
    replay = task_command("replay", Path("r.yaml"), Path("p.trail"), settings=["seed=1"])

    assert teach[-1] == "--overwrite-store"
    assert replay[4:] == ["replay", "r.yaml", "--store", "p.trail", "--set", "seed=1"]


#: Begins a run as a page or `ros2 serve` does, and stays.
BEGINNER = """
import sys, time
from trailmark.isolation.tasks import TaskRunner
runner = TaskRunner(lambda task: sys.argv[1:], lambda state: None)
runner.begin()
runner.take("teach")
time.sleep(60)
"""
#: Runs until it is told to end, as a command of ours would hear of it.
ORPHAN = """
import os, pathlib, signal, sys, time
from trailmark.isolation.orphan import ENDS_WITH_STDIN, end_with_stdin
assert os.environ[ENDS_WITH_STDIN]
def end(number, frame):
    pathlib.Path(sys.argv[1] + ".end").write_text(str(number))
    sys.exit(143)
signal.signal(signal.SIGTERM, end)
end_with_stdin()
pathlib.Path(sys.argv[1]).write_text("runs")
time.sleep(60)
"""


def test_a_run_ends_when_the_program_that_began_it_is_killed(tmp_path: Path) -> None:
    run = [sys.executable, "-c", ORPHAN, str(tmp_path / "teach")]
    beginner = subprocess.Popen([sys.executable, "-c", BEGINNER, *run])
    wait_for(tmp_path / "teach")

    beginner.kill()
    beginner.wait()

    wait_for(tmp_path / "teach.end")
    assert (tmp_path / "teach.end").read_text() == str(int(signal.SIGTERM))
