"""Trajectories of a run, however long."""

from __future__ import annotations

import logging
import tracemalloc

import numpy as np
import pytest

from trailmark.estimates import (
    Applied,
    EstimateRecord,
    Fix,
    Motion,
    information_along,
    information_from_sigmas,
)
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.pipeline.outputs import tracks
from trailmark.pipeline.outputs.tracks import Track, Tracks

N_POSES = 40_000


def _fill(track: Track, n: int) -> None:
    for k in range(n):
        track.add(0.5 * k, Pose2(0.25 * k, -k, 0.0))


def test_a_long_track_is_given_back_whole() -> None:
    track = Track()
    _fill(track, N_POSES)

    found = track.trajectory()

    k = np.arange(N_POSES)
    assert len(track) == N_POSES
    np.testing.assert_array_equal(found.stamps_s, 0.5 * k)
    np.testing.assert_array_equal(found.poses, np.column_stack([0.25 * k, -1.0 * k, 0.0 * k]))


def test_a_track_can_be_looked_at_and_gone_on_with() -> None:
    track = Track()
    _fill(track, N_POSES)
    before = track.trajectory()

    for k in range(N_POSES, 2 * N_POSES):
        track.add(0.5 * k, Pose2(0.25 * k, -k, 0.0))

    assert len(track.trajectory().stamps_s) == 2 * N_POSES
    np.testing.assert_array_equal(track.trajectory().poses[:N_POSES], before.poses)


def test_of_one_stamp_the_last_pose_counts_also_where_older_ones_have_just_left_memory() -> None:
    for n in (tracks._N_HELD, tracks._N_HELD + 1, tracks._N_HELD + 2):
        track = Track()
        _fill(track, n)
        last_s = 0.5 * (n - 1)

        track.add(last_s, Pose2(7.0, 8.0, 0.5))
        track.add(last_s - 0.1, Pose2(9.0, 9.0, 0.0))

        found = track.trajectory()
        assert len(found.stamps_s) == len(track) == n
        assert found.poses[-1].tolist() == [7.0, 8.0, 0.5]
        assert found.stamps_s[-1] == last_s


def test_a_long_track_takes_no_more_memory_than_a_short_one() -> None:
    track = Track()
    _fill(track, tracks._N_HELD + 10)
    tracemalloc.start()
    try:
        for k in range(100_000):
            track.add(1e6 + k, Pose2(k, k, 0.0))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()

    assert peak < 4 * 8 * tracks._N_HELD * 4  # and the poses alone are 3.2 MB
    assert len(track) == tracks._N_HELD + 10 + 100_000


def test_where_no_file_can_be_written_nothing_is_lost(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full() -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(tracks, "TemporaryFile", full)
    track = Track()
    with caplog.at_level(logging.WARNING):
        _fill(track, N_POSES)

    assert len(track.trajectory().stamps_s) == N_POSES
    assert caplog.messages == [
        "trajectories stay in memory: no temporary file can be written: [Errno 28] No space left on device"
    ]


def test_fixes_of_one_number_alone_make_no_track_and_with_motion_they_do() -> None:
    one = Fix(1.0, Pose2(1.0, 2.0), information_along([1.0, 0.0, 0.0], 0.1))
    whole = Fix(2.0, Pose2(1.0, 2.0), information_from_sigmas(0.1, 0.1, 0.1))
    collected = Tracks(["radios", "camera", "both"], Session(start_pose=Pose2()))
    for source, estimate in (
        ("radios", one),
        ("camera", whole),
        ("both", Motion(0.0, 1.0, Pose2(1.0), information_from_sigmas(0.1, 0.1, 0.1))),
        ("both", one),
    ):
        collected.on_estimate_record(EstimateRecord(estimate.stamp_s, source, estimate, Applied("accepted")))
    assert {name: len(track) for name, track in collected.trajectories().items()} == {
        "radios": 0,
        "camera": 1,
        "both": 1,
        "fused": 0,
    }
