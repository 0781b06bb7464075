"""Compensation of the light, and histograms as identity."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from trailmark_kinect_landmarks.colour import (
    Light,
    colour_index,
    compensate,
    histograms,
    picture_light,
    similarity,
)


def _patches() -> np.ndarray:
    bgr = np.full((60, 120, 3), 128, np.uint8)
    bgr[10:50, 10:50] = (30, 40, 200)
    bgr[10:50, 70:110] = (200, 60, 30)
    return bgr


def _histograms(bgr: np.ndarray) -> np.ndarray:
    index = colour_index(cv2.cvtColor(bgr, cv2.COLOR_BGR2HSV))
    return histograms(index, np.array([[30.0, 30.0], [90.0, 30.0]]), 10)


def test_a_landmark_resembles_itself_and_not_the_other() -> None:
    found = _histograms(_patches())

    resemblance = similarity(found, found)

    np.testing.assert_allclose(np.diag(resemblance), 1.0, atol=1e-6)
    assert resemblance[0, 1] < 0.1


def test_a_fifth_of_the_light_is_made_up_for() -> None:
    dark = (_patches() * 0.2).astype(np.uint8)

    found = _histograms(compensate(dark, gain=5.0))

    assert np.diag(similarity(found, _histograms(_patches()))).min() > 0.95


def test_about_the_same_light_changes_no_pixel() -> None:
    bgr = _patches()

    assert compensate(bgr, gain=1.05) is bgr


def test_no_light_does_not_divide_by_zero() -> None:
    assert compensate(_patches(), Light(0.0, 0.0).gain_to(Light(0.5, 300.0))).max() == 255


@pytest.mark.parametrize(
    ("picture", "measured", "gain"),
    [
        (0.5 * 0.2, 60.0, 5.0),  # grey levels as the light
        (0.5 * 0.2**0.5, 60.0, 0.2**-0.5),  # grey levels as the root of the light
        (0.5, 60.0, 1.0),  # the camera exposes by itself
        (0.3, 300.0, 1.0),  # a darker view in the same light
        (0.3, None, 0.5 / 0.3),  # no sensor: the picture is all there is
    ],
)
def test_sensor_and_picture_tell_how_to_compensate(picture: float, measured: float | None, gain: float) -> None:
    now, reference = Light(picture, measured), Light(0.5, 300.0 if measured else None)

    assert now.gain_to(reference) == pytest.approx(gain)
    assert now.share_of(reference) == pytest.approx(measured / 300.0 if measured else picture / 0.5)


def test_the_picture_tells_its_own_light() -> None:
    assert picture_light(np.full((64, 64), 51, np.uint8)) == 0.2


def test_a_histogram_at_the_border_is_whole() -> None:
    index = np.zeros((20, 20), np.uint8)

    found = histograms(index, np.array([[0.0, 0.0], [19.0, 19.0], [25.0, -3.0]]), 5)

    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-6)
