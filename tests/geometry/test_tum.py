"""Trajectory files of the TUM format."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.errors import DataError
from trailmark.geometry import Trajectory, read_tum, write_tum

trajectories = st.lists(
    st.tuples(st.floats(1e-3, 1e3), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-3.1, 3.1)), max_size=8
).map(lambda rows: Trajectory(np.cumsum([row[0] for row in rows]), np.array([row[1:] for row in rows]).reshape(-1, 3)))


@given(trajectories)
def test_what_is_written_is_read_again(trajectory: Trajectory) -> None:
    with tempfile.TemporaryDirectory() as folder:
        write_tum(Path(folder) / "a.tum", trajectory)
        found = read_tum(Path(folder) / "a.tum")

    np.testing.assert_allclose(found.stamps_s, trajectory.stamps_s, atol=1e-9)
    np.testing.assert_allclose(found.positions, trajectory.positions, atol=1e-9)
    np.testing.assert_allclose(np.cos(found.headings - trajectory.headings), 1.0, atol=1e-12)


def test_the_format_is_eight_numbers_with_z_zero(tmp_path: Path) -> None:
    write_tum(tmp_path / "a.tum", Trajectory(np.array([1.5]), np.array([[1.0, -2.0, math.pi / 2]])))

    assert (tmp_path / "a.tum").read_text() == (
        "1.500000000 1.000000000 -2.000000000 0 0 0 0.707106781187 0.707106781187\n"
    )


def test_stamps_of_the_epoch_keep_their_nanoseconds(tmp_path: Path) -> None:
    write_tum(tmp_path / "a.tum", Trajectory(np.array([1311868164.363181, 1311868164.399026]), np.zeros((2, 3))))

    assert (tmp_path / "a.tum").read_text().split()[0] == "1311868164.363181114"  # all that a double holds


def test_stamps_that_are_one_when_written_are_one_pose_the_last(tmp_path: Path) -> None:
    poses = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    write_tum(tmp_path / "a.tum", Trajectory(np.array([0.2, 0.3, 0.1 * 3]), poses))

    found = read_tum(tmp_path / "a.tum")

    assert found.stamps_s.tolist() == [0.2, 0.3]
    assert found.poses[:, 0].tolist() == [1.0, 3.0]


def test_poses_in_space_are_projected_to_the_plane(tmp_path: Path) -> None:
    roll, yaw = 0.3, 0.8
    quat_xyzw = (
        math.sin(roll / 2) * math.cos(yaw / 2),
        math.sin(roll / 2) * math.sin(yaw / 2),
        math.cos(roll / 2) * math.sin(yaw / 2),
        math.cos(roll / 2) * math.cos(yaw / 2),
    )
    (tmp_path / "a.tum").write_text("# t x y z qx qy qz qw\n\n0 1 2 3 " + " ".join(map(str, quat_xyzw)) + "\n")

    np.testing.assert_allclose(read_tum(tmp_path / "a.tum").poses, [[1.0, 2.0, yaw]], atol=1e-12)


def test_commas_and_comments_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.tum").write_text("# head\n0,1,2,0,0,0,0,1\n\n  1 2 3 0 0 0 0 1  \n# tail")

    np.testing.assert_array_equal(read_tum(tmp_path / "a.tum").poses, [[1, 2, 0], [2, 3, 0]])


def test_an_empty_file_is_an_empty_trajectory(tmp_path: Path) -> None:
    (tmp_path / "a.tum").write_text("# nothing\n")

    assert len(read_tum(tmp_path / "a.tum")) == 0


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1 2 3", "expected 8 numbers .*, found 3"),
        ("1 2 3 4 5 6 7 8 9", "expected 8 numbers .*, found 9"),
        ("1 0 zero 0 0 0 0 1", "'zero' is not a number"),
        ("1 0 nan 0 0 0 0 1", "a number is not finite"),
        ("1 0 inf 0 0 0 0 1", "a number is not finite"),
        ("1 0 0 0 0 0 0 0", "the quaternion has norm 0"),
        ("1 0 0 0 2 0 0 1", "the quaternion has norm 2.24"),
        ("-1 0 0 0 0 0 0 1", "stamps must increase"),
        ("1 -1e308 0 0 0 0 0 1", r"1 s at \(-1e\+308, 0\) m is beyond all that can be computed with"),
        ("1e300 0 0 0 0 0 0 1", r"1e\+300 s at \(0, 0\) m is beyond"),
        ("x" * 100_000, "expected 8 numbers"),
    ],
)
def test_a_malformed_line_is_named(tmp_path: Path, line: str, message: str) -> None:
    (tmp_path / "a.tum").write_text(f"# head\n0 0 0 0 0 0 0 1\n{line}\n")

    with pytest.raises(DataError, match=rf"a\.tum:3: {message}") as raised:
        read_tum(tmp_path / "a.tum")
    assert len(str(raised.value)) < 300 + len(str(tmp_path))


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n\xff\xfe")

    with pytest.raises(DataError, match=r"picture\.png is not a text file"):
        read_tum(tmp_path / "picture.png")
    with pytest.raises(DataError, match=r"cannot read trajectory .*missing\.tum"):
        read_tum(tmp_path / "missing.tum")


def test_a_device_is_no_trajectory():
    with pytest.raises(DataError, match="/dev/zero: it is a device or a pipe"):
        read_tum("/dev/zero")


def test_of_poses_at_one_stamp_the_first_is_kept_and_the_others_are_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "other.tum"
    path.write_text("0 1 0 0 0 0 0 1\n0 2 0 0 0 0 0 1\n1 3 0 0 0 0 0 1\n1 4 0 0 0 0 0 1\n1 5 0 0 0 0 0 1\n")

    trajectory = read_tum(path)

    np.testing.assert_array_equal(trajectory.stamps_s, [0.0, 1.0])
    np.testing.assert_array_equal(trajectory.positions[:, 0], [1.0, 3.0])
    assert "3 poses repeat a stamp; the first one of each is kept" in caplog.text
