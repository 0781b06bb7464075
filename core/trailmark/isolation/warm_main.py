"""``python -m trailmark.isolation.warm_main SOCKET PARENT MODULE``: a process that has imported much, and forks.

Each child runs ``MODULE.main([FOLDER, PID])`` once, in a session, folder and environment of its own, and ends. Where
there is a ``MODULE.prepare([FOLDER, PID])``, a child that is thrown away runs it before the first, and this process
imports what it had imported. Of what later children import it takes over nothing: their memory begins at the size of
this process, and would hang on what ran before. A process that has threads forks none: a child would wait for what a
thread held.

It also forks others of its kind, each with a connection of its own, once it has imported what ``MODULE.COMMON`` names:
what all kinds of children need is imported once, and their pages are shared.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import select
import signal
import socket
import sys
import tempfile
import time
import traceback
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any

from trailmark.isolation.child import die_with

__all__ = ["main"]

_MOST_BYTES = 1 << 16
# What preparing may take; less than a `WarmParent` waits for an answer.
_PATIENCE_S = 60.0
_END_S = 1.0


def main(arguments: list[str]) -> int:
    """Answer the questions of a `WarmParent` until it hangs up; return the exit code."""
    connection = socket.socket(fileno=int(arguments[0]))
    die_with(int(arguments[1]))
    forge = _Forge(connection, importlib.import_module(arguments[2]))
    code = _answer(forge, connection)
    forge.wait_for_forges()
    return code


def _answer(forge: _Forge, connection: socket.socket) -> int:
    """Do what is asked through a connection until it is closed; return the exit code."""
    while True:
        content, descriptors, _, _ = socket.recv_fds(connection, _MOST_BYTES, 1)
        if not content:
            return 0
        asked = json.loads(content)
        if "reap" in asked:
            forge.reap(int(asked["reap"]))
        elif "folder" in asked:
            forge.fork(asked, descriptors[0])
        else:
            forge.fork_forge(descriptors[0])


class _Forge:
    """Forks children that run a module, and says how they ended."""

    def __init__(self, connection: socket.socket, module: ModuleType) -> None:
        self._connection = connection
        self._module = module
        self._is_prepared = not hasattr(module, "prepare")
        self._forges: list[int] = []

    def fork(self, asked: Mapping[str, Any], stderr: int) -> None:
        """Start a child; tell its number, or 0 where this process has threads."""
        if not self._is_prepared and _n_threads() == 1:
            self._prepare(asked)
        if _n_threads() > 1:
            os.close(stderr)
            return self._tell({"pid": 0})
        gc.collect()
        gc.freeze()  # what is there is looked through in no child
        pid = os.fork()
        if pid == 0:
            os._exit(self._run_child(asked, stderr))
        os.close(stderr)
        return self._tell({"pid": pid})

    def fork_forge(self, descriptor: int) -> None:
        """Start another that answers through a connection; tell its number, or 0 where this process has threads."""
        self._forges = [pid for pid in self._forges if os.waitpid(pid, os.WNOHANG) == (0, 0)]  # others have ended
        _import_all(getattr(self._module, "COMMON", ()))
        if _n_threads() > 1:
            os.close(descriptor)
            return self._tell({"pid": 0})
        gc.collect()
        gc.freeze()
        parent = os.getpid()
        pid = os.fork()
        if pid == 0:
            os._exit(self._run_forge(descriptor, parent))
        os.close(descriptor)
        self._forges.append(pid)
        return self._tell({"pid": pid})

    def wait_for_forges(self) -> None:
        """Wait for those whose connection is closed as well, so that what they used is accounted for."""
        until_s = time.monotonic() + _END_S
        while self._forges and time.monotonic() < until_s:
            self._forges = [pid for pid in self._forges if os.waitpid(pid, os.WNOHANG) == (0, 0)]
            time.sleep(0.01)

    def _run_forge(self, descriptor: int, parent: int) -> int:
        """Answer in this child what is asked through a connection of its own; return its exit code."""
        try:
            die_with(parent)
            self._connection.close()
            connection = socket.socket(fileno=descriptor)
            return _answer(_Forge(connection, self._module), connection)
        except BaseException:  # nothing of this child may go on as its parent
            traceback.print_exc()
            return 1

    def reap(self, pid: int) -> None:
        """Wait for a child that has ended, and tell what it used."""
        _, status, usage = os.wait4(pid, 0)
        self._tell({"status": status, "cpu_s": usage.ru_utime + usage.ru_stime, "peak_kb": usage.ru_maxrss})

    def _prepare(self, asked: Mapping[str, Any]) -> None:
        """Import what children need: a first one, thrown away, says what that is."""
        self._is_prepared = True
        reading, said = os.pipe()
        parent = os.getpid()
        pid = os.fork()
        if pid == 0:
            os._exit(self._run_preparation(asked, parent, said))
        os.close(said)
        content = _read_until_end(reading)
        os.close(reading)
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)  # it has said all, or takes too long
        os.waitpid(pid, 0)
        _import_all(content.decode().split())

    def _run_preparation(self, asked: Mapping[str, Any], parent: int, said: int) -> int:
        """Prepare in this child, and say what it has imported for that; return its exit code."""
        try:
            die_with(parent)
            self._enter(asked)
            before = set(sys.modules)
            try:
                self._module.prepare([asked["folder"], str(parent)])
            finally:  # a cell that is wrong has imported something as well
                with open(said, "wb") as pipe:
                    pipe.write("\n".join(sorted(set(sys.modules) - before)).encode())
        except BaseException:
            return 1
        return 0

    def _run_child(self, asked: Mapping[str, Any], stderr: int) -> int:
        """Run the module in this child; return its exit code."""
        try:
            os.setsid()
            os.dup2(stderr, 2)
            os.close(stderr)
            self._enter(asked)
            if numpy := sys.modules.get("numpy"):
                numpy.random.seed()  # a process that begins anew has a state of its own
            code = int(self._module.main([asked["folder"], str(os.getppid())]))
        except BaseException:  # nothing of this child may go on as its parent
            traceback.print_exc()
            code = 1
        with suppress(Exception):
            sys.stderr.flush()
        return code

    def _enter(self, asked: Mapping[str, Any]) -> None:
        """Leave what is the parent's: its connection, folder and environment."""
        self._connection.close()
        os.chdir(asked["scratch"])
        os.environ.update(asked["environment"])
        tempfile.tempdir = None

    def _tell(self, answer: Mapping[str, Any]) -> None:
        self._connection.send(json.dumps(answer).encode())


def _read_until_end(descriptor: int) -> bytes:
    """Return what comes through a pipe until it is closed, or patience ends."""
    until_s, content = time.monotonic() + _PATIENCE_S, b""
    while select.select([descriptor], [], [], max(0.0, until_s - time.monotonic()))[0]:
        piece = os.read(descriptor, _MOST_BYTES)
        if not piece:
            return content
        content += piece
    return b""


def _n_threads() -> int:
    return len(list(Path("/proc/self/task").iterdir()))


def _import_all(names: Iterable[str]) -> None:
    """Import what a child had imported; what is no module by its name is left to the children."""
    for name in names:
        with suppress(Exception):
            importlib.import_module(name)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
