"""Processes that run cases, and are started again when they die, hang, or have run many."""

from __future__ import annotations

import json
import select
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from tests.trust.storm.oracle import PATIENCE_S

__all__ = ["WAITING_S", "Worker"]

#: What waits without working for so long hangs; what works and gets no processor, because others have it, does not [s].
WAITING_S = 60.0
_LOOK_S = 1.0
_CASES_PER_WORKER = 2000


class Worker:
    """A process that runs cases.

    Parameters
    ----------
    box : Path
        Folder of good inputs.
    """

    def __init__(self, box: Path) -> None:
        self._box = box
        self._process: subprocess.Popen[str] | None = None
        self._n = 0

    def run(self, target: str, number: int, patience_s: float = PATIENCE_S) -> dict[str, Any]:
        """Return the answer to a case; a worker that dies or does not answer is a finding."""
        process = self._working_process()
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(f"{target} {number} {patience_s}\n")
        process.stdin.flush()
        if not _answers(process):
            self.close()
            return _broken(f"no answer after {WAITING_S:g} s of waiting", "none")
        line = process.stdout.readline()
        if not line:
            code = process.wait()
            self.close()
            return _broken(f"the process died with {code}", "died")
        answer: dict[str, Any] = json.loads(line)
        return _broken("the case itself is broken", answer["broken"]) if "broken" in answer else answer

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def _working_process(self) -> subprocess.Popen[str]:
        if self._process is None or self._process.poll() is not None or self._n >= _CASES_PER_WORKER:
            self.close()
            command = (sys.executable, "-m", "tests.trust.storm.worker", str(self._box))
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
            )
            _be_as_nice(self._process.pid)
            self._n = 0
        self._n += 1
        return self._process


def _broken(finding: str, code: str) -> dict[str, Any]:
    return {"findings": [finding], "code": code, "cpu_s": 0.0, "peak_mib": 0.0}


def _answers(process: subprocess.Popen[str]) -> bool:
    """Return whether a process answers; not if it only waits, for too long."""
    waited_s = 0.0
    while waited_s < WAITING_S:
        if select.select([process.stdout], [], [], _LOOK_S)[0]:
            return True
        waited_s = 0.0 if _is_at_work(process.pid) else waited_s + _LOOK_S
    return False


def _is_at_work(pid: int) -> bool:
    """Return whether a thread of a process runs, would run if it had a processor, or waits for a disk."""
    for thread in Path(f"/proc/{pid}/task").glob("*/stat"):
        with suppress(OSError):  # it has ended meanwhile
            if thread.read_text().rpartition(")")[2].split()[0] in "RD":
                return True
    return False


def _be_as_nice(pid: int) -> None:
    """Let a process that leads a session of its own have the priority of ours: on Linux sessions compete."""
    with suppress(OSError, IndexError):
        ours = Path("/proc/self/autogroup").read_text().split()[-1]
        time.sleep(0.05)  # until it has its session
        Path(f"/proc/{pid}/autogroup").write_text(ours)
