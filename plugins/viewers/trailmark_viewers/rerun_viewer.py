"""The viewer of Rerun, a program of its own: whether it listens, and how to open it."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress

from trailmark.errors import ConfigError

__all__ = ["find_viewer"]

# How long a viewer takes to answer that is there, and one that is being opened [s].
_ANSWER_S = 5.0
_OPENING_S = 30.0
# A viewer listens before it looks for a display, and is gone so soon after where there is none [s].
_SETTLING_S = 1.0


def find_viewer(host: str, port: int, *, spawn: bool) -> None:
    """See that a viewer listens; open one on this machine if asked for and none does.

    The viewer is opened to listen on this machine alone, and stays open when the run has ended.

    Raises
    ------
    ConfigError
        If none listens, or it cannot be opened.
    """
    problem = _silence(host, port)
    if problem is None:
        return
    if not spawn:
        raise ConfigError(
            f"no Rerun viewer answers at {host}:{port}: {problem}; open one with 'rerun', or say spawn: true"
        )
    viewer = _open_viewer(port)
    if not _is_up(viewer, host, port):
        with suppress(ProcessLookupError):
            os.killpg(viewer.pid, signal.SIGTERM)
        raise ConfigError(
            f"the Rerun viewer does not come up at port {port}: it needs a display; write path: run.rrd instead"
        )


def _is_up(viewer: subprocess.Popen[bytes], host: str, port: int) -> bool:
    """Return whether a viewer comes to listen, and stays."""
    until_s = time.monotonic() + _OPENING_S
    while _silence(host, port) is not None:
        if viewer.poll() is not None or time.monotonic() > until_s:
            return False
        time.sleep(0.1)
    with suppress(subprocess.TimeoutExpired):
        viewer.wait(_SETTLING_S)
    return viewer.poll() is None


def _silence(host: str, port: int) -> str | None:
    """Return why the viewer does not answer; None if it does."""
    try:
        socket.create_connection((host, port), timeout=_ANSWER_S).close()
    except OSError as error:
        return error.strerror or str(error)
    return None


def _open_viewer(port: int) -> subprocess.Popen[bytes]:
    beside = os.path.dirname(sys.executable)  # of an environment that is not activated
    program = shutil.which("rerun", path=os.pathsep.join([beside, os.environ.get("PATH", "")]))
    if program is None:
        raise ConfigError("there is no program 'rerun' on the PATH: pip install 'trailmark[rerun]' brings it")
    return subprocess.Popen(
        [program, "--port", str(port), "--bind", "127.0.0.1", "--hide-welcome-screen"],
        env=os.environ | {"RERUN_APP_ONLY": "true"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # Ctrl-C is for the run
    )
