"""Files of stamps: one a line, alone or beside the name of a file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from trailmark.errors import SourceError
from trailmark_datasets.textfiles import TimeUnit, lines_of, stamp

__all__ = ["Stamp", "read_stamps"]

_STAMP = re.compile(r"[-+\d.eE]+|\d{4}-\d\d-\d\d[ T][\d:.]+Z?")


@dataclass(frozen=True, slots=True)
class Stamp:
    """A line of a file of stamps.

    Attributes
    ----------
    stamp_s : float
        The stamp [s].
    name : str or None
        The file named beside it.
    where : str
        ``"rgb.txt:12"``.
    """

    stamp_s: float
    name: str | None
    where: str


def read_stamps(path: Path, unit: TimeUnit = "s") -> list[Stamp]:
    """Read a file of stamps.

    A line is ``stamp``, ``stamp name`` or ``name stamp``, separated by blanks, commas or semicolons; a stamp is
    a number in `unit` or a date with time (``2011-09-26 13:02:25.964389445``). A first line of words is a header.

    Raises
    ------
    SourceError
        If the file cannot be read, a line is malformed or there is none.
    """
    stamps: list[Stamp] = []
    for line, text in lines_of(path):
        where = f"{path.name}:{line}"
        fields = _fields(text)
        at = next((index for index, field in enumerate(fields) if _STAMP.fullmatch(field)), None)
        if at is None and not stamps and line == 1:
            continue
        if at is None or len(fields) > 2:
            raise SourceError(f"{path}:{line}: expected a stamp, alone or with one file name, found {text[:60]!r}")
        stamps.append(Stamp(stamp(fields[at], unit, where), fields[1 - at] if len(fields) == 2 else None, where))
    if not stamps:
        raise SourceError(f"{path} holds no stamps")
    return stamps


def _fields(text: str) -> list[str]:
    if _STAMP.fullmatch(text):  # a date with time has a blank inside
        return [text]
    separator = next((mark for mark in ";," if mark in text), None)
    return [field.strip().strip("\"'") for field in text.split(separator) if field.strip()]
