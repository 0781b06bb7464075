"""Ends a program whose parent is gone, however that ended: its robot could not be stopped any more.

Its standard input is a pipe that only the other holds. The system closes that when the other is killed, too.
"""

from __future__ import annotations

import os
import shutil
import signal
import threading
from contextlib import suppress
from pathlib import Path

__all__ = ["ENDS_WITH_STDIN", "end_with_stdin"]

#: Set for a program whose standard input is such a pipe.
ENDS_WITH_STDIN = "TRAILMARK_ENDS_WITH_STDIN"


def end_with_stdin(folder: Path | None = None) -> None:
    """Send this program SIGTERM when its standard input ends; return at once.

    Parameters
    ----------
    folder : Path, optional
        A folder that the other made for both and cannot remove any more: it is removed first.
    """
    threading.Thread(target=_wait_for_the_end, args=(folder,), name="orphan", daemon=True).start()


def _wait_for_the_end(folder: Path | None) -> None:
    with suppress(OSError):
        while os.read(0, 4096):
            pass
    if folder is not None:
        shutil.rmtree(folder, ignore_errors=True)
    os.kill(os.getpid(), signal.SIGTERM)
