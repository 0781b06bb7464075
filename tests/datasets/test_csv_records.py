"""Ranges and bearings from tables: a sighting a row, or a landmark a column."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark.errors import SourceError
from trailmark.frames import Arrays, Frame, Record
from trailmark.interfaces import Session
from trailmark_datasets.config import CsvRecordsConfig
from trailmark_datasets.csv_records import CsvRecords


def opened(path: Path, text: str, **config: Any) -> CsvRecords:
    path.write_text(text, encoding="utf-8")
    source = CsvRecords(CsvRecordsConfig(path=path, **config))
    source.start(Session(name="tags"))
    return source


def told(frame: Frame) -> dict[str, list[float]]:
    assert isinstance(frame.payload, Record)
    return {name: array.tolist() for name, array in frame.payload.arrays.items()}


@pytest.fixture
def table(tmp_path: Path) -> Path:
    return tmp_path / "sightings.csv"


def test_rows_of_one_stamp_are_one_frame(table: Path) -> None:
    source = opened(table, "t,id,range,bearing\n1.0,4,2.5,0.1\n1.0,6,3.5,-0.2\n1.5,4,2.4,0.2\n")
    first, second = source.frames()
    assert told(first) == {"ids": [4, 6], "ranges_m": [2.5, 3.5], "bearings_rad": [0.1, -0.2]}
    assert (first.stamp_s, second.stamp_s) == (1.0, 1.5)
    assert source.sensors["tags"].kind == "range_bearing"


def test_what_is_not_told_is_nan_and_the_kind_says_what_is(table: Path) -> None:
    source = opened(table, "t,id,range\n1.0,4,2.5\n")
    (frame,) = source.frames()
    assert math.isnan(told(frame)["bearings_rad"][0])
    assert source.sensors["tags"].kind == "range"


def test_a_column_a_landmark_and_no_stamps(table: Path) -> None:
    header = ("bearing:1", "bearing:2", "bearing:3")
    source = opened(table, "90,-90,\n45,nan,180\n", header=header, angle_unit="deg", rate_hz=10)
    first, second = source.frames()
    assert told(first)["ids"] == [1, 2]
    np.testing.assert_allclose(told(first)["bearings_rad"], [math.pi / 2, -math.pi / 2])
    assert told(second)["ids"] == [1, 3]
    assert second.stamp_s == pytest.approx(0.1)
    assert source.sensors["tags"].kind == "bearing"


def test_codes_units_and_places(table: Path, tmp_path: Path) -> None:
    (tmp_path / "codes.txt").write_text("6 72\n7 27\n")
    (tmp_path / "places.txt").write_text("# id x y\n6 1.0 2.0 0.001\n7 3.0 4.0 0.001\n")
    source = opened(
        table,
        "10.0 72 400\n10.5 5 100\n",
        header=("t", "id", "range"),
        metres_per_unit=0.01,
        codes=tmp_path / "codes.txt",
        codes_header=("id", "code"),
        landmarks=tmp_path / "places.txt",
        landmarks_header=("id", "x", "y"),
    )
    first, second = source.frames()
    assert told(first) == {"ids": [6], "ranges_m": [4.0], "bearings_rad": [pytest.approx(math.nan, nan_ok=True)]}
    assert told(second)["ids"] == [-1]  # a code of nobody
    calibration = source.sensors["tags"].calibration
    assert isinstance(calibration, Arrays)
    assert calibration.arrays["ids"].tolist() == [6, 7]
    assert calibration.arrays["positions_map"].tolist() == [[1.0, 2.0], [3.0, 4.0]]


def test_landmarks_without_numbers_are_counted_from_one(table: Path, tmp_path: Path) -> None:
    (tmp_path / "places.csv").write_text("0, 0\n6, 0\n")
    source = opened(table, "t,id,range\n0,1,2\n", landmarks=tmp_path / "places.csv", landmarks_header=("x", "y"))
    calibration = source.sensors["tags"].calibration
    assert isinstance(calibration, Arrays)
    assert calibration.arrays["ids"].tolist() == [1, 2]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,id\n1,2\n", r"it needs the columns id and range or bearing"),
        ("id,range\n1,2\n", r"no column t; name it in columns: \{t: \.\.\.\}, or set rate_hz"),
        ("t,id,range\n1,2.5,3\n", r"sightings\.csv:2: column 'id' is '2\.5', not a whole number"),
        ("t,id,range\n1,2,-3\n", r"sightings\.csv:2: a range of -3 m is negative"),
        ("t,id,bearing\n1,2,45\n", r"sightings\.csv:2: a bearing of 45 rad is more than a turn; .* angle_unit: deg"),
        ("t,id,range\n1,2,far\n", r"sightings\.csv:2: column 'range' is 'far', not a number"),
        ("t,id,range\nx,2,3\n", r"sightings\.csv:2: the stamp is 'x', not a number"),
        ("t,id,range\n2,2,3\n1,2,3\n", r"the stamp goes back"),
    ],
)
def test_what_cannot_be_read_says_where_and_what_to_do(table: Path, text: str, message: str) -> None:
    with pytest.raises(SourceError, match=message):
        list(opened(table, text).frames())


def test_bad_rows_can_be_skipped(table: Path) -> None:
    source = opened(table, "t,id,range\n1,2,3\n2,2,far\nx,2,3\n3,2,4\n", on_bad_frame="skip")
    assert [frame.stamp_s for frame in source.frames()] == [1.0, 3.0]
    assert source.counters()["skipped"] == 2


def test_two_landmarks_of_one_id_are_refused(table: Path, tmp_path: Path) -> None:
    (tmp_path / "places.csv").write_text("id,x,y\n1,0,0\n1,6,0\n")
    with pytest.raises(SourceError, match="two landmarks have one id: 1"):
        opened(table, "t,id,range\n0,1,2\n", landmarks=tmp_path / "places.csv")
