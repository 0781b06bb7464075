"""Measuring a playback against the truth of teaching and of the playback."""

from __future__ import annotations

import json
import math
import tempfile
from pathlib import Path

import numpy as np
import pytest

from trailmark.geometry import Pose2, Trajectory, write_tum
from trailmark.interfaces import Session
from trailmark.paths import Keyframe
from trailmark.stores.sqlite import SqlitePathStore
from trailmark.stores.sqlite_config import SqliteStoreConfig
from trailmark_papers.kit import Table
from trailmark_papers.nagai2015 import hard_day
from trailmark_papers.nagai2015.directions import add_directions
from trailmark_papers.nagai2015.playback import Playback, read_playback, relative

#: The true path lies along x from the origin; teaching believed it here.
DRIFT = Pose2(0.3, -0.2, 0.4)
HEADER = (
    "arrived_s,source,kind,since_s,stamp_s,x,y,theta,info_xx,info_xy,info_xt,info_yy,info_yt,info_tt,"
    "status,nis,dof,reason,details"
)


def believed(x: float, y: float, theta: float = 0.0) -> Pose2:
    return DRIFT @ Pose2(x, y, theta)


def write_run(folder: Path, truth: list[Pose2], fused: list[Pose2], rows: list[str]) -> Path:
    (folder / "trajectories").mkdir(parents=True)
    stamps = 0.1 * np.arange(len(truth))
    for name, poses in (("groundtruth", truth), ("fused", fused), ("floor", fused)):
        write_tum(folder / "trajectories" / f"{name}.tum", Trajectory.from_poses(zip(stamps, poses)))
    (folder / "config.yaml").write_text("localizers: {floor: {plugin: ground_vo}}\n", encoding="utf-8")
    (folder / "estimates.csv").write_text("\n".join([HEADER, *rows]) + "\n", encoding="utf-8")
    told = {"status": "done", "reason": "there", "counters": {"source.floor.collisions": 2}}
    (folder / "run.json").write_text(json.dumps(told), encoding="utf-8")
    return folder


def search(stamp_s: float, arrived_s: float, place: int, pose: Pose2 | None, shift_px: float = 0.0) -> str:
    details = json.dumps({"place": float(place), "shift_px": shift_px}).replace('"', '""')
    if pose is None:
        return f'{arrived_s},floor_map,lost,,{stamp_s},,,,,,,,,,unused,,,no,"{details}"'
    return f'{arrived_s},floor_map,fix,,{stamp_s},{pose.x},{pose.y},{pose.theta},1,0,0,1,0,1,accepted,,,,"{details}"'


@pytest.fixture
def store(tmp_path: Path) -> Path:
    path = tmp_path / "path.trail"
    opened = SqlitePathStore(SqliteStoreConfig(path=str(path), access="create"))
    opened.start(Session(mode="teach"))
    localizer_map = opened.localizer_map("floor_map")
    for k in range(5):  # every 0.1 m, a picture each
        localizer_map.add(Keyframe(0.1 * k, 0.1 * k, believed(0.1 * k, 0.0), {"patch": np.zeros((44, 44), np.uint8)}))
    opened.commit()
    opened.close()
    return path


@pytest.fixture
def taught(tmp_path: Path) -> Path:
    way = [Pose2(0.1 * k, 0.0) for k in range(5)]
    return write_run(tmp_path / "teach", way, [believed(pose.x, pose.y) for pose in way], [])


def playback(taught: Path, store: Path, truth: list[Pose2], fused: list[Pose2], rows: list[str]):
    return read_playback(taught, write_run(Path(tempfile.mkdtemp(dir=taught.parent)), truth, fused, rows), store)


def test_what_teaching_got_wrong_is_no_error_of_playback(taught: Path, store: Path) -> None:
    way = [Pose2(0.1 * k, 0.004, 0.01) for k in range(5)]
    right = [believed(pose.x, pose.y, pose.theta) for pose in way]
    rows = [search(0.1 * k, 0.1 * k, k, right[k], shift_px=10.0) for k in range(5)]

    found = playback(taught, store, way, right, rows)

    np.testing.assert_allclose(found.false_m(), 0.0, atol=1e-8)
    np.testing.assert_allclose(found.corrected_m(), 0.0, atol=1e-8)
    np.testing.assert_allclose(found.offsets[:, 1], 0.004, atol=1e-8)
    np.testing.assert_allclose(found.offsets[:, 2], 0.01, atol=1e-8)
    np.testing.assert_allclose(found.at_searches(), found.offsets)
    np.testing.assert_allclose(found.detected_m(), 3.91e-3, atol=0.01e-3)
    np.testing.assert_allclose(found.intervals_m(), 0.1, atol=1e-8)
    assert found.directions.tolist() == [1] * 5
    assert (found.n_touched, found.status, found.reason) == (2, "done", "there")
    assert found.end_miss_m == pytest.approx(0.004)


