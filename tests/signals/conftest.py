"""Commands in processes of their own, with a robot that writes down what happens to it."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

PLUGIN = Path(__file__).with_name("toy_robot.py")
#: All that a child may hear: a shell's background and ``nohup`` would have it ignore some of them.
HEARD = (
    *(signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT),
    *(signal.SIGUSR1, signal.SIGXCPU, signal.SIGTSTP),
)

# With so many others for each processor, what takes 0.3 s by itself takes longer than the two seconds.
_BUSY = 3.0

CONFIG = """
sources: {robot: {plugin: toy_robot}}
localizers: {mover: {plugin: toy_mover}}
controller: toy_driver
"""


class Child:
    """A command at work."""

    def __init__(self, folder: Path, *words: object, ignored: tuple[int, ...] = ()) -> None:
        self.folder = folder

        def set_signals() -> None:
            for number in HEARD:
                signal.signal(number, signal.SIG_IGN if number in ignored else signal.SIG_DFL)

        command = [sys.executable, "-m", "trailmark.cli", "--plugin", str(PLUGIN), *map(str, words)]
        self.process = subprocess.Popen(
            command,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            preexec_fn=set_signals,
            env=os.environ | {"MPLBACKEND": "svg"},
        )
        self.stdout = self.stderr = ""
        self.took_s = 0.0
        self.load = 1.0

    def wait_for(self, condition: Callable[[], bool], limit_s: float = 180.0) -> None:
        """Return when something is so."""
        until_s = time.monotonic() + limit_s
        while not condition():
            assert self.process.poll() is None, self.process.communicate()[1].decode()
            assert time.monotonic() < until_s, f"{condition} is not so after {limit_s} s"
            time.sleep(0.005)

    def wait_for_output(self, word: str) -> None:
        """Return when a line with a word has come on standard output."""
        assert self.process.stdout is not None
        while word not in (line := self.process.stdout.readline().decode()):
            assert line, self.process.communicate()[1].decode()

    def send(self, number: int) -> None:
        """Send a signal; the time until the end counts from here."""
        self._sent_s = time.monotonic()
        self.process.send_signal(number)

    @property
    def is_suspended(self) -> bool:
        """Whether every thread of it stands still."""
        states = [(thread / "stat").read_text() for thread in Path(f"/proc/{self.process.pid}/task").iterdir()]
        return all(state.rpartition(")")[2].split()[0] == "T" for state in states)

    def end(self, *, may_be_cut_off: bool = False) -> int:
        """Wait for the end, and return the exit code."""
        assert self.process.stdout is not None
        ended = os.pidfd_open(self.process.pid)
        select.select([ended], [], [], 120.0)
        self.took_s = time.monotonic() - self._sent_s
        self.load = max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
        os.close(ended)
        out, err = self.process.communicate(timeout=1.0)
        self.stdout, self.stderr = out.decode(), err.decode()
        if not may_be_cut_off and self.load > _BUSY and self.was_cut_off:
            pytest.skip("this machine is too busy for an end in order within two seconds")
        return self.process.returncode

    @property
    def was_cut_off(self) -> bool:
        """Whether it left before everything had come to its end."""
        return "not everything came to its end in time" in self.stderr

    def took_less_than(self, limit_s: float) -> bool:
        """Return whether it ended in time; where others keep the machine busy, its share of it is what counts."""
        return self.took_s < limit_s * self.load

    def told(self) -> list[str]:
        """Return what happened to the robot, in order."""
        log = self.folder / "robot.log"
        return [line.split(" ", 1)[1] for line in log.read_text().splitlines()] if log.exists() else []

    def told_at_s(self, word: str) -> float:
        """Return when the robot was told something for the first time [s]."""
        lines = (self.folder / "robot.log").read_text().splitlines()
        return next(float(line.split()[0]) for line in lines if word in line)

    @property
    def is_under_way(self) -> bool:
        """Whether the robot has been told to move."""
        return any(line.startswith("drive Velocity") for line in self.told())

    def run_document(self, out: str = "out") -> dict[str, Any]:
        """Return ``run.json``."""
        document: dict[str, Any] = json.loads((self.folder / out / "run.json").read_text())
        return document


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Child]]:
    """Starts ``trailmark WORDS`` in a folder with the config ``c.yaml``; what is left of it is killed afterwards."""
    children: list[Child] = []

    def start(*words: object, config: str = CONFIG, ignored: tuple[int, ...] = ()) -> Child:
        (tmp_path / "c.yaml").write_text(config)
        children.append(Child(tmp_path, *words, ignored=ignored))
        return children[-1]

    yield start
    for child in children:
        child.process.kill()
        child.process.communicate()
