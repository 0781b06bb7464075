"""Tables of numbers that a run has left, whatever has become of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from trailmark.errors import DataError
from trailmark.evaluation.number_rows import read_number_rows
from trailmark.evaluation.relations import read_relations
from trailmark.report.tables import timing_table


def test_columns_are_taken_by_name(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("b,c,a\n1,2,3\n4,5,6\n")

    assert read_number_rows(tmp_path / "a.csv", ("a", "b"), "a table") == [[3.0, 1.0], [6.0, 4.0]]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"a,b\n1,2\n3,+\n", r"a\.csv:3: b is '\+', not a number$"),
        (b"a,b\n1\n", r"a\.csv:2: b is '', not a number$"),
        (b"a\n1\n", r"is not a table: it has no column 'b'$"),
        (b"", r"is not a table: it has no column 'a'$"),
        (b"a,b\n\xea,1\n", r"is not a table: it is no text \(byte 4\)$"),
        (b"a,b\n" + b"x" * 100_000 + b",1\n", r"a\.csv:2: a is 'x{40}', not a number$"),
    ],
)
def test_what_is_wrong_is_said_without_words_of_python(tmp_path: Path, data: bytes, words: str) -> None:
    (tmp_path / "a.csv").write_bytes(data)

    with pytest.raises(DataError, match=words):
        read_number_rows(tmp_path / "a.csv", ("a", "b"), "a table")


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"fx: 1 2 3 4 5 6 7\n", r"r\.txt:1: expected 8 finite numbers"),
        (b"\xff\xfe\n", r"holds no relations: it is no text \(byte 0\)"),
    ],
)
def test_relations_that_are_none_are_refused(tmp_path: Path, data: bytes, words: str) -> None:
    (tmp_path / "r.txt").write_bytes(data)

    with pytest.raises(DataError, match=words):
        read_relations(tmp_path / "r.txt")


def test_stages_that_are_none_are_left_out() -> None:
    good = {"n": 3, "mean_ms": 1.0}
    stages = {"a": 0.5, "b": {"n": "x"}, "c": {"n": float("nan")}, "d": None, "e": good}

    assert [row[0] for row in timing_table(stages).rows] == ["e"]  # type: ignore[arg-type]
