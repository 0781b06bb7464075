"""True poses from a table."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from trailmark.errors import SourceError
from trailmark_datasets.config import PosesConfig
from trailmark_datasets.posetable import FrameStamp, poses_from_table

FRAMES = [FrameStamp(10.0, "a.png"), FrameStamp(11.0, "b.png"), FrameStamp(12.0, "c.png")]


def read(tmp_path, text, frames=FRAMES, **keys):
    path = tmp_path / "poses.csv"
    path.write_text(text)
    return poses_from_table(PosesConfig.model_validate({"poses": path, **keys}), frames)


def test_rows_with_stamps_keep_them(tmp_path):
    truth = read(tmp_path, "t,x,y,yaw\n0.5,1,2,3\n0.75,4,5,-3\n")

    np.testing.assert_allclose(truth.stamps_s, [0.5, 0.75])
    np.testing.assert_allclose(truth.poses, [[1, 2, 3], [4, 5, -3]])


def test_a_table_without_header_is_named(tmp_path):
    truth = read(tmp_path, "# MRCLAM\n1.5 \t 1 \t 2 \t 0.5\n", poses_header=["t", "x", "y", "theta"])

    assert truth[0][0] == 1.5


def test_rows_that_name_files_come_in_any_order_and_for_some_frames_only(tmp_path):
    truth = read(tmp_path, "file,x,y,theta\nimages/c.png,3,0,0\nimages\\a.png,1,0,0\nnone.png,9,9,9\n")

    np.testing.assert_allclose(truth.stamps_s, [10.0, 12.0])
    np.testing.assert_allclose(truth.poses[:, 0], [1, 3])


def test_rows_without_either_belong_to_the_frames_in_order(tmp_path):
    truth = read(tmp_path, "x y theta\n1 0 0\n2 0 0\n3 0 0\n")

    np.testing.assert_allclose(truth.stamps_s, [10.0, 11.0, 12.0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,x,y\n0,1,2\n", "no column for theta; name it in poses_columns"),
        ("x,y,theta\n1,2,3\n", r"has 1 rows for 3 frames; add a column t \(stamp\) or file \(name\)"),
        ("file,x,y,theta\nz.png,1,2,3\n", "none of the 1 rows names a frame, such as 'a.png'"),
        ("file,x,y,theta\na.png,1,2,3\na.png,1,2,3\n", r"poses\.csv:3: .*10\.0+ s does not come after"),
        (
            "t,x,y,theta\n2,1,2,3\n1,1,2,3\n",
            r"poses\.csv:3: .* 1\.0+ s does not come after that at 2\.0+ s",
        ),
        ("t,x,y,theta\n2,1,far,3\n", r"poses\.csv:2: column 'y' is 'far', not a number"),
        ("t,x,y,theta\n2,1\n", r"poses\.csv:2: expected 4 fields, found 2"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(tmp_path, text, message):
    with pytest.raises(SourceError, match=message):
        read(tmp_path, text)


def test_without_frames_there_must_be_stamps(tmp_path):
    with pytest.raises(SourceError, match=r"no column t; name it in poses_columns: \{t: \.\.\.\}"):
        read(tmp_path, "x,y,theta\n1,2,3\n", frames=[])


def test_columns_are_renamed_by_quantity(tmp_path):
    truth = read(tmp_path, "t,X [m],Y [m],h\n1,2,3,0\n", poses_columns={"theta": "h"})

    np.testing.assert_allclose(truth.poses, [[2, 3, 0]])


def test_a_rename_the_wrong_way_round_is_refused():
    with pytest.raises(ValidationError, match=r"'h' is no quantity \(t, file, x, y, theta\); write \{theta: h\}"):
        PosesConfig.model_validate({"poses_columns": {"h": "theta"}})
