"""Along a grain: what the ground holds there stays as it is, and what it does not hold is not claimed."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.filters import smooth
from trailmark_ground_vo.grain import AlongGrain, Grain
from trailmark_ground_vo.guarding import GroundTracker
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.tracker import TrackedMotion

SIZE = (320, 288)
SURE = np.diag([1e4, 1e4, 1e8])
STILL, MOVED = ImageMotion(0.0, 0.0, 0.0), ImageMotion(14.0, 1.0, math.radians(1.0))


def floor_of(*, pores: float, seed: int = 5) -> np.ndarray:
    """Return streaks along u, 120 px long, and pores of so many grey levels between them."""
    rng = np.random.default_rng(seed)
    out = np.full((400, 900), 115.0, np.float32)
    for along, across, sigma in ((120.0, 1.0, 8.0), (2.0, 2.0, pores)):
        noise = cv2.GaussianBlur(rng.standard_normal(out.shape, dtype=np.float32), (0, 0), sigmaX=along, sigmaY=across)
        out += sigma * noise / noise.std()
    return out


def light(floor: np.ndarray, motion: ImageMotion, *, size: tuple[int, int] = SIZE, aspect: float = 1.0) -> np.ndarray:
    """Return what is seen of a floor whose content has moved so; pixels are `aspect` as high as wide."""
    cos, sin = math.cos(motion.turn_rad), math.sin(motion.turn_rad)
    turn = np.diag([1.0, 1.0 / aspect]) @ np.array([[cos, sin], [-sin, cos]])  # texels are square
    middle, centre = (np.array([(n - 1) / 2.0 for n in of]) for of in (floor.shape[::-1], size))
    to = np.column_stack([turn, centre + motion.array()[:2] - turn @ middle])
    return np.asarray(cv2.warpAffine(floor, to, size, flags=cv2.INTER_CUBIC), np.float32)


def picture(seen: np.ndarray, *, noise: float = 2.0, seed: int = 0) -> np.ndarray:
    """Return a smoothed picture of it, (H, W) uint16."""
    noisy = seen + noise * np.random.default_rng([seed, 9]).standard_normal(seen.shape)
    return smooth(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))


def view(floor: np.ndarray, motion: ImageMotion, *, seed: int = 0) -> np.ndarray:
    return picture(light(floor, motion), seed=seed)


def compared(
    floor: np.ndarray,
    true: ImageMotion,
    found: ImageMotion,
    *,
    size: tuple[int, int] = SIZE,
    aspect: float = 1.0,
) -> Grain | None:
    before, now = (light(floor, motion, size=size, aspect=aspect) for motion in (STILL, true))
    return AlongGrain(size, aspect).compare(picture(before), picture(now, seed=1), found)


def sigmas(information: np.ndarray) -> np.ndarray:
    return np.sqrt(np.diag(np.linalg.inv(information)))


def test_pores_hold_a_motion_along_the_grain():
    grain = compared(floor_of(pores=3.0), MOVED, MOVED)

    assert grain is not None
    assert grain.variance == 0.0
    assert grain.rival is None
    np.testing.assert_array_equal(grain.widened(SURE), SURE)


@pytest.mark.parametrize("along_px", [-22.0, -9.0, 9.0, 22.0])
def test_of_two_places_the_one_with_the_same_pores_is_the_rival(along_px):
    wrong = ImageMotion(MOVED.u + along_px, MOVED.v, MOVED.turn_rad)

    grain = compared(floor_of(pores=3.0), MOVED, wrong)

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
    before, now = view(floor, STILL), view(floor, ImageMotion(14.0, 0.0, 0.0), seed=1)
    before, now = (np.where(marks, np.uint16(40 * 256), seen) for seen in (before, now))
    seeing, knowing = AlongGrain(SIZE, 1.0), AlongGrain(SIZE, 1.0)
    knowing.ignore(cv2.dilate(marks, np.ones((5, 5), np.uint8)).astype(bool))

    misled, told = (watch.compare(before, now, STILL) for watch in (seeing, knowing))

    assert misled is not None
    assert misled.variance == 0.0
    assert told is not None
    assert told.variance > 100.0


def test_floors_that_share_the_direction_of_their_grain_alone_hold_nothing():
    here, elsewhere = (floor_of(pores=3.0, seed=seed) for seed in (5, 6))
    streaks = floor_of(pores=0.0)
    before, now = (
        picture(light(streaks + here - here.mean(), STILL)),
        picture(light(streaks + elsewhere, MOVED) - 115.0),
    )

    grain = AlongGrain(SIZE, 1.0).compare(before, now, MOVED)

    assert grain is not None
    assert grain.variance > 100.0


@pytest.mark.parametrize("frame", [np.zeros((288, 320), np.uint16), np.full((288, 320), 115 * 256, np.uint16)])
def test_pictures_without_slopes_have_no_grain(frame):
    assert AlongGrain(SIZE, 1.0).compare(frame, frame, STILL) is None


def test_where_everything_is_closed_there_is_no_grain():
    watch, seen = AlongGrain(SIZE, 1.0), view(floor_of(pores=3.0), STILL)
    watch.ignore(np.ones((SIZE[1], SIZE[0]), np.bool_))

    assert watch.compare(seen, seen, STILL) is None


@pytest.mark.parametrize("off_px", [-3.5, 3.5])
def test_a_motion_beside_the_summit_spans_it(off_px):
    grain = compared(floor_of(pores=3.0), MOVED, ImageMotion(MOVED.u + off_px, MOVED.v, MOVED.turn_rad))

    assert grain is not None
    assert math.sqrt(grain.variance) == pytest.approx(abs(off_px), abs=1.0)


def test_what_passes_along_the_grain_makes_no_right_motion_lost():
    # a quarter of the rows is a thing with a look of its own that moves 20 px farther
    floor, thing = floor_of(pores=0.0), floor_of(pores=20.0, seed=8)
    before, now = light(floor, STILL), light(floor, ImageMotion(14.0, 0.0, 0.0))
    before[100:172] = light(thing, STILL)[100:172]
    now[100:172] = light(thing, ImageMotion(34.0, 0.0, 0.0))[100:172]

    grain = AlongGrain(SIZE, 1.0).compare(picture(before), picture(now, seed=1), ImageMotion(14.0, 0.0, 0.0))

    assert grain is not None
    assert grain.rival is None
    assert grain.variance > 100.0


@pytest.mark.parametrize("aspect", [0.8, 1.25])
def test_pixels_may_be_higher_than_wide(aspect):
    true = ImageMotion(14.0, 2.0, math.radians(8.0))

    grain = compared(floor_of(pores=3.0), true, true, aspect=aspect)
    of_another = AlongGrain(SIZE, 1.0 / aspect)
    before, now = (picture(light(floor_of(pores=3.0), motion, aspect=aspect)) for motion in (STILL, true))
    mistaken = of_another.compare(before, now, true)

    assert grain is not None
    assert grain.variance == 0.0
    assert mistaken is None or mistaken.variance > 100.0  # and only as high as it is


def test_small_pictures_are_compared_too():
    right, wrong = (
        compared(floor_of(pores=3.0), MOVED, ImageMotion(MOVED.u + off, MOVED.v, MOVED.turn_rad), size=(160, 120))
        for off in (0.0, 18.0)
    )

    assert right is not None
    assert right.variance == 0.0
    assert wrong is not None
    assert wrong.variance > 30.0


def test_under_a_shadows_edge_the_tracker_is_wide_along_the_grain_and_right_across_it():
    floor, rng = floor_of(pores=0.7), np.random.default_rng(3)
    u, v = np.meshgrid(*(np.arange(n, dtype=np.float32) - n / 2 for n in SIZE))
    tracker, told, step_px = GroundTracker(GroundVOConfig(camera="floor"), SIZE), [], 9.0
    for n in range(40):
        seen = light(np.roll(floor, round(step_px * n), axis=1), STILL)
        turn = 0.6 + 0.3 * math.sin(n / 23.0)
        distance = math.cos(turn) * u + math.sin(turn) * v - 80.0 * math.sin(n / 11.0)
        shaded = seen * (0.75 - 0.25 * np.tanh(distance / 4.0)) + 3.0 * rng.standard_normal(seen.shape)
        said = tracker.step(np.clip(np.rint(shaded), 0, 255).astype(np.uint8), n / 70.0)
        if isinstance(said, TrackedMotion):
            told.append((said.motion, sigmas(said.information)))

    assert len(told) > 20
    assert all(abs(motion.u - step_px) <= max(1.0, 5.0 * sigma[0]) for motion, sigma in told)
    assert np.median([abs(motion.v) for motion, _ in told]) < 0.2
