"""Following, recognising, and the neighbourhood as identity."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from trailmark_kinect_landmarks.refinding import (
    consistent,
    follow,
    match_anywhere,
    match_near,
    resemblance,
    resemblance_where,
)


def _texture() -> np.ndarray:
    noise = np.random.default_rng(5).integers(0, 256, (60, 80), np.uint8)
    return cv2.resize(noise, (320, 240), interpolation=cv2.INTER_CUBIC)


def test_pixels_are_followed_to_where_the_picture_went() -> None:
    before = _texture()
    now = cv2.warpAffine(before, np.array([[1.0, 0.0, 5.5], [0.0, 1.0, -3.0]]), (320, 240))
    uv = np.array([[100.0, 100.0], [200.0, 150.0]])

    found, good = follow(before, now, uv)

    assert good.all()
    np.testing.assert_allclose(found, uv + np.array([5.5, -3.0]), atol=0.2)


def test_a_pixel_that_left_the_picture_is_not_followed() -> None:
    before = _texture()
    now = cv2.warpAffine(before, np.array([[1.0, 0.0, 40.0], [0.0, 1.0, 0.0]]), (320, 240))

    assert not follow(before, now, np.array([[300.0, 100.0]]))[1].any()


def test_nothing_to_follow_is_nothing_found() -> None:
    uv, good = follow(_texture(), _texture(), np.empty((0, 2)))

    assert uv.shape == (0, 2)
    assert good.shape == (0,)


def test_in_the_dark_only_the_vicinity_counts() -> None:
    histograms, vicinity = np.array([[1.0, 0.0]], np.float32), np.array([[0.6, 0.8]], np.float32)

    assert resemblance(histograms, vicinity, histograms[:, ::-1], vicinity, by_colour=True)[0, 0] == pytest.approx(0.5)
    assert resemblance(histograms, vicinity, histograms[:, ::-1], vicinity, by_colour=False)[0, 0] == pytest.approx(1.0)


def test_a_landmark_is_recognised_near_where_it_should_be_and_nowhere_else() -> None:
    alike = np.array([[0.9, 0.95], [0.2, 0.9]], np.float32)
    uv, expected = np.array([[10.0, 10.0], [200.0, 200.0]]), np.array([[15.0, 12.0], [205.0, 199.0]])
    size = np.ones(2)

    pairs = match_near(alike, uv, expected, 20.0, size, size, 0.75)

    assert pairs.tolist() == [[0, 0], [1, 1]]


@pytest.mark.parametrize(("size", "least"), [(np.array([1.0, 9.0]), 0.5), (np.ones(2), 0.99)])
def test_another_size_or_another_look_is_another_landmark(size: np.ndarray, least: float) -> None:
    uv = np.array([[10.0, 10.0]])

    pairs = match_near(np.array([[0.2, 0.9]], np.float32), uv, np.repeat(uv, 2, 0), 20.0, np.ones(1), size, least)

    assert pairs.shape == (0, 2)


def test_two_may_not_be_one_landmark() -> None:
    alike = np.array([[0.9], [0.8]], np.float32)
    uv = np.zeros((2, 2))

    assert match_near(alike, uv, np.zeros((1, 2)), 5.0, np.ones(2), np.ones(1), 0.5).tolist() == [[0, 0]]


def test_the_neighbourhood_tells_alike_landmarks_apart() -> None:
    rng = np.random.default_rng(7)
    remembered = rng.uniform(-2.0, 2.0, (12, 3)) + np.array([4.0, 0.0, 0.0])
    turn = cv2.Rodrigues(np.array([0.0, 0.1, 0.3]))[0]
    seen = (remembered[:6] - (0.3, -0.2, 0.1)) @ turn
    alike = np.full((6, 12), 0.8, np.float32)  # all look the same
    pairs = match_anywhere(alike, np.ones(6), np.ones(12), 0.75, n_each=12)

    found = consistent(pairs, seen, remembered, tolerance=1e-3)

    assert found.tolist() == [[i, i] for i in range(6)]


def test_nothing_remembered_is_nothing_recognised() -> None:
    empty = np.empty((3, 0), np.float32)

    assert match_anywhere(empty, np.ones(3), np.empty(0), 0.5).shape == (0, 2)
    assert consistent(np.empty((0, 2), np.intp), np.empty((0, 3)), np.empty((0, 3))).shape == (0, 2)


@pytest.mark.parametrize("by_colour", [True, False])
def test_possible_pairs_resemble_one_another_as_all_pairs_do(by_colour: bool) -> None:
    rng = np.random.default_rng(7)
    looks = [rng.random((n, 5)).astype(np.float32) for n in (4, 4, 6, 6)]
    possible = rng.random((4, 6)) < 0.5

    alike = resemblance_where(possible, *looks, by_colour)

    np.testing.assert_allclose(alike[possible], resemblance(*looks, by_colour)[possible], rtol=1e-5)
    assert (alike[~possible] == -1.0).all()
