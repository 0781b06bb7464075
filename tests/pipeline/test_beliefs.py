"""``beliefs.csv`` and ``outlines.json`` of a run."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from trailmark.errors import ShapeError
from trailmark.estimates import Belief, Motion
from trailmark.evaluation.belief_table import BeliefTable, read_beliefs, read_outlines
from trailmark.frames import SensorInfo
from trailmark.frames.outlines import Outlines
from trailmark.geometry import Pose2
from trailmark.pipeline import Pipeline
from trailmark.pipeline.outputs.beliefs import BeliefLog


def belief(stamp_s: float) -> Belief:
    covariance = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.2, 2.0]])
    return Belief(stamp_s, Pose2(stamp_s, 1.0, 0.5), covariance)


def test_a_table_gives_back_what_was_believed(tmp_path) -> None:
    log = BeliefLog()
    for k in range(10):
        log.add(belief(0.1 * k))
    (tmp_path / "beliefs.csv").write_text(log.text())

    table = read_beliefs(tmp_path / "beliefs.csv")

    np.testing.assert_array_equal(table.stamps_s, [0.1 * k for k in range(10)])
    np.testing.assert_array_equal(table.poses[3], [0.1 * 3, 1.0, 0.5])
    np.testing.assert_array_equal(table.covariances[7], belief(0.0).covariance)


def test_beliefs_are_judged_as_fixes_by_their_own_covariance() -> None:
    table = BeliefTable(
        np.array([0.5, 1.0]), np.array([[1.0, 2.0, 0.1], [3.0, 4.0, 0.2]]), np.stack([np.eye(3) * 4.0] * 2)
    )

    fixes = table.as_fixes("fused")

    assert set(zip(fixes.source, fixes.kind, fixes.outcome, fixes.reason)) == {("fused", "fix", "accepted", "")}
    np.testing.assert_array_equal(fixes.arrived_s, table.stamps_s)
    np.testing.assert_array_equal(fixes.stamp_s, table.stamps_s)
    np.testing.assert_array_equal(fixes.numbers, table.poses)
    np.testing.assert_allclose(fixes.information, [np.eye(3) / 4.0] * 2)
    assert np.isnan([fixes.since_s, fixes.nis, fixes.dof]).all()


def test_a_long_run_keeps_a_bounded_table_that_spans_it(tmp_path) -> None:
    log = BeliefLog()
    for k in range(50_000):
        log.add(belief(float(k)))
    (tmp_path / "beliefs.csv").write_text(log.text())

    table = read_beliefs(tmp_path / "beliefs.csv")

    assert 1000 <= len(table) <= 2001
    assert len(np.unique(np.diff(table.stamps_s))) == 1
    assert table.stamps_s[-1] > 49_900


def test_of_several_beliefs_of_one_stamp_the_last_is_kept(tmp_path) -> None:
    log = BeliefLog()
    for k in range(5000):
        log.add(Belief(float(k), Pose2(), 9.0 * np.eye(3)))
        log.add(Belief(float(k), Pose2(), np.eye(3)))
    (tmp_path / "beliefs.csv").write_text(log.text())

    table = read_beliefs(tmp_path / "beliefs.csv")

    assert len(np.unique(np.diff(table.stamps_s))) == 1
    assert table.covariances.max() == 1.0


def test_beliefs_without_pose_or_covariance_leave_no_table() -> None:
    log = BeliefLog()
    log.add(Belief(0.0))
    log.add(Belief(1.0, Pose2()))

    assert log.text() == ""


def test_outlines_of_a_source_are_kept_with_the_run(fakes, tmp_path) -> None:
    run(fakes, tmp_path / "run", lambda: Outlines((np.array([[0.0, 0.0], [1.0, 2.0]]),), np.array([[0.2, 0.1]])))

    found = read_outlines(tmp_path / "run/outlines.json")

    np.testing.assert_array_equal(found.around[0], [[0.0, 0.0], [1.0, 2.0]])
    np.testing.assert_array_equal(found.robot, [[0.2, 0.1]])


def test_a_source_that_fails_at_its_outlines_ends_no_run(fakes, tmp_path, caplog) -> None:
    with caplog.at_level(logging.WARNING):
        result = run(fakes, tmp_path / "run", lambda: 1 / 0)

    assert result.status == "done"
    assert not (tmp_path / "run/outlines.json").exists()
    assert "gives no outlines" in caplog.text


def test_an_outline_is_made_of_points() -> None:
    with pytest.raises(ShapeError, match="finite points"):
        Outlines((np.zeros((3, 3)),))


def run(fakes, folder, outlines):
    """Run a source of five pictures that has outlines."""

    def say(frame, _belief):
        return (Motion(frame.stamp_s - 0.1, frame.stamp_s, Pose2(0.1), fakes.GOOD),) if frame.stamp_s else ()

    source = fakes.Recording(fakes.image_frames("cam", [k / 10 for k in range(5)]), [SensorInfo("cam", "image")])
    source.outlines = outlines
    pipeline = Pipeline(fakes.parts({"cam": source}, {"vo": fakes.Scripted(say)}), out=folder)
    list(pipeline)
    return pipeline.result
