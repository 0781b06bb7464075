"""Text files of numbers."""

from __future__ import annotations

import bz2
import gzip

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.errors import SourceError
from trailmark_datasets.textfiles import lines_of, natural_key, number, stamp


def test_lines_come_with_their_numbers_and_without_comments(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("\ufeff# head\n1 2\n\n% other\n// third\n  3 4  \n", encoding="utf-8")

    assert list(lines_of(path)) == [(2, "1 2"), (6, "3 4")]


@pytest.mark.parametrize(("suffix", "pack"), [("gz", gzip.compress), ("bz2", bz2.compress)])
def test_packed_text_is_unpacked(tmp_path, suffix, pack):
    path = tmp_path / f"a.log.{suffix}"
    path.write_bytes(pack(b"one\ntwo\n"))

    assert [text for _, text in lines_of(path)] == ["one", "two"]


def test_a_binary_file_is_refused_with_its_line(tmp_path):
    path = tmp_path / "a.txt"
    path.write_bytes(b"1 2\n\xff\xfe\n")

    with pytest.raises(SourceError, match=r"a\.txt:\d+: not a text file \(byte 0xff\)"):
        list(lines_of(path))


def test_a_line_without_end_is_refused_before_it_fills_the_memory(tmp_path):
    path = tmp_path / "bomb.txt.gz"
    path.write_bytes(gzip.compress(b"7" * 3_000_000))

    with pytest.raises(SourceError, match=r"bomb\.txt\.gz:1: a line of more than 1000000 characters"):
        list(lines_of(path))


def test_a_damaged_bzip2_file_is_refused(tmp_path):
    path = tmp_path / "a.clf.bz2"
    path.write_bytes(bz2.compress(b"1 2\n" * 9999)[:-20])

    with pytest.raises(SourceError, match=r"cannot read .*a\.clf\.bz2"):
        list(lines_of(path))


@pytest.mark.parametrize("content", [b"no gzip at all", gzip.compress(b"1 2\n" * 9999)[:-20]], ids=["foreign", "cut"])
def test_a_damaged_gzip_file_is_refused(tmp_path, content):
    path = tmp_path / "a.gz"
    path.write_bytes(content)

    with pytest.raises(SourceError, match=r"cannot read .*a\.gz"):
        list(lines_of(path))


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(SourceError, match=r"cannot read .*none\.txt: No such file"):
        list(lines_of(tmp_path / "none.txt"))


@pytest.mark.parametrize(("text", "message"), [("1,5", "'1,5', not a number"), ("nan", "not a finite number")])
def test_what_is_no_number_is_refused_with_file_and_line(text, message):
    with pytest.raises(SourceError, match=rf"a\.csv:3: column 'v' is .*{message}"):
        number(text, "column 'v'", "a.csv:3")


@pytest.mark.parametrize(
    ("text", "unit", "expected_s"),
    [
        ("12.5", "s", 12.5),
        ("12500", "ms", 12.5),
        ("12500000", "us", 12.5),
        ("1403636579763555584", "ns", 1403636579.763555584),
        ("1970-01-02 00:00:01.250000000", "s", 86401.25),
        ("1970-01-02T00:00:01Z", "ns", 86401.0),
    ],
)
def test_stamps_are_read_in_their_unit_or_as_dates(text, unit, expected_s):
    assert stamp(text, unit, "x:1") == pytest.approx(expected_s, abs=1e-6)


def test_a_date_that_does_not_exist_is_refused():
    with pytest.raises(SourceError, match=r"x:1: '2011-13-26 13:02:25' is no date"):
        stamp("2011-13-26 13:02:25", "s", "x:1")


def test_natural_order_puts_2_before_10_and_keeps_folders_together():
    names = ["b/1.png", "a/10.png", "a/2.png", "a/x.png", "10", "9"]

    assert sorted(names, key=natural_key) == ["9", "10", "a/2.png", "a/10.png", "a/x.png", "b/1.png"]


@given(st.lists(st.text(alphabet="a1²٣_/.", max_size=8)))
def test_any_names_can_be_put_in_natural_order(names):
    assert sorted(sorted(names, key=natural_key)) == sorted(names)
