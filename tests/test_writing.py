"""Files that are whole, whatever happens while they are written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from trailmark.writing import WholeLines, write_whole


class _Interrupting:
    """A file in whose writing the program is interrupted once, after some bytes."""

    def __init__(self, file: Any, after: int) -> None:
        self._file, self._after = file, after

    def write(self, data: memoryview) -> int:
        if self._after < 0:
            return int(self._file.write(data))
        after, self._after = self._after, -1
        if after:
            self._after = 0
            return int(self._file.write(data[:after]))
        raise KeyboardInterrupt

    @property
    def closed(self) -> bool:
        return bool(self._file.closed)

    def close(self) -> None:
        self._file.close()


@pytest.mark.parametrize("after", [0, 1, 7])
def test_an_interruption_tears_no_hole_into_growing_lines(tmp_path: Path, after: int) -> None:
    lines = WholeLines(tmp_path / "rows.csv")
    lines._file = _Interrupting(lines._file, after)
    lines.write("1,2\n3,4\n")
    with pytest.raises(KeyboardInterrupt):
        lines.flush()
    lines.write("5,6\n")
    lines.close()

    assert (tmp_path / "rows.csv").read_text() == "1,2\n3,4\n5,6\n"


def test_a_file_that_cannot_be_written_whole_stays_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_whole(path, "{}")
    with pytest.raises(TypeError):
        write_whole(path, 1)  # type: ignore[arg-type]  # anything that fails half way
    assert path.read_text() == "{}"
    assert [found.name for found in tmp_path.iterdir()] == ["a.json"]
