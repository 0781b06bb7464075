"""Files of stamps."""

from __future__ import annotations

import pytest

from trailmark.errors import SourceError
from trailmark_datasets.stamps import read_stamps


@pytest.mark.parametrize(
    "line",
    ["1.5 a.png", "a.png 1.5", "1.5,a.png", "'a.png'; 1.5", "1.5\ta.png"],
)
def test_a_stamp_and_a_name_stand_in_either_order(tmp_path, line):
    path = tmp_path / "times.txt"
    path.write_text(f"# comment\n{line}\n")

    (stamp,) = read_stamps(path)

    assert (stamp.stamp_s, stamp.name, stamp.where) == (1.5, "a.png", "times.txt:2")


def test_stamps_alone_may_be_dates_of_kitti_raw(tmp_path):
    path = tmp_path / "times.txt"
    path.write_text("2011-09-26 13:02:25.964389445\n2011-09-26 13:02:26.074337344\n")

    first, second = read_stamps(path)

    assert first.name is None
    assert second.stamp_s - first.stamp_s == pytest.approx(0.109947899, abs=1e-6)


def test_a_header_of_words_is_passed_over(tmp_path):
    path = tmp_path / "data.csv"
    path.write_text("timestamp,filename\n1403636579763555584,1403636579763555584.png\n")

    (stamp,) = read_stamps(path, "ns")

    assert stamp.stamp_s == pytest.approx(1403636579.763555584, abs=1e-6)
    assert stamp.name == "1403636579763555584.png"


@pytest.mark.parametrize("line", ["1.0 2.0 3.0", "a.png b.png"])
def test_a_malformed_line_is_refused_with_its_number(tmp_path, line):
    path = tmp_path / "times.txt"
    path.write_text(f"0.5\n{line}\n")

    with pytest.raises(SourceError, match=r"times\.txt:2: expected a stamp"):
        read_stamps(path)


def test_an_empty_file_is_refused(tmp_path):
    path = tmp_path / "times.txt"
    path.write_text("# nothing\n")

    with pytest.raises(SourceError, match=r"times\.txt holds no stamps"):
        read_stamps(path)
