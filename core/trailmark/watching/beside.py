"""The page of a run, beside it: a program of its own, which reads what the run writes and ends when the run does."""

from __future__ import annotations

import json
import logging
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trailmark.errors import ConfigError
from trailmark.watching.server import PageServer, listen, new_secret, url_of

if TYPE_CHECKING:
    from trailmark.watching.watched import WatchedPage

__all__ = ["page_beside", "serve_page"]

logger = logging.getLogger(__name__)

_LOOK_EVERY_S = 0.05
#: Whoever has the page open is told the end within this time; then the page is not there any more [s].
_LAST_WORDS_S = 5.0


@contextmanager
def page_beside(folder: Path, port: int) -> Iterator[tuple[str, Path]]:
    """Serve the page of a run that is about to begin in this process; give its address, and where to leave notes.

    The page's program is in a session of its own, so that Ctrl-C on the terminal ends the run, and the page tells how.
    It listens already when this is entered.

    Raises
    ------
    ConfigError
        If the port is taken.
    """
    from trailmark.watching.run_state import writing_of

    if os.name == "nt":
        raise ConfigError("--watch needs Linux or macOS; 'trailmark watch RUN --page' in another terminal shows a run")
    listener = listen(port)
    secret, notes = new_secret(), Path(tempfile.mkdtemp(prefix="trailmark-watch-"))
    told: dict[str, Any] = {"folder": str(folder.absolute()), "notes": str(notes), "secret": secret}
    told |= {"listener": listener.fileno(), "run": os.getpid()}
    told |= {"earlier": writing_of(folder)}
    try:
        child = subprocess.Popen(
            [sys.executable, "-P", "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=[listener.fileno()],
            start_new_session=True,
        )
        assert child.stdin is not None
        with suppress(OSError), child.stdin:
            child.stdin.write(json.dumps(told).encode())
        yield url_of(listener.getsockname()[1], secret), notes
        if (code := child.poll()) is not None:
            logger.warning("the page ended before the run, with exit code %d", code)
            shutil.rmtree(notes, ignore_errors=True)
        child.returncode = 0  # it outlives this process by a moment; nobody waits for it
    finally:
        listener.close()


def serve_page(shown_of: Callable[[str], WatchedPage], port: int, *, tell: Callable[[str], None]) -> None:
    """Serve a page from this process until what it shows has ended, or an exception.

    Parameters
    ----------
    shown_of : callable
        Returns what is shown, for the secret of its buttons.
    port : int
        0: one that is free.
    tell : callable
        Is told the address.

    Raises
    ------
    ConfigError
        If the port is taken.
    """
    with closing(listen(port)) as listener:
        secret = new_secret()
        shown = shown_of(secret)
        _serve(PageServer(listener, secret, shown), shown, tell)


def _serve(server: PageServer, shown: WatchedPage, tell: Callable[[str], None] = lambda url: None) -> None:
    is_over = _ending(shown.has_ended, shown.has_told)
    shown.start()
    server.start()
    try:
        tell(server.url)
        while not is_over():
            time.sleep(_LOOK_EVERY_S)
    finally:
        shown.close()
        server.stop()


def _main() -> None:
    """Run the page's program; standard input says all that it needs."""
    from trailmark.watching.watched import WatchedRun

    told = json.load(sys.stdin)
    run, notes = int(told["run"]), Path(told["notes"])
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # it ends when the run does
    try:
        is_there = partial(_is_parent, run)
        earlier = told["earlier"] and tuple(told["earlier"])
        shown = WatchedRun(
            Path(told["folder"]), told["secret"], notes=notes, is_there=is_there, process=run, earlier=earlier
        )
        with socket.socket(fileno=told["listener"]) as listener:
            _serve(PageServer(listener, told["secret"], shown), shown)
    finally:
        shutil.rmtree(notes, ignore_errors=True)


def _is_parent(process: int) -> bool:
    return os.getppid() == process


def _ending(has_ended: Callable[[], bool], has_told: Callable[[], bool]) -> Callable[[], bool]:
    """Return a function that says whether a page is over: the run has ended, and no open page still waits for that."""
    since_s: list[float] = []

    def is_over() -> bool:
        if not has_ended():
            return False
        since_s[:] = since_s or [time.monotonic()]
        gone_s = time.monotonic() - since_s[0]
        return gone_s > _LAST_WORDS_S or has_told()

    return is_over


if __name__ == "__main__":
    _main()
