"""Reading a track between its stamps: how wrong that may be, and that it is no surprise where noise is small."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from tests.calibration.conftest import errors_of, pairs_from

from trailmark.estimates import Motion, information_from_sigmas
from trailmark.geometry import Pose2
from trailmark_calibration.fitting import fit
from trailmark_calibration.model import BIAS, YAW
from trailmark_calibration.rigid import exp_of
from trailmark_calibration.simulating import DriveNoise, draw_truth, simulate
from trailmark_calibration.tracks import ComparedTrack, track_of

QUIET = DriveNoise(way=1e-5, turn=1e-5, sensor_m=1e-5, sensor_rad=1e-5, outliers=0.0)
H_S = 0.1


def turning(headings: Sequence[float], stamps_s: Sequence[float]) -> ComparedTrack:
    """Return what somebody says who turns in place."""
    return track_of(
        "one",
        [
            Motion(since_s, stamp_s, Pose2(0.0, 0.0, turn), information_from_sigmas(0.01, 0.01, 0.01))
            for since_s, stamp_s, turn in zip(stamps_s, stamps_s[1:], np.diff(headings).tolist())
        ],
    )


def test_a_rate_that_changes_evenly_is_read_wrong_by_less_than_is_said() -> None:
    stamps_s = (H_S * np.arange(11)).tolist()
    track = turning([0.5 * 2.0 * t * t for t in stamps_s], stamps_s)  # 2 rad/s^2
    at_s = np.array([0.5, 0.525, 0.55])

    read = track.motions(np.zeros(3), at_s)[:, 2]
    said = track.reading_errors(at_s)

    np.testing.assert_allclose(np.abs(read - at_s**2), [0.0, 0.001875, 0.0025], atol=1e-9)  # s (1 - s) h^2
    np.testing.assert_allclose(said[:, 2], 2.0 * np.abs(read - at_s**2), atol=1e-9)
    np.testing.assert_allclose(said[:, :2], 0.0, atol=1e-12)


def test_a_rate_that_leaps_within_a_step_is_read_wrong_by_no_more_than_twice_what_is_said() -> None:
    stamps_s = (H_S * np.arange(11)).tolist()
    track = turning([max(0.0, t - 0.55) for t in stamps_s], stamps_s)  # 1 rad/s from 0.55 s on

    wrong = track.motions(np.zeros(1), np.array([0.55]))[0, 2]  # it has not turned yet

    assert wrong == pytest.approx(0.025)
    assert track.reading_errors(np.array([0.55]))[0, 2] == pytest.approx(0.0125)


def test_steps_that_do_not_meet_tell_no_change() -> None:
    said = [
        Motion(since_s, since_s + H_S, Pose2(way, 0.0, 0.0), information_from_sigmas(0.01, 0.01, 0.01))
        for since_s, way in ((0.0, 0.1), (0.1, 0.1), (0.9, 0.5), (1.0, 0.5))
    ]

    assert track_of("one", said).reading_errors(np.array([0.15, 0.95])) == pytest.approx(np.zeros((2, 3)))


def test_what_is_off_at_the_beginning_is_seen_from_the_end() -> None:
    """A turn that is wrong at the beginning moves the end of an interval to the side."""
    drive = simulate(np.random.default_rng(3), *draw_truth(np.random.default_rng(3)), duration_s=60.0, noise=QUIET)
    pairs, _ = pairs_from(drive)
    p = drive.truth
    base, _ = pairs.motions(p)
    errors = [pairs.a.reading_errors(at_s + p[6]) for at_s in (pairs.from_s, pairs.to_s)]
    mounting = p[[3, 4, YAW]]

    row = int(np.argmax(errors[0][:, 2]))
    expected = np.zeros((3, 3))
    for error, pose in zip(errors, (base[row], np.zeros(3))):
        for axis in range(3):  # by a small motion of base before the rest of the interval
            small = pairs.matrix(p)[:, axis] * error[row, axis]
            there = Pose2(*mounting).inverse() @ Pose2(*pose).inverse() @ Pose2.exp(*small)
            off = np.array((there @ Pose2(*pose) @ Pose2(*mounting)).log())
            expected += np.outer(off, off)

    assert not pairs.a_is_slower
    np.testing.assert_allclose(pairs.reading_covariances(p)[row], expected, rtol=1e-2, atol=1e-12)


def coarser(motions: Sequence[Motion], n: int) -> list[Motion]:
    """Return what a localizer says that gives every nth pose."""
    kept = []
    for first in range(0, len(motions) - n + 1, n):
        part = motions[first : first + n]
        pose = Pose2()
        for motion in part:
            pose = pose @ motion.pose_since_now
        kept.append(Motion(part[0].since_s, part[-1].stamp_s, pose, part[0].information / n))
    return kept


@pytest.mark.parametrize(("n_wheels", "n_sensor"), [(1, 1), (2, 1), (4, 2), (4, 4)])
@pytest.mark.parametrize("seed", [509, 513])
def test_two_quiet_localizers_are_not_told_surer_than_they_are(n_wheels: int, n_sensor: int, seed: int) -> None:
    """Wheels at 20, 10 and 5 Hz, a sensor at 10, 5 and 2.5 Hz, both without noise to speak of: without what reading
    between stamps adds, delays are wrong by 5 to 10 sigmas, or the drive is refused."""
    rng = np.random.default_rng(seed)
    truth, believed = draw_truth(rng)
    drive = simulate(rng, truth, believed, duration_s=120.0, noise=QUIET)
    drive = replace(drive, wheels=coarser(drive.wheels, n_wheels), sensor=coarser(drive.sensor, n_sensor))

    found = fit(*pairs_from(drive))

    assert found.is_told[:BIAS].all()
    assert (np.abs(errors_of(found, truth)) < 3.0 * found.sigmas)[:BIAS].all()
    assert (found.sigmas[:BIAS] < 0.002).all()


def test_a_circle_is_read_exactly() -> None:
    stamps_s = (H_S * np.arange(11)).tolist()
    step = exp_of(np.array([0.04, 0.0, 0.1]))
    said = [
        Motion(since_s, stamp_s, Pose2(*step), information_from_sigmas(0.01, 0.01, 0.01))
        for since_s, stamp_s in pairwise(stamps_s)
    ]
    track = track_of("one", said)

    assert track.reading_errors(np.array([0.55])) == pytest.approx(np.zeros((1, 3)), abs=1e-12)
    assert track.motions(np.zeros(1), np.array([0.55]))[0, 2] == pytest.approx(math.remainder(0.55, math.tau))
