"""Text files of numbers: plain or packed (gzip, bzip2), read line by line, with errors that name file and line."""

from __future__ import annotations

import bz2
import gzip
import io
import math
import re
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from trailmark.errors import SourceError

__all__ = ["TIME_UNITS", "TimeUnit", "is_number", "lines_of", "natural_key", "number", "stamp"]

TimeUnit = Literal["s", "ms", "us", "ns"]

#: Units per second.
TIME_UNITS: dict[str, float] = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}

_MAX_LINE = 1_000_000  # a longer line is not a line of numbers: a binary file, or an unpacked bomb
# What text of numbers never reaches; what a file that unpacks to gigabytes of blank lines does.
_MAX_UNPACKED, _MAX_RATIO = 64 << 20, 100
_UNPACK: dict[str, Callable[..., Any]] = {".gz": gzip.open, ".bz2": bz2.open}
_DATE = re.compile(r"(\d{4}-\d\d-\d\d)[ T](\d\d:\d\d:\d\d)(\.\d+)?Z?")


def lines_of(path: Path, comments: tuple[str, ...] = ("#", "%", "//")) -> Iterator[tuple[int, str]]:
    """Yield the number and text of every line that is not empty or a comment; ``.gz`` and ``.bz2`` are unpacked.

    Raises
    ------
    SourceError
        If the file cannot be read or is not text.
    """
    number_, unpacked = 0, 0
    if path.exists() and not (path.is_file() or path.is_dir()):  # /dev/zero is read for ever, a pipe waited for
        raise SourceError(f"cannot read {path}: it is a device or a pipe; write its text into a file")
    try:
        unpack = _UNPACK.get(path.suffix, open)
        most = max(_MAX_UNPACKED, _MAX_RATIO * path.stat().st_size) if path.suffix in _UNPACK else math.inf
        with unpack(path, "rb") as binary:
            file = io.TextIOWrapper(binary, encoding="utf-8-sig")
            while line := file.readline(_MAX_LINE):
                number_ += 1
                unpacked += len(line)
                if unpacked > most:
                    raise SourceError(f"{path} unpacks to more than {_MAX_RATIO} times its size: not a log of numbers")
                if len(line) >= _MAX_LINE:
                    raise SourceError(f"{path}:{number_}: a line of more than {_MAX_LINE} characters: not a text file")
                text = line.strip()
                if text and not text.startswith(comments):
                    yield number_, text
    except UnicodeDecodeError as error:
        raise SourceError(f"{path}:{number_ + 1}: not a text file (byte {error.object[error.start]:#04x})") from error
    except (EOFError, gzip.BadGzipFile, OSError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise SourceError(f"cannot read {path}: {reason}") from error


def number(text: str, what: str, where: str) -> float:
    """Return a finite number.

    Raises
    ------
    SourceError
        If it is none; the message says what it should have been, and where.
    """
    try:
        value = float(text)
    except ValueError:
        raise SourceError(f"{where}: {what} is {text[:40]!r}, not a number") from None
    if not math.isfinite(value):
        raise SourceError(f"{where}: {what} is {text[:40]!r}, not a finite number")
    return value


def stamp(text: str, unit: TimeUnit, where: str) -> float:
    """Return a stamp in seconds, of a number in `unit` or of a date with time (UTC), as KITTI writes it.

    Raises
    ------
    SourceError
        If it is neither.
    """
    date = _DATE.fullmatch(text.strip())
    if date is None:
        return number(text, "the stamp", where) / TIME_UNITS[unit]
    try:
        whole = datetime.fromisoformat(f"{date[1]}T{date[2]}").replace(tzinfo=UTC).timestamp()
    except ValueError as error:
        raise SourceError(f"{where}: {text!r} is no date: {error}") from None
    return whole + float(date[3] or 0)


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Return the sort key that puts ``frame2`` before ``frame10``."""
    parts = re.split(r"(\d+)", name)
    return [(0, int(part), part) if part.isdecimal() else (1, 0, part) for part in parts]


def is_number(field: str) -> bool:
    """Return whether a field of a table is a number."""
    try:
        float(field)
    except ValueError:
        return False
    return True
