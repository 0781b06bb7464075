"""A process for work that may fail: started, watched, ended, accounted for."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from trailmark.errors import ConfigError
from trailmark.isolation.child import EXIT_FAILED, EXIT_SKIPPED
from trailmark.isolation.outcome import Outcome

__all__ = ["REQUEST_FILE", "RESULT_FILE", "IsolatedProcess"]

REQUEST_FILE = "cell.json"
RESULT_FILE = "result.json"

_TAIL_BYTES = 16384
_POLL_S = 0.5
# What a process that is told to show where it hangs gets for doing so.
_LAST_WORDS_S = 0.3

_THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
)


class IsolatedProcess:
    """A process with a request, a folder and limits; `kill` ends it from another thread.

    Parameters
    ----------
    request : mapping
        Plain data, written into the folder; ``limits`` in it holds ``timeout_s`` and ``threads``.
    folder : Path
        An empty folder: what the process leaves is in it afterwards, ``result.json`` among it.
    module : str
        What runs in it, as ``python -m MODULE FOLDER PARENT``.

    Raises
    ------
    ConfigError
        Where processes cannot be accounted for: ``os.wait4`` is of Linux and macOS.
    """

    def __init__(self, request: Mapping[str, Any], folder: Path, module: str) -> None:
        if os.name != "posix":
            raise ConfigError("cells and calls run on Linux and macOS; tables and reports open everywhere")
        self._request = request
        self._module = module
        self._folder = folder
        self._process: subprocess.Popen[bytes] | None = None
        self._is_killed = False
        self._tail: deque[bytes] = deque()
        self._tail_bytes = 0

    def run(self) -> Outcome:
        """Start the process, and return when it has ended, whatever way."""
        (self._folder / REQUEST_FILE).write_text(json.dumps(self._request), encoding="utf-8")
        load = os.getloadavg()[0]
        limit_s = float(self._request["limits"]["timeout_s"])
        began_s = time.monotonic()
        process = self._process = self._start()
        if self._is_killed:
            self._signal(signal.SIGKILL)
        is_late = self._watch(process, began_s + limit_s)
        _, status, usage = os.wait4(process.pid, 0)
        self._signal(signal.SIGKILL)  # of what it started and left behind
        process.returncode = os.waitstatus_to_exitcode(status)
        wall_s = time.monotonic() - began_s
        self._drain(process)
        stderr = b"".join(self._tail)[-_TAIL_BYTES:].decode("utf-8", "replace")
        state, reason = self._verdict(process.returncode, is_late, limit_s, stderr)
        return Outcome(
            state=state,
            reason=reason,
            stderr=stderr,
            wall_s=round(wall_s, 4),
            cpu_s=round(usage.ru_utime + usage.ru_stime, 4),
            peak_rss_mb=round(usage.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3), 1),
            load=round(load, 2),
            host=socket.gethostname(),
        )

    def kill(self) -> None:
        """End the process now."""
        self._is_killed = True
        self._signal(signal.SIGKILL)

    def _start(self) -> subprocess.Popen[bytes]:
        threads = self._request["limits"]["threads"]
        pinned = {} if threads is None else dict.fromkeys(_THREAD_VARIABLES, str(threads))
        environment = os.environ | pinned | {"PYTHONHASHSEED": "0"}
        command = [
            sys.executable,
            "-P",  # not a numpy.py of the folder where all was started
            "-X",
            "faulthandler",
            "-m",
            self._module,
            str(self._folder),
            str(os.getpid()),
        ]
        return subprocess.Popen(
            command,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C is for this process; and what that one starts can be ended with it
        )

    def _watch(self, process: subprocess.Popen[bytes], until_s: float) -> bool:
        """Read what it says until it has ended; return whether it had to be ended because its time was over."""
        assert process.stderr is not None
        is_late, deadline_s = False, until_s
        pipe = process.stderr.fileno()
        os.set_blocking(pipe, False)
        watched = [pipe]
        try:
            ended = os.pidfd_open(process.pid)
        except (AttributeError, OSError):  # not on this system: look now and then
            ended = -1
        if ended >= 0:
            watched.append(ended)
        try:
            while True:
                left_s = deadline_s - time.monotonic()
                patience_s = max(0.0, min(left_s, 60.0 if ended >= 0 else 0.02))
                ready, _, _ = select.select(watched, [], [], patience_s)
                if pipe in ready and not self._read(pipe):
                    watched.remove(pipe)
                if ended in ready or (ended < 0 and _has_ended(process.pid)):
                    return is_late
                if time.monotonic() >= deadline_s:
                    if not is_late:
                        is_late, deadline_s = True, time.monotonic() + _LAST_WORDS_S
                        self._signal(signal.SIGUSR1)  # faulthandler: where does it hang
                    else:
                        self._signal(signal.SIGKILL)
                        deadline_s = time.monotonic() + _POLL_S
        finally:
            if ended >= 0:
                os.close(ended)

    def _drain(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stderr is not None
        while self._read(process.stderr.fileno()):
            pass
        process.stderr.close()

    def _read(self, pipe: int) -> bool:
        """Keep the end of what it says; return whether there was something."""
        try:
            chunk = os.read(pipe, 65536)
        except (BlockingIOError, OSError):
            return False
        self._tail.append(chunk)
        self._tail_bytes += len(chunk)
        while len(self._tail) > 1 and self._tail_bytes - len(self._tail[0]) >= _TAIL_BYTES:
            self._tail_bytes -= len(self._tail.popleft())
        return bool(chunk)

    def _signal(self, number: int) -> None:
        if self._process is not None:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, number)

    def _verdict(self, code: int, is_late: bool, limit_s: float, stderr: str) -> tuple[str, str]:
        if is_late:
            return "timeout", f"not done after {limit_s:g} s"
        result = _result(self._folder)
        if code == 0 and result is not None:
            return str(result["state"]), str(result["reason"])
        if code < 0:
            return "crashed", _signal_words(-code)
        last = next((line for line in reversed(stderr.splitlines()) if line.strip()), "")
        if code in (EXIT_FAILED, EXIT_SKIPPED) and last:
            return "failed" if code == EXIT_FAILED else "skipped", last
        return "crashed", f"left with code {code} without a result" + (f": {last}" if last else "")


def _has_ended(pid: int) -> bool:
    return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def _result(folder: Path) -> dict[str, Any] | None:
    try:
        document = json.loads((folder / RESULT_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return document if isinstance(document, dict) and {"state", "reason"} <= document.keys() else None


def _signal_words(number: int) -> str:
    try:
        name = signal.Signals(number).name
    except ValueError:
        name = f"signal {number}"
    words = (signal.strsignal(number) or "").lower()
    hint = "; perhaps the machine ran out of memory" if number == signal.SIGKILL else ""
    return f"ended by {name}" + (f" ({words})" if words else "") + hint
