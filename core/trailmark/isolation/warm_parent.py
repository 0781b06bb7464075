"""A process that has imported what many processes need, and forks them: each is isolated, and none begins cold."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trailmark.isolation.environment import pinned_environment

__all__ = ["Usage", "WarmParent"]

# What importing everything that children need may take.
_PATIENCE_S = 120.0
_END_S = 5.0
_MOST_BYTES = 1 << 16


@dataclass(frozen=True, slots=True)
class Usage:
    """How a process ended, and what it used.

    Attributes
    ----------
    status : int
        As of ``os.wait``.
    cpu_s : float
        Of it and its children [s].
    peak_rss_mb : float
        Largest memory [MB].
    """

    status: int
    cpu_s: float
    peak_rss_mb: float


class WarmParent:
    """A process from which others are forked, once it is asked for the first; from several threads.

    It imports a module, and before the first child what the module's ``prepare([FOLDER, PARENT])`` imports, where there
    is one; that runs in a process that is thrown away. It runs none of it itself and learns nothing from children, so
    that nothing goes from one to the next, and what they use hangs on none before. When it is lost (`OSError`), so are
    its children.

    Parameters
    ----------
    module : str
        Each child runs its ``main([FOLDER, PARENT])``.
    threads : int or None
        Of the numeric libraries.
    origin : WarmParent or None
        One of the same module and threads, which this one is forked from: it has imported the module's ``COMMON``, a
        sequence of names, and its pages are shared.
    """

    def __init__(self, module: str, threads: int | None, origin: WarmParent | None = None) -> None:
        self._module = module
        self._threads = threads
        self._origin = origin
        self._lock = threading.Lock()
        self._connection: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._pid = 0
        self._children: set[int] = set()
        self._is_lost = False

    @staticmethod
    def is_possible() -> bool:
        """Return whether this system can do it: children are waited for by the descriptor of a process."""
        return sys.platform == "linux" and hasattr(os, "pidfd_open") and hasattr(os, "memfd_create")

    @property
    def is_idle(self) -> bool:
        """Whether it has no children."""
        return not self._children

    def fork(self, folder: Path, scratch: Path, environment: Mapping[str, str], stderr: int) -> int:
        """Start a child and return its number.

        Parameters
        ----------
        folder, scratch : Path
            What it is told, and its working folder.
        environment : mapping of str to str
            Variables besides those of this process.
        stderr : int
            Descriptor of its standard error.

        Raises
        ------
        OSError
            If it can have none: it has threads, or is lost.
        """
        asked = {"folder": str(folder.absolute()), "scratch": str(scratch.absolute()), "environment": dict(environment)}
        with self._lock:
            pid = int(self._ask(asked, stderr)["pid"])
            if not pid:
                raise OSError("a process with threads cannot be forked")
            self._children.add(pid)
        return pid

    def reap(self, pid: int) -> Usage:
        """Return how a child ended; it has ended.

        Raises
        ------
        OSError
            If this process is lost.
        """
        with self._lock:
            self._children.discard(pid)
            told = self._ask({"reap": pid})
        return Usage(int(told["status"]), float(told["cpu_s"]), float(told["peak_kb"]) / 1e3)

    @property
    def is_lost(self) -> bool:
        """Whether it has ended, and forks no more; said at once, also while another thread waits for a child."""
        process = self._process
        return self._is_lost or (process is not None and process.poll() is not None)

    def fork_parent(self, descriptor: int) -> int:
        """Start a process like this one, which answers through the socket of a descriptor, and return its number.

        It ends with this one.

        Raises
        ------
        OSError
            If there is none: this one has threads, or is lost.
        """
        with self._lock:
            pid = int(self._ask({}, descriptor)["pid"])
            if not pid:
                raise OSError("a process with threads cannot be forked")
        return pid

    def close(self) -> None:
        """End this process, and its children; it has no others afterwards."""
        with self._lock:
            self._is_lost = True
            connection, self._connection = self._connection, None
            process, self._process = self._process, None
        if connection is not None:
            connection.close()
        if process is not None:
            with suppress(subprocess.TimeoutExpired):
                process.wait(_END_S)
            process.kill()
            process.wait()

    def _ask(self, asked: Mapping[str, Any], *descriptors: int) -> dict[str, Any]:
        """Return the answer to a question; without one, this process is lost."""
        if self._is_lost:
            raise ConnectionResetError("the process that forks is gone")
        try:
            connection = self._connection or self._start()
            socket.send_fds(connection, [json.dumps(asked).encode()], list(descriptors))
            told: dict[str, Any] = json.loads(connection.recv(_MOST_BYTES) or b"{}")
            if not told:
                raise ConnectionResetError("the process that forks is gone")
        except BaseException:  # an answer that nobody waited for would be taken for that to the next question
            self._is_lost = True
            raise
        return told

    def _start(self) -> socket.socket:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.settimeout(_PATIENCE_S)
        command = [sys.executable, "-P", "-X", "faulthandler", "-m", "trailmark.isolation.warm_main"]
        with theirs:
            if self._origin is not None:
                self._pid = self._origin.fork_parent(theirs.fileno())
                self._connection = ours
                return ours
            self._process = subprocess.Popen(
                [*command, str(theirs.fileno()), str(os.getpid()), self._module],
                env=pinned_environment(self._threads),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        self._pid = self._process.pid
        self._connection = ours
        return ours
