"""Tables with named columns."""

from __future__ import annotations

import pytest

from trailmark.errors import SourceError
from trailmark_datasets.tables import open_table

KNOWN = ("t", "v", "omega")


def numbers(table, *columns):
    return [tuple(row.number(column) for column in columns) for row in table.rows()]


@pytest.mark.parametrize(
    "text",
    [
        "t,v,omega\n1,2,3\n",
        "t;v;omega\n1;2;3\n",
        "t\tv\tomega\n1\t2\t3\n",
        "t v  omega\n1   2 3\n",
        "# comment\n'T' , \"v [m/s]\", Omega (rad/s)\n1, 2 ,3\n",
        "omega,other,time,v\n3,junk,1,2\n",
    ],
    ids=["comma", "semicolon", "tab", "blanks", "quotes and units", "other order and names"],
)
def test_delimiters_units_and_order_are_found(tmp_path, text):
    path = tmp_path / "a.csv"
    path.write_text(text)

    assert numbers(open_table(path, KNOWN), *KNOWN) == [(1.0, 2.0, 3.0)]


def test_a_file_without_header_is_named_by_the_config(tmp_path):
    path = tmp_path / "a.dat"
    path.write_text("# MRCLAM\n1.5 \t 0.1 \t -0.2\n2.5 \t 0.1 \t -0.3\n")

    table = open_table(path, KNOWN, header=("t", "v", "omega"))

    assert numbers(table, *KNOWN) == [(1.5, 0.1, -0.2), (2.5, 0.1, -0.3)]


def test_columns_are_renamed_by_meaning(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("seconds,speed\n1,2\n")

    assert numbers(open_table(path, KNOWN, columns={"t": "seconds", "v": "Speed"}), "t", "v") == [(1.0, 2.0)]


def test_a_renamed_column_that_is_not_there_is_refused_with_the_nearest(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("seconds,speed\n1,2\n")

    with pytest.raises(SourceError, match=r"a\.csv:1: no column 'secunds' \(did you mean 'seconds'\?\)"):
        open_table(path, KNOWN, columns={"t": "secunds"})


def test_a_missing_header_is_noticed(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("1,2,3\n")

    with pytest.raises(SourceError, match=r"a\.csv:1 has no header row; name its 3 columns in the config: header:"):
        open_table(path, KNOWN)


def test_an_empty_table_is_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("\n# nothing\n")

    with pytest.raises(SourceError, match=r"a\.csv holds no rows"):
        open_table(path, KNOWN)


def test_a_short_row_is_told_with_its_line(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,v,omega\n1,2,3\n4,5\n")

    rows = list(open_table(path, KNOWN).rows())

    assert isinstance(rows[1], SourceError)
    assert "a.csv:3: expected 3 fields, found 2" in str(rows[1])
