"""Relations between poses: known answers, what an error costs, and files that cannot be."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.cli import main
from trailmark.errors import DataError
from trailmark.evaluation.relations import Relations, read_relations, relation_errors
from trailmark.evaluation.relative import between
from trailmark.geometry import Pose2, Trajectory

STAMPS_S = np.arange(0.0, 100.0, 1.0)


def circle(turn_rad: float = 0.05) -> Trajectory:
    """Return a way of 1 m and a turn every second."""
    poses = [Pose2()]
    for _ in STAMPS_S[1:]:
        poses.append(poses[-1] @ Pose2.exp(1.0, 0.0, turn_rad))
    return Trajectory(STAMPS_S, np.array([pose.array() for pose in poses]))


def relations_of(way: Trajectory, pairs: list[tuple[int, int]]) -> Relations:
    """Return what holds between poses of a way."""
    first, last = (np.array(column) for column in zip(*pairs, strict=True))
    return Relations(way.stamps_s[first], way.stamps_s[last], between(way.poses[first], way.poses[last]))


PAIRS = [(0, 1), (5, 6), (40, 41), (10, 80), (80, 10)]


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-7, 7))
def test_the_frame_of_the_estimate_does_not_matter(x: float, y: float, theta: float) -> None:
    found = relation_errors(circle().transformed(Pose2(x, y, theta)), relations_of(circle(), PAIRS))

    np.testing.assert_allclose(found.translation_m, 0.0, atol=1e-9)
    np.testing.assert_allclose(found.rotation_rad, 0.0, atol=1e-9)
    assert found.closes_loop.tolist() == [False, False, False, True, True]


def test_an_error_made_once_counts_where_it_is_spanned() -> None:
    true = circle()
    bent = np.array(true.poses)
    turn, pivot = Pose2(0.3, 0.0, 0.2), Pose2.from_array(bent[20])
    for i in range(21, len(bent)):  # one step was too long by 0.3 m and turned by 0.2 rad
        bent[i] = (pivot @ turn @ pivot.inverse() @ Pose2.from_array(bent[i])).array()

    found = relation_errors(Trajectory(STAMPS_S, bent), relations_of(true, [*PAIRS, (20, 21)]))

    np.testing.assert_allclose(found.translation_m[[0, 1, 2]], 0.0, atol=1e-9)
    np.testing.assert_allclose(found.rotation_rad, [0.0, 0.0, 0.0, 0.2, 0.2, 0.2], atol=1e-9)
    assert found.translation_m[3] > 0.3
    step = between(true.poses[20:21], true.poses[21:22])[0]
    moved = turn @ Pose2.from_array(step)
    assert found.translation_m[5] == pytest.approx(math.hypot(moved.x - step[0], moved.y - step[1]))


def test_groups_and_their_figures() -> None:
    way = circle(0.0)
    relations = relations_of(way, PAIRS[:4])
    relations.poses[:, 0] += [0.1, -0.3, 0.1, 0.5]

    document = relation_errors(way, relations).document()

    assert (document["relations"], document["covered"]) == (4, 4)
    everything, loops = document["all"], document["loops"]
    assert isinstance(everything, dict)
    assert isinstance(loops, dict)
    assert everything["translation_m_mean"] == pytest.approx(0.25)
    assert everything["translation_m_rms"] == pytest.approx(math.sqrt((0.01 + 0.09 + 0.01 + 0.25) / 4))
    assert everything["translation_m_max"] == pytest.approx(0.5)
    assert (loops["n"], loops["translation_m_mean"]) == (1, pytest.approx(0.5))


def test_outliers_are_left_out_of_one_group_only() -> None:
    way = circle(0.0)
    relations = relations_of(way, [(i, i + 1) for i in range(60)])
    relations.poses[:, 0] += np.where(np.arange(60) == 7, 5.0, 0.1)

    document = relation_errors(way, relations).document()

    assert document["all"]["n"] == 60
    assert document["without_outliers"]["n"] == 59
    assert document["without_outliers"]["translation_m_max"] == pytest.approx(0.1)


def test_relations_that_are_not_covered_are_counted() -> None:
    way = circle()
    half = Trajectory(way.stamps_s[:50], way.poses[:50])

    document = relation_errors(half, relations_of(way, PAIRS)).document()

    assert (document["relations"], document["covered"]) == (5, 3)
    assert document["loops"] is None


def test_another_clock_is_refused() -> None:
    way = circle()
    later = Trajectory(way.stamps_s + 1e9, way.poses)

    with pytest.raises(DataError, match="are the clocks the same"):
        relation_errors(later, relations_of(way, PAIRS))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "has no relations"),
        ("# nothing\n", "has no relations"),
        ("1 2 3\n", ":1: expected 8 finite numbers"),
        ("1 2 0 0 0 0 0 0\n1 2 0 0 0 0 0 nan\n", ":2: expected 8 finite numbers"),
        ("1 2 0 0 a 0 0 0\n", ":1: expected 8 finite numbers"),
        ("1 2 0 0 0.5 0 0 0\n", ":1: z, roll and pitch are not zero"),
    ],
)
def test_a_file_that_cannot_be_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "a.relations"
    path.write_text(text)

    with pytest.raises(DataError, match=said):
        read_relations(path)


def test_the_command_prints_and_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = [(t, *pose) for t, pose in zip(STAMPS_S, circle(0.0).poses, strict=True)]
    Path("a.tum").write_text("".join(f"{t} {x} {y} 0 0 0 {math.sin(a / 2)} {math.cos(a / 2)}\n" for t, x, y, a in rows))
    Path("a.relations").write_text("0 1 1.1 0 0 0 0 0\n10 60 50 0 0 0 0 0.1\n")

    for words in ([], ["--json"]):
        with pytest.raises(SystemExit) as left:
            main(["evaluate", "--relations", "a.relations", "a.tum", *words])
        assert not left.value.code

    table, _, document = capsys.readouterr().out.partition("{")
    assert "2 of 2 relations" in table
    found = json.loads("{" + document)["trajectories"][0]
    assert found["all"]["translation_m_mean"] == pytest.approx(0.05)
    assert found["loops"]["rotation_deg_mean"] == pytest.approx(math.degrees(0.1))


@pytest.mark.data
def test_raw_wheels_of_aces_are_off_by_what_is_known(data_folder: Path) -> None:
    """The odometry in the log, without interpolation: 0.549 +- 2.674 m and 2.33 +- 6.50 deg."""
    import bz2

    poses: dict[float, list[float]] = {}
    with bz2.open(data_folder / "laser/aces.clf.bz2", "rt") as log:
        for line in log:
            if line.startswith("FLASER"):
                fields = line.split()
                poses[float(fields[-3])] = [float(value) for value in fields[-6:-3]]
    stamps_s = sorted(poses)
    wheels = Trajectory(np.array(stamps_s), np.array([poses[stamp_s] for stamp_s in stamps_s]))

    found = relation_errors(wheels, read_relations(data_folder / "laser/aces.relations"))

    assert len(found.translation_m) == 1279
    assert (found.closes_loop.sum()) == 90
    assert found.translation_m.mean() == pytest.approx(0.549, abs=0.002)
    assert found.translation_m.std() == pytest.approx(2.674, abs=0.005)
    assert np.degrees(found.rotation_rad.mean()) == pytest.approx(2.33, abs=0.01)
