"""What a process does that runs isolated work: end with its parent, leave its result whole, say why it failed."""

from __future__ import annotations

import json
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

__all__ = ["EXIT_FAILED", "EXIT_SKIPPED", "die_with", "say", "write_json"]

#: Exit codes besides 0: the reason stands on standard error, in the last line.
EXIT_FAILED = 3
EXIT_SKIPPED = 5


def die_with(parent: int) -> None:
    """End this process when the process that started it does: its result would be lost."""
    if sys.platform != "linux":
        return
    import ctypes

    with suppress(OSError, AttributeError):
        ctypes.CDLL(None, use_errno=True).prctl(1, signal.SIGKILL, 0, 0, 0)  # PR_SET_PDEATHSIG
    if os.getppid() != parent:
        os._exit(EXIT_FAILED)


def write_json(path: Path, document: Any) -> None:
    """Write JSON so that it is there as a whole or not at all."""
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    draft = path.with_suffix(".part")
    draft.write_text(text + "\n", encoding="utf-8")
    draft.replace(path)


def say(code: int, error: object) -> int:
    """Print in one line what went wrong, and return the exit code that goes with it."""
    line = "; ".join(part.strip() for part in str(error).splitlines() if part.strip())
    print(line or type(error).__name__, file=sys.stderr, flush=True)
    return code
