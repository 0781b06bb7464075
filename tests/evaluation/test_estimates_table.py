from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trailmark.errors import DataError
from trailmark.evaluation import read_estimates

HEADER = (
    "arrived_s,source,kind,since_s,stamp_s,x,y,theta,info_xx,info_xy,info_xt,info_yy,info_yt,info_tt,"
    "status,nis,dof,reason,details"
)
MOTION = '0.1,floor,motion,0.0,0.1,0.01,0.002,0.0003,1,2,3,4,5,6,accepted,1.5,3,,"{""score"":0.9}"'
LOST = "0.3,floor,lost,,0.2,,,,,,,,,,unused,,,blank image,"
OFFSET = "0.5,streams,PathOffset,,0.4,1.0,0.1,0.01,1,0,0,1,0,1,gated,20.0,1,contradicts the belief,"


def _file(folder: Path, *lines: str) -> Path:
    path = folder / "estimates.csv"
    path.write_text("\n".join([HEADER, *lines]) + "\n")
    return path


def test_rows_become_columns(tmp_path: Path) -> None:
    table = read_estimates(_file(tmp_path, MOTION, LOST, OFFSET))

    assert len(table) == 3
    assert table.sources() == ["floor", "streams"]
    assert table.kind.tolist() == ["motion", "lost", "pathoffset"]
    assert table.outcome.tolist() == ["accepted", "lost", "gated"]
    np.testing.assert_allclose(table.numbers[0], [0.01, 0.002, 0.0003])
    np.testing.assert_allclose(table.information[0], [[1, 2, 3], [2, 4, 5], [3, 5, 6]])
    assert np.isnan(table.since_s[1])
    assert np.isnan(table.nis[1])
    assert table.reason[2] == "contradicts the belief"


def test_rows_of_one_localizer_are_counted_by_outcome(tmp_path: Path) -> None:
    table = read_estimates(_file(tmp_path, MOTION, OFFSET, LOST, MOTION.replace("0.1,", "0.4,", 1)))

    assert table.of("floor").counts() == {"accepted": 2, "lost": 1}
    assert table.of("nobody").counts() == {}


def test_a_run_without_estimates_has_an_empty_table(tmp_path: Path) -> None:
    table = read_estimates(_file(tmp_path))

    assert len(table) == 0
    assert table.sources() == []
    assert table.information.shape == (0, 3, 3)


def test_a_last_line_that_was_cut_off_is_left_out(tmp_path: Path) -> None:
    assert len(read_estimates(_file(tmp_path, MOTION, "0.2,floor,moti"))) == 1


def test_a_short_line_in_the_middle_is_an_error_that_names_it(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"estimates.csv:3: expected 19 fields, found 3"):
        read_estimates(_file(tmp_path, MOTION, "0.2,floor,moti", MOTION))


def test_a_malformed_number_is_an_error_that_names_its_column(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"estimates.csv:2: stamp_s is not a number: 'soon'"):
        read_estimates(_file(tmp_path, MOTION.replace("0.0,0.1", "0.0,soon")))


def test_a_missing_column_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "estimates.csv").write_text("t,x,y\n1,2,3\n")

    with pytest.raises(DataError, match=r"no column 'arrived_s'; the columns are t, x, y"):
        read_estimates(tmp_path / "estimates.csv")


def test_an_empty_or_missing_or_binary_file_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x01")

    with pytest.raises(DataError, match="the columns are none"):
        read_estimates(tmp_path / "empty.csv")
    with pytest.raises(DataError, match="cannot read"):
        read_estimates(tmp_path / "missing.csv")
    with pytest.raises(DataError, match="not a table of estimates"):
        read_estimates(tmp_path / "binary.csv")
