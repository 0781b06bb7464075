"""Two processes compile kernels together: each takes the next of a list that both can read, until none is left.

Numba compiles one kernel at a time in a process. What two processes compile meets on disk, where numba keeps it.
"""

from __future__ import annotations

import logging
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

__all__ = ["CompilingProcess", "compile_offered", "compile_together"]

logger = logging.getLogger(__name__)

#: How long a kernel that the other process has taken is waited for [s]. The slowest needs 3 s of processor time.
_PATIENCE_S = 20.0

#: How long a process that was killed is waited for [s]: one that hangs in the system ends when that lets it.
_KILLED_S = 5.0

#: Between two looks at what the other has done [s].
_LOOK_EVERY_S = 0.02

#: How the notes in the folder end: a process has taken a kernel, it has compiled it.
_TAKEN, _DONE = ".taken", ".done"

#: The processes that compile for this one.
_running: list[CompilingProcess] = []


class CompilingProcess:
    """A process that compiles for this one.

    Parameters
    ----------
    command : sequence of str
        Starts it. It gets a folder as its last argument, in which both note what they have taken, and calls
        `compile_offered` when its own work is done. It ends when its standard input does, and removes the folder then
        (`trailmark.isolation.orphan.end_with_stdin`).

    Raises
    ------
    OSError
        If no process or folder can be made.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="trailmark-kernels-"))
        try:
            self._process = subprocess.Popen(
                [*command, str(self._folder)],
                stdin=subprocess.PIPE,  # ours alone: it ends with us, however we end
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is for this process, which then ends that one
            )
        except OSError:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise
        _running.append(self)

    def share(self, kernels: str) -> None:
        """Compile a list together with the other process; return when all is done, here or there."""
        (self._folder / kernels).touch()
        taken_there = _take(kernels, self._folder)
        until_s = time.monotonic() + _PATIENCE_S
        while not all(done.exists() for done in taken_there) and self._process.poll() is None:
            if time.monotonic() > until_s:
                logger.warning("kernels that another process compiles are not done in %g s", _PATIENCE_S)
                return
            time.sleep(_LOOK_EVERY_S)

    def wait(self, patience_s: float) -> bool:
        """Wait until the process has ended; return whether it has in time."""
        try:
            self._process.wait(patience_s)
        except subprocess.TimeoutExpired:
            return False
        return True

    def close(self) -> None:
        """End the process, if it has not ended."""
        self._process.kill()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_KILLED_S)
        if self._process.stdin is not None:
            self._process.stdin.close()
        shutil.rmtree(self._folder, ignore_errors=True)
        with suppress(ValueError):
            _running.remove(self)


def compile_together(kernels: str) -> None:
    """Compile the kernels of a list, if there is a process that takes a part of them.

    Where there is none, each is compiled when it is called, as is one that does not compile for the types listed.

    Parameters
    ----------
    kernels : str
        ``module.NAME`` of a sequence of pairs, a kernel and the types of its arguments: first the one that takes
        longest, so that both processes end at the same time.
    """
    if _running:
        with suppress(OSError):  # a run that ends removes its folder, a full disk takes no note
            _running[-1].share(kernels)


def compile_offered(folder: Path) -> None:
    """Compile, in a process that was started for it, what the one that started it offers and has not yet taken."""
    for path in sorted(folder.iterdir()):
        if path.suffix not in (_TAKEN, _DONE):
            _take(path.name, folder)


def _take(kernels: str, folder: Path) -> list[Path]:
    """Compile what nobody has taken; return the notes to come of what the other process has."""
    module, _, name = kernels.rpartition(".")
    pairs: Sequence[tuple[Any, tuple[Any, ...]]] = getattr(import_module(module), name)
    taken_there = []
    for i, (kernel, types) in enumerate(pairs):
        done = folder / f"{kernels}.{i}{_DONE}"
        try:
            (folder / f"{kernels}.{i}{_TAKEN}").touch(exist_ok=False)
        except FileExistsError:
            taken_there.append(done)
            continue
        try:
            kernel.compile(types)
        except Exception as error:  # whatever numba or LLVM raise: who calls it knows what to do instead
            logger.info("kernel %s does not compile ahead of its call: %s", kernel.__name__, error)
        done.touch()
    return taken_there
