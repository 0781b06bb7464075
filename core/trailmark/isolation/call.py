"""``python -m trailmark.isolation.call FOLDER PARENT``: one call of a function, in a process of its own."""

from __future__ import annotations

import faulthandler
import json
import os
import signal
import sys
import traceback
from importlib import import_module
from pathlib import Path
from typing import Any

from trailmark.isolation.calls import ARGUMENTS_FILE, keep_answer, read_plain
from trailmark.isolation.child import EXIT_FAILED, die_with, say, write_json
from trailmark.isolation.process import REQUEST_FILE, RESULT_FILE

__all__ = ["main"]


def main(arguments: list[str]) -> int:
    """Make the call of a folder; return the exit code."""
    folder = Path(arguments[0])
    die_with(int(arguments[1]))
    faulthandler.register(signal.SIGUSR1)
    request = json.loads((folder / REQUEST_FILE).read_text(encoding="utf-8"))
    try:
        module, _, name = request["function"].partition(":")
        function: Any = import_module(module)
        for part in name.split("."):
            function = getattr(function, part)
        package = module.partition(".")[0]
        call = read_plain(folder / ARGUMENTS_FILE, package)
        keep_answer(folder, function(*call), package)
    except Exception as error:
        traceback.print_exc()
        told = {"module": type(error).__module__, "name": type(error).__name__, "message": str(error)}
        write_json(folder / "error.json", told)
        return say(EXIT_FAILED, f"{type(error).__name__}: {error}")
    write_json(folder / RESULT_FILE, {"state": "ok", "reason": ""})
    return 0


if __name__ == "__main__":
    found = main(sys.argv[1:])
    sys.stderr.flush()
    os._exit(found)