def test_a_late_answer_is_judged_where_it_arrives(taught: Path, store: Path) -> None:
    way = [Pose2(0.1 * k, 0.0) for k in range(5)]
    fused = [believed(pose.x, pose.y + (0.002 if k == 3 else 0.0)) for k, pose in enumerate(way)]
    rows = [search(0.1, 0.29, 1, believed(0.1, 0.001))]

    found = playback(taught, store, way, fused, rows)

    assert found.false_m() == pytest.approx([0.001])
    assert found.corrected_m() == pytest.approx([0.002])


def test_rejected_searches_count_and_lengthen_the_interval(taught: Path, store: Path) -> None:
    way = [Pose2(0.1 * k, 0.0) for k in range(5)]
    fused = [believed(pose.x, pose.y) for pose in way]
    rows = [search(0.0, 0.0, 0, fused[0]), search(0.1, 0.1, 1, None), search(0.3, 0.3, 3, fused[3])]

    found = playback(taught, store, way, fused, rows)

    assert found.rejected_percent() == pytest.approx(100 / 3)
    np.testing.assert_allclose(found.intervals_m(), [0.3], atol=1e-8)
    assert len(found.detected_m()) == 2


def test_an_answer_after_the_last_picture_has_no_corrected_belief(taught: Path, store: Path) -> None:
    way = [Pose2(0.1 * k, 0.0) for k in range(5)]
    fused = [believed(pose.x, pose.y) for pose in way]

    found = playback(taught, store, way, fused, [search(0.4, 0.6, 4, fused[4])])

    assert len(found.corrected_m()) == 0
    assert len(found.false_m()) == 1


def test_the_way_back_is_told_apart(taught: Path, store: Path) -> None:
    there = [0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14, 0.16, 0.18]
    way = [Pose2(x, 0.0) for x in there + there[::-1]]
    fused = [believed(pose.x, pose.y) for pose in way]

    found = playback(taught, store, way, fused, [search(0.5, 0.5, 1, fused[5]), search(1.4, 1.4, 1, fused[14])])

    assert found.directions.tolist() == [1, -1]


def test_relative_poses_are_those_of_pose2() -> None:
    rng = np.random.default_rng(7)
    first, second = rng.uniform(-3.0, 3.0, (2, 20, 3))

    actual = relative(first, second)

    expected = [Pose2.from_array(a).between(Pose2.from_array(b)).array() for a, b in zip(first, second)]
    np.testing.assert_allclose(actual[:, :2], np.array(expected)[:, :2], atol=1e-12)
    np.testing.assert_allclose(
        np.remainder(actual[:, 2] - np.array(expected)[:, 2] + math.pi, 2 * math.pi), math.pi, atol=1e-12
    )


def back_and_forth(taught: Path, store: Path, forward_m: float, back_m: float) -> Playback:
    """Drive there and back, farther to the left on one of both ways."""
    there = np.arange(0.0, 0.42, 0.02)
    way = [Pose2(x, forward_m) for x in there] + [Pose2(x, back_m) for x in there[::-1]]
    fused = [believed(pose.x, pose.y) for pose in way]
    rows = [search(0.1 * k, 0.1 * k, round(way[k].x / 0.1), fused[k]) for k in (4, 6, 8, 10, 12, 14)]
    rows += [search(0.1 * k, 0.1 * k, round(way[k].x / 0.1), fused[k]) for k in (26, 28, 30, 32, 34, 36)]
    return playback(taught, store, way, fused, rows)


def test_offsets_are_told_for_each_way_by_itself(taught: Path, store: Path) -> None:
    table = Table("course")

    add_directions(table, [back_and_forth(taught, store, 0.002, -0.005)])

    assert {row.item: (round(row.ours or 0.0, 6), row.n) for row in table} == {
        "offset at the searches, forward, mean": (2.0, 6),
        "offset at the searches, forward, max": (2.0, 6),
        "offset at the searches, reverse, mean": (5.0, 6),
        "offset at the searches, reverse, max": (5.0, 6),
    }


def test_a_way_that_was_not_driven_has_no_row(taught: Path, store: Path) -> None:
    table = Table("course")
    way = [Pose2(0.1 * k, 0.0) for k in range(5)]

    add_directions(table, [playback(taught, store, way, [believed(p.x, p.y) for p in way], [])])

    assert not table.rows


def test_a_hard_day_tells_rejections_false_corrections_and_both_ways(taught: Path, store: Path) -> None:
    way = [Pose2(0.1 * k, 0.0) for k in range(5)]
    fused = [believed(pose.x, pose.y) for pose in way]
    rows = [search(0.0, 0.0, 0, fused[0]), search(0.1, 0.1, 1, None), search(0.3, 0.3, 3, believed(0.3, 0.009))]

    driven = [playback(taught, store, way, fused, rows)]
    table = hard_day.rows_of(driven)

    found = {row.item: row for row in table}
    assert found["searches rejected"].ours == pytest.approx(100 / 3)
    assert found["searches rejected"].paper == 8.5
    assert (found["false corrections (more than 5 mm)"].ours, found["false corrections (more than 5 mm)"].met) == (
        1,
        False,
    )
    assert found["way between corrections, mean"].ours == pytest.approx(0.3)
    assert all(
        row.bar is None for row in hard_day.rows_of([playback(taught, store, way, fused, rows)], is_judged=False)
    )
