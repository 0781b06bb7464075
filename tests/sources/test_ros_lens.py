"""The lens of a CameraInfo message."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from trailmark.frames import Pinhole
from trailmark.sources.ros_messages import lens


def info(**fields) -> SimpleNamespace:
    k = [60.0, 0.0, 31.5, 0.0, 61.0, 23.5, 0.0, 0.0, 1.0]
    p = [50.0, 0.0, 30.5, 0.0, 0.0, 51.0, 22.5, 0.0, 0.0, 0.0, 1.0, 0.0]
    known = {"k": k, "p": p, "d": [0.1, 0.0, 0.0, 0.0, 0.0], "distortion_model": "plumb_bob"}
    return SimpleNamespace(**(known | fields))


RECTIFIED = Pinhole(50.0, 51.0, 30.5, 22.5)


@pytest.mark.parametrize(
    "unused",
    [
        {"d": [math.nan] * 5},
        {"d": [math.inf] * 4, "distortion_model": "equidistant"},
        {"k": [math.nan] * 9},
        {"p": [50.0, 0.0, 30.5, math.nan, 0.0, 51.0, 22.5, 0.0, 0.0, 0.0, 1.0, 0.0]},  # the baseline of a stereo rig
    ],
)
def test_a_rectified_picture_keeps_its_lens_whatever_the_numbers_say_that_are_not_used(unused) -> None:
    assert lens(info(**unused), is_rectified=True) == RECTIFIED


@pytest.mark.parametrize("place", [0, 2, 5, 6])
@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_a_rectified_picture_without_a_number_that_is_used_has_no_lens(place: int, number: float) -> None:
    p = info().p
    p[place] = number

    assert lens(info(p=p), is_rectified=True) is None


@pytest.mark.parametrize("field", ["k", "d"])
def test_a_raw_picture_without_a_number_that_is_used_has_no_lens(field: str) -> None:
    numbers = list(getattr(info(), field))
    numbers[2] = math.nan

    assert lens(info(**{field: numbers}), is_rectified=False) is None


def test_a_raw_picture_does_not_use_the_matrix_of_the_rectified() -> None:
    expected = Pinhole(60.0, 61.0, 31.5, 23.5, (0.1, 0.0, 0.0, 0.0, 0.0))

    assert lens(info(p=[math.nan] * 12), is_rectified=False) == expected
