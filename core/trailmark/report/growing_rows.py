"""Reading a table that is being written: what is new since the last look, in whole lines."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

from trailmark.errors import DataError

__all__ = ["GrowingRows"]


class GrowingRows:
    """Reads the rows that were added to a CSV since the last look.

    Parameters
    ----------
    path : Path
        It may not be there yet.
    limit : int
        So much is read at a look at most; -1: all that is there [bytes].
    """

    def __init__(self, path: Path, limit: int = -1) -> None:
        self._path = path
        self._limit = limit
        self._at = 0
        self._columns: list[str] = []

    @property
    def n_left(self) -> int:
        """How much has not been read yet [bytes]."""
        try:
            return max(0, self._path.stat().st_size - self._at)
        except OSError:
            return 0

    def rows(self) -> Iterator[dict[str, str]]:
        """Yield what is new; a last line that is half there waits.

        Raises
        ------
        DataError
            If it is no table.
        """
        if not self._path.is_file():  # not there yet; a pipe would be waited for
            return
        try:
            with self._path.open("rb") as file:
                file.seek(self._at)
                content = file.read(self._limit)
        except OSError:
            return
        whole = content[: content.rfind(b"\n") + 1]
        self._at += len(whole)
        try:
            for fields in csv.reader(whole.decode("utf-8", "replace").splitlines()):
                if not self._columns:
                    self._columns = fields
                elif len(fields) == len(self._columns):
                    yield dict(zip(self._columns, fields, strict=True))
        except csv.Error as error:
            raise self.wrong(error) from error

    def wrong(self, error: Exception) -> DataError:
        """Return what to raise for a row that cannot be taken."""
        words = f"no column {error}" if isinstance(error, KeyError) else str(error)
        return DataError(f"{self._path} is no table of estimates, or was changed by hand: {words}")
