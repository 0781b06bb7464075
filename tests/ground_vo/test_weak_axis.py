"""Ground with a grain: what stands still along it holds no motion, and what is not known is not claimed."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.filters import smooth
from trailmark_ground_vo.guarded_refinement import GuardedRefinement
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.weak_axis import WeakAxis, mean_square_within

SIZE = (320, 288)
STILL = ImageMotion(0.0, 0.0, 0.0)
SURE = np.diag([1e4, 1e4, 1e8])


@pytest.fixture(scope="module")
def grained() -> np.ndarray:
    """Streaks along u, that change over 60 px of their length and over 1.5 px of their width."""
    noise = np.random.default_rng(5).standard_normal((288, 800), dtype=np.float32)
    streaks = cv2.GaussianBlur(noise, (0, 0), sigmaX=60.0, sigmaY=1.5)
    return np.asarray(128.0 + 12.0 * streaks / streaks.std(), np.float32)


@pytest.fixture(scope="module")
def isotropic() -> np.ndarray:
    noise = cv2.GaussianBlur(np.random.default_rng(6).standard_normal((288, 800), dtype=np.float32), (0, 0), 1.5)
    return np.asarray(128.0 + 12.0 * noise / noise.std(), np.float32)


@pytest.fixture(scope="module")
def marks() -> np.ndarray:
    """Places on the lens, (H, W) bool, 16 % of the picture."""
    where, rng = np.zeros((SIZE[1], SIZE[0]), np.uint8), np.random.default_rng(7)
    for u, v in zip(rng.integers(0, SIZE[0], 60), rng.integers(0, SIZE[1], 60)):
        cv2.circle(where, (int(u), int(v)), 9, 1, -1)
    return where.astype(bool)


def view(floor, shift_px, faded=None, noise=1.0, seed=0) -> np.ndarray:
    """Return a smoothed picture of content that has moved along u; what is `faded` is neutral."""
    seen = floor[:, 200 - shift_px : 200 - shift_px + SIZE[0]]
    seen = seen + noise * np.random.default_rng([seed, shift_px]).standard_normal(seen.shape)
    picture = np.clip(np.rint(seen), 0, 255).astype(np.uint8)
    return smooth(picture if faded is None else np.where(faded, np.uint8(128), picture))


def around(marks) -> np.ndarray:
    """Return the marks and what smoothing mixes with them."""
    return cv2.dilate(marks.astype(np.uint8), np.ones((7, 7), np.uint8)).astype(bool)


def sigmas(information) -> np.ndarray:
    return np.sqrt(np.diag(np.linalg.inv(information)))


def test_along_a_grain_a_motion_is_as_wide_as_what_fits(grained):
    # the content has moved by 3 px along its grain, and marks say that it stands still
    claimed = WeakAxis(SIZE, 1.0).widened(view(grained, 0), view(grained, 3), STILL, np.diag([9e3, 1e4, 1e8]))

    assert sigmas(claimed)[0] > 3.0 / 5.0
    np.testing.assert_allclose(sigmas(claimed)[1:], [0.01, 1e-4], rtol=0.01)  # across it nothing changes


def test_where_one_motion_fits_what_it_claims_stays(isotropic):
    claimed = WeakAxis(SIZE, 1.0).widened(view(isotropic, 0), view(isotropic, 3), ImageMotion(3.0, 0.0, 0.0), SURE)

    np.testing.assert_array_equal(claimed, SURE)


def test_places_fixed_to_the_lens_are_not_compared(grained, marks):
    before, now = view(grained, 0, marks), view(grained, 12, marks)
    seeing, closed = WeakAxis(SIZE, 1.0), WeakAxis(SIZE, 1.0)
    closed.ignore(around(marks))

    wide, wider = (sigmas(axis.widened(before, now, STILL, np.diag([9e3, 1e4, 1e8])))[0] for axis in (seeing, closed))

    assert wider > 12.0 / 5.0
    assert wider > wide


def test_a_picture_with_nothing_in_common_says_nothing_more(isotropic):
    claimed = WeakAxis(SIZE, 1.0).widened(view(isotropic, 0), view(isotropic, 9), ImageMotion(400.0, 0.0, 0.0), SURE)

    np.testing.assert_array_equal(claimed, SURE)


@pytest.mark.parametrize(("below", "above", "expected"), [(0, 0, 0), (3, 3, 3), (0, 3, 3), (1, 2, 1)])
def test_the_mean_square_of_an_interval(below, above, expected):
    assert mean_square_within(below, above) == pytest.approx(expected)


def test_the_ends_of_streaks_at_a_faded_mark_hold_no_motion(grained, marks):
    shift = 4
    before, now = view(grained, 0, marks, seed=1), view(grained, shift, marks, seed=1)
    refinement = GuardedRefinement(GroundVOConfig(camera="floor", max_iterations=40), SIZE, 1.0)
    refinement.begin(before)
    refinement.ignore(around(marks))

    moved = refinement.align(now, [STILL, ImageMotion(float(shift), 0.0, 0.0)]).motion

    assert moved.u == pytest.approx(shift, abs=0.7)
    assert moved.v == pytest.approx(0.0, abs=0.05)


def test_where_nothing_is_open_all_pixels_have_a_say(isotropic):
    refinement = GuardedRefinement(GroundVOConfig(camera="floor", max_iterations=40), SIZE, 1.0)
    refinement.begin(view(isotropic, 0))
    refinement.ignore(np.ones((SIZE[1], SIZE[0]), np.bool_))

    aligned = refinement.align(view(isotropic, 3), [STILL, ImageMotion(3.0, 0.0, 0.0)])

    assert aligned.motion.u == pytest.approx(3.0, abs=0.05)
    assert aligned.fitting > 0.95


def test_a_pixel_that_passes_a_mark_keeps_its_look(isotropic, marks):
    config = GroundVOConfig(camera="floor", max_iterations=40)
    refinement = GuardedRefinement(config, SIZE, 1.0)
    refinement.begin(view(isotropic, 0, marks))
    refinement.ignore(around(marks))
    way = 0.0
    for n in range(1, 9):
        picture = view(isotropic, 5 * n, marks)
        aligned = refinement.align(picture, [ImageMotion(5.0, 0.0, 0.0)])
        refinement.follow(picture, aligned)
        way += aligned.motion.u
        assert aligned.fitting > 0.95

    assert way == pytest.approx(40.0, abs=0.1)
