"""Notes which files of a checkout a program and its children read: first on `PYTHONPATH` where `results.py` runs one.

``TRAILMARK_TRACED_TOP`` names the checkout, ``TRAILMARK_TRACED_NOTES`` the folder of notes:
a file for each process and user.
"""

import os
import sys

_TOP = os.path.join(os.environ["TRAILMARK_TRACED_TOP"], "")
_NOTES = os.environ["TRAILMARK_TRACED_NOTES"]
_seen: set[str] = set()


def _note(event: str, arguments: tuple[object, ...]) -> None:
    if event != "open" or not isinstance(arguments[0], str):
        return
    path = os.path.abspath(arguments[0])
    if not path.startswith(_TOP) or path in _seen:
        return
    _seen.add(path)
    note = f"{os.getpid()}-{os.geteuid()}"  # a process that becomes another user may not write what it began
    notes = os.open(os.path.join(_NOTES, note), os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    os.write(notes, os.fsencode(path) + b"\n")  # at once: a child may leave by os._exit
    os.close(notes)


sys.addaudithook(_note)
