"""Sources whose frames are picture files of one camera."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

from trailmark.errors import SourceError
from trailmark.frames import Image, SensorInfo
from trailmark.sources import Reading, Readings, RecordedSource
from trailmark.sources.pictures import PICTURE_SUFFIXES, read_picture
from trailmark_datasets.first import first_readable
from trailmark_datasets.textfiles import natural_key

__all__ = ["Entry", "PictureSource", "list_pictures", "missing_numbers"]


@dataclass(frozen=True, slots=True)
class Entry:
    """A picture of a recording.

    Attributes
    ----------
    stamp_s : float
        Its stamp [s].
    path : Path
        Its file.
    where : str
        What messages call it: line of the list, and file.
    """

    stamp_s: float
    path: Path
    where: str


class PictureSource(RecordedSource):
    """A source of one camera. What is there is listed by `start`; the files are read by `frames`."""

    loads_ahead = True
    #: As `read_picture` takes it.
    grey: bool | None = None
    #: Pictures per second, where it is told rather than read off the stamps [Hz].
    rate_hz: float | None = None

    _name = ""
    _entries: tuple[Entry, ...] = ()

    @abstractmethod
    def _list(self) -> Iterable[Entry]:
        """Return the pictures in order."""

    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        self._name = name or "camera"
        self._entries = tuple(self._list())
        first = first_readable(self._entries, self._load, self.config)
        self.expect_form(self._name, first)
        return (SensorInfo(self._name, "image", size=first.size, rate_hz=self.rate_hz or _median_rate(self._entries)),)

    def lasts_s(self) -> float | None:
        """Return the time from the first picture to the last."""
        return self._entries[-1].stamp_s - self._entries[0].stamp_s if self._entries else None

    def readings(self) -> Readings:
        for entry in self._entries:
            yield Reading(self._name, entry.stamp_s, entry.where, partial(self._load, entry))

    def _load(self, entry: Entry) -> Image:
        return Image(read_picture(entry.path, entry.where, self.grey))


def list_pictures(folder: Path, pattern: str | None = None) -> list[Path]:
    """Return the pictures in a folder in natural order.

    Raises
    ------
    SourceError
        If it is no folder, or holds none.
    """
    if not folder.is_dir():
        raise SourceError(f"{folder} is no folder; for a film use the source 'video'")
    try:
        found = [path for path in folder.glob(pattern or "*") if path.is_file()]
    except (ValueError, NotImplementedError, OSError) as error:
        raise SourceError(f"{folder}: cannot list pattern {pattern!r}: {error}") from error
    if pattern is None:
        found = [path for path in found if path.suffix.lower() in PICTURE_SUFFIXES]
    if not found:
        wanted = f"matches pattern {pattern!r}" if pattern else f"is a picture ({' '.join(sorted(PICTURE_SUFFIXES))})"
        raise SourceError(f"{folder}: no file {wanted}")
    return sorted(found, key=lambda path: natural_key(path.relative_to(folder).as_posix()))


def missing_numbers(names: list[str]) -> dict[int, str]:
    """Find the names that are left out of names which count up.

    Names count up when they differ only in the number at the end of their stem, and most of its steps are equal.

    Parameters
    ----------
    names : list of str
        File names in natural order.

    Returns
    -------
    dict of int to str
        Place in the complete sequence, and the name that should stand there; empty where nothing is missing.
    """
    parts = [match.groups() for name in names if (match := re.fullmatch(r"(.*?)(\d+)(\.\w+)?", name))]
    if len(parts) != len(names) or len({(stem, suffix) for stem, _, suffix in parts}) != 1:
        return {}
    numbers = [int(digits) for _, digits, _ in parts]
    steps = Counter(after - before for before, after in pairwise(numbers))
    if not steps:
        return {}
    usual, often = steps.most_common(1)[0]
    if 2 * often <= steps.total() or usual < 1 or any(step % usual for step in steps):
        return {}
    stem, digits, suffix = parts[0]
    complete = range(numbers[0], numbers[-1] + 1, usual)
    if len(complete) > 2 * len(numbers):  # more holes than pictures: the numbers mean something else
        return {}
    present = set(numbers)
    return {
        place: f"{stem}{value:0{len(digits)}d}{suffix or ''}"
        for place, value in enumerate(complete)
        if value not in present
    }


def _median_rate(entries: tuple[Entry, ...]) -> float | None:
    gaps = sorted(after.stamp_s - before.stamp_s for before, after in pairwise(entries))
    middle = gaps[len(gaps) // 2] if gaps else 0.0
    return 1.0 / middle if middle > 0 else None
