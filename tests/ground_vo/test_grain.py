"""Along a grain: what the ground holds there stays as it is, and what it does not hold is not claimed."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from trailmark_ground_vo.filters import smooth
from trailmark_ground_vo.grain import AlongGrain, Grain
from trailmark_ground_vo.motion import ImageMotion

SIZE = (320, 288)
SURE = np.diag([1e4, 1e4, 1e8])


def floor_of(*, pores: float, seed: int = 5) -> np.ndarray:
    """Return streaks along u, 120 px long, and pores of so many grey levels between them."""
    rng = np.random.default_rng(seed)
    out = np.full((400, 900), 115.0, np.float32)
    for along, across, sigma in ((120.0, 1.0, 8.0), (2.0, 2.0, pores)):
        noise = cv2.GaussianBlur(rng.standard_normal(out.shape, dtype=np.float32), (0, 0), sigmaX=along, sigmaY=across)
        out += sigma * noise / noise.std()
    return out


def view(floor: np.ndarray, motion: ImageMotion, *, noise: float = 2.0, seed: int = 0) -> np.ndarray:
    """Return a smoothed picture of a floor whose content has moved so from its middle."""
    cos, sin = math.cos(motion.turn_rad), math.sin(motion.turn_rad)
    turn = np.array([[cos, sin], [-sin, cos]])
    middle, centre = (np.array([(n - 1) / 2.0 for n in size]) for size in (floor.shape[::-1], SIZE))
    to = np.column_stack([turn, centre + motion.array()[:2] - turn @ middle])
    seen = cv2.warpAffine(floor, to, SIZE, flags=cv2.INTER_CUBIC)
    seen = seen + noise * np.random.default_rng([seed, 9]).standard_normal(seen.shape)
    return smooth(np.clip(np.rint(seen), 0, 255).astype(np.uint8))


def compared(floor: np.ndarray, true: ImageMotion, found: ImageMotion) -> Grain | None:
    before, now = view(floor, ImageMotion(0.0, 0.0, 0.0)), view(floor, true, seed=1)
    return AlongGrain(SIZE, 1.0).compare(before, now, found)


def sigmas(information: np.ndarray) -> np.ndarray:
    return np.sqrt(np.diag(np.linalg.inv(information)))


MOVED = ImageMotion(14.0, 1.0, math.radians(1.0))


def test_pores_hold_a_motion_along_the_grain():
    grain = compared(floor_of(pores=4.0), MOVED, MOVED)

    assert grain is not None
    assert grain.variance == 0.0
    assert grain.rival is None
    np.testing.assert_array_equal(grain.widened(SURE), SURE)


@pytest.mark.parametrize("along_px", [-22.0, -9.0, 9.0, 22.0])
def test_of_two_places_the_one_with_the_same_pores_is_the_rival(along_px):
    wrong = ImageMotion(MOVED.u + along_px, MOVED.v, MOVED.turn_rad)

    grain = compared(floor_of(pores=4.0), MOVED, wrong)

    assert grain is not None
    assert grain.rival is not None
    assert grain.rival.u == pytest.approx(MOVED.u, abs=2.5)
    assert grain.rival.v == pytest.approx(MOVED.v, abs=1.0)


@pytest.mark.parametrize("along_px", [0.0, 18.0])
def test_streaks_alone_hold_nothing_and_the_covariance_says_so(along_px):
    found = ImageMotion(MOVED.u + along_px, MOVED.v, MOVED.turn_rad)

    grain = compared(floor_of(pores=0.0), MOVED, found)

    assert grain is not None
    assert grain.rival is None
    wide = sigmas(grain.widened(SURE))
    assert wide[0] == pytest.approx(40.0 / math.sqrt(3.0), rel=0.01)
    assert wide[1] < 2.0  # the grain lies along u, but for how well its direction is measured
    assert wide[2] == pytest.approx(1e-4, rel=0.01)


def test_the_covariance_is_wide_along_a_grain_that_lies_across_the_picture():
    floor = cv2.rotate(np.pad(floor_of(pores=0.0), ((250, 250), (0, 0)), mode="reflect"), cv2.ROTATE_90_CLOCKWISE)
    down = ImageMotion(1.0, 14.0, 0.0)

    grain = compared(floor, down, down)

    assert grain is not None
    wide = sigmas(grain.widened(SURE))
    assert wide[1] > 10.0 > 2.0 > wide[0]


def test_ground_without_a_grain_is_not_asked():
    noise = cv2.GaussianBlur(np.random.default_rng(6).standard_normal((400, 900), dtype=np.float32), (0, 0), 1.5)
    floor = np.asarray(115.0 + 10.0 * noise / noise.std(), np.float32)

    assert compared(floor, MOVED, MOVED) is None


def test_marks_on_the_lens_that_are_known_have_no_say():
    # streaks without pores, and marks that stand still: they would hold a motion that stands still
    rng, floor = np.random.default_rng(7), floor_of(pores=0.0)
    marks = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    for u, v in zip(rng.integers(0, SIZE[0], 150), rng.integers(0, SIZE[1], 150)):
        cv2.circle(marks, (int(u), int(v)), 3, 1, -1)
    still = ImageMotion(0.0, 0.0, 0.0)
    before, now = view(floor, still), view(floor, ImageMotion(14.0, 0.0, 0.0), seed=1)
    before, now = (np.where(marks, np.uint16(40 * 256), seen) for seen in (before, now))
    seeing, knowing = AlongGrain(SIZE, 1.0), AlongGrain(SIZE, 1.0)
    knowing.ignore(cv2.dilate(marks, np.ones((5, 5), np.uint8)).astype(bool))

    misled, told = (watch.compare(before, now, still) for watch in (seeing, knowing))

    assert misled is None or misled.variance == 0.0
    assert told is not None
    assert told.variance > 100.0


def test_pictures_that_share_nothing_hold_nothing():
    grain = compared(floor_of(pores=4.0), MOVED, ImageMotion(500.0, 0.0, 0.0))

    assert grain is None or grain.variance > 100.0
