"""Files of a run on a disk that is full."""

from __future__ import annotations

import os
from pathlib import Path

from trailmark.writing import write_whole

__all__ = ["cut_after_last_line", "overwrite_in_place", "write_whole"]

_BLOCK = 1 << 16


def overwrite_in_place(path: Path, text: str) -> bool:
    """Write over what a file holds, which needs no space; returns whether there is room for it in the file."""
    data = text.encode()
    with path.open("r+b", buffering=0) as file:
        if len(data) > path.stat().st_size:
            return False
        file.write(data)
        file.truncate()
    return True


def cut_after_last_line(path: Path) -> None:
    """Cut a table of lines after its last whole one."""
    with path.open("r+b") as file:
        end = file.seek(0, os.SEEK_END)
        while end > 0:
            begin = max(0, end - _BLOCK)
            file.seek(begin)
            newline = file.read(end - begin).rfind(b"\n")
            if newline >= 0:
                file.truncate(begin + newline + 1)
                return
            end = begin
        file.truncate(0)
