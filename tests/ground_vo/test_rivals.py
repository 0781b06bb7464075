"""Marks on the lens that are steeper than the ground, and the motion of all the rest that contradicts them."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from trailmark.estimates import Belief, Lost, Motion
from trailmark.frames import Image
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.testing.ground import MirroredFloor, ground_run
from trailmark_ground_vo.audit import MotionAudit
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.filters import smooth
from trailmark_ground_vo.localizer import GroundVO
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.rivals import RivalSearch, least_spread
from trailmark_ground_vo.tracker import TrackedMotion
from trailmark_ground_vo.witness import ShiftVote, ShiftWitness

STILL = ImageMotion(0.0, 0.0, 0.0)
SURE, UNSURE = np.diag([1e4, 1e4, 1e8]), np.diag([1e-3, 1e-3, 1e2])
SHIFT = 13
ACCELERATION_MPS2 = 0.4


@pytest.fixture(scope="module")
def stones() -> MirroredFloor:
    """A floor of soft stones of 24 texels: what is a few pixels away looks alike."""
    rng, side = np.random.default_rng(11), 512
    few = rng.normal(128.0, 35.0, (side // 24 + 1, side // 24 + 1)).astype(np.float32)
    levels = cv2.resize(few, None, fx=24, fy=24, interpolation=cv2.INTER_NEAREST)[:side, :side]
    grain = cv2.GaussianBlur(rng.standard_normal((side, side), dtype=np.float32), (0, 0), 2.0)
    texture = cv2.GaussianBlur(levels, (0, 0), 6.0) + 4.0 * grain / grain.std()
    return MirroredFloor(np.asarray(np.clip(texture, 0.0, 255.0), np.float32))


@pytest.fixture(scope="module")
def spots() -> np.ndarray:
    """Round marks on 6 % of the lens, from 0 to 1."""
    rng, spots = np.random.default_rng(1), np.zeros((288, 320), np.float32)
    while spots.mean() < 0.06:
        cv2.circle(spots, (int(rng.integers(0, 320)), int(rng.integers(0, 288))), int(rng.integers(2, 7)), 1.0, -1)
    return spots


def view(stones, spots, shift) -> np.ndarray:
    """Return a picture of stones that have moved along u, behind the marks."""
    noise = np.random.default_rng(1000 + shift).normal(0.0, 3.0, spots.shape)
    ground = stones.texture[100:388, 100 - shift : 420 - shift] + noise
    return np.asarray(np.clip(np.rint(ground * (1 - spots) + 250 * spots), 0, 255), np.uint8)


def found(motion: ImageMotion, information=SURE) -> TrackedMotion:
    return TrackedMotion(0.0, motion, information, {})


def vote_on(before, now) -> ShiftVote:
    height, width = before.shape
    witness = ShiftWitness((width, height))
    return witness.compare(witness.spectrum(before), witness.spectrum(now))


def search(before) -> RivalSearch:
    height, width = before.shape
    return RivalSearch(MotionAudit((width, height), 1.0))


@pytest.mark.parametrize("shift", [3, SHIFT, -40])
def test_the_ground_wins_against_marks_that_stand_still(stones, spots, shift):
    before, now = view(stones, spots, 0), view(stones, spots, shift)

    rival = search(before).better(smooth(before), smooth(now), found(STILL), vote_on(before, now))

    assert rival is not None
    assert (rival.u, rival.v) == pytest.approx((shift, 0.0), abs=1.0)
    assert abs(rival.turn_rad) < math.radians(0.3)


@pytest.mark.parametrize("shift", [0, 3, SHIFT, -40])
def test_the_right_motion_has_no_rival_at_rest_or_on_the_move(stones, spots, shift):
    before, now = view(stones, spots, 0), view(stones, spots, shift) if shift else view(stones, spots, 0)
    right = found(ImageMotion(float(shift), 0.0, 0.0))

    assert search(before).better(smooth(before), smooth(now), right, vote_on(before, now)) is None


def test_a_motion_that_does_not_claim_to_know_is_not_contradicted(stones, spots):
    before, now = view(stones, spots, 0), view(stones, spots, SHIFT)

    unsure = found(STILL, UNSURE)

    assert search(before).better(smooth(before), smooth(now), unsure, vote_on(before, now)) is None


def test_the_last_rival_is_tried_again_without_a_second_opinion(stones, spots):
    before, now, later = (view(stones, spots, shift) for shift in (0, -45, -90))
    rivals = search(before)
    first = rivals.better(smooth(before), smooth(now), found(STILL), vote_on(before, now))
    # the best of the starts is gone on from: without the last one the descent does not come so far
    again = rivals.better(smooth(now), smooth(later), found(STILL), None)

    assert first is not None
    assert again is not None
    assert again.u == pytest.approx(-45.0, abs=1.0)


def test_the_descent_goes_down_to_a_pixel_along_all_axes():
    lowest = ImageMotion(17.0, -6.0, math.radians(1.5))

    def spread_of(motion):
        apart = motion.array() - lowest.array()
        return float(np.abs(apart[:2]).sum() + 100.0 * abs(apart[2]))

    motion, least = least_spread(spread_of, [ImageMotion(90.0, 90.0, 0.0), STILL])

    assert motion.array()[:2] == pytest.approx(lowest.array()[:2], abs=1.0)
    assert motion.turn_rad == pytest.approx(lowest.turn_rad, abs=math.radians(0.12))
    assert least == spread_of(motion)


def test_marks_that_hold_the_search_are_never_believed_silently(camera, stones, spots):
    def way(stamp_s):
        return Pose2(0.5 * ACCELERATION_MPS2 * stamp_s**2, 0.0, 0.0)

    run = ground_run(way, 70, ground=stones, camera=camera)
    localizer = GroundVO(GroundVOConfig(camera="floor", n_pixels=384))
    localizer.start(Session(name="vo", sensors={"floor": run.sensor}))

    said, n_wrong = [], 0
    for frame in run.frames:
        pixels = np.asarray(frame.payload.pixels * (1 - spots) + 250 * spots, np.uint8)
        said += localizer.observe(type(frame)("floor", frame.stamp_s, Image(pixels)), Belief(frame.stamp_s))
    motions = [estimate for estimate in said if isinstance(estimate, Motion)]
    for motion in motions:
        true = way(motion.since_s).between(way(motion.stamp_s))
        error = motion.pose_since_now.distance_to(true)
        covariance = np.linalg.inv(motion.information)
        n_wrong += error > max(5e-4, 5.0 * math.sqrt(covariance[0, 0] + covariance[1, 1]))

    assert n_wrong == 0
    # the marks are learned, and once what is known of them stands no more, the ground is followed again
    assert len(motions) >= 40
    assert any("does not move as its marks do" in lost.reason for lost in said if isinstance(lost, Lost))
