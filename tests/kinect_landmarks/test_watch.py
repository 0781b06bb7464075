"""What a user is told of depth that cannot be right."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from trailmark_kinect_landmarks.watch import DepthWatch, complaint_about_depths, complaint_about_way

GREY = np.zeros((48, 64), np.uint8)


@pytest.mark.parametrize("median_m", [0.5, 1.3, 3.0, 5.5])
def test_depths_of_a_room_are_not_complained_about(median_m: float) -> None:
    assert complaint_about_depths([median_m] * 10) is None


@pytest.mark.parametrize("median_m", [1.3 * 5.0, 1.3 * 1000.0, 1.3 / 5.0, 1.3 / 1000.0])
def test_a_wrong_depth_factor_is_named(median_m: float) -> None:
    complaint = complaint_about_depths([median_m] * 10)

    assert complaint is not None
    assert "depth_factor" in complaint


def test_no_depth_at_all_is_said() -> None:
    assert "no depth" in str(complaint_about_depths([np.nan] * 3))


def test_the_user_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    watch = DepthWatch("landmarks", "kinect")

    with caplog.at_level(logging.WARNING):
        for i in range(100):
            watch.look(0.1 * i, GREY, np.full((48, 64), 6500.0, np.float32), None)

    assert len(caplog.records) == 1
    assert "landmarks: half of all depths are beyond 6.5e+03 m" in caplog.text


def test_a_way_against_that_of_the_wheels_is_said_once(caplog: pytest.LogCaptureFixture) -> None:
    watch = DepthWatch("landmarks", "kinect")

    with caplog.at_level(logging.WARNING):
        for i in range(100):
            watch.compare_ways((0.05 * i, 0.0), (0.01 * i, 0.0))

    assert len(caplog.records) == 1
    assert "5 times" in caplog.text


def test_a_way_alone_is_not_compared(caplog: pytest.LogCaptureFixture) -> None:
    watch = DepthWatch("landmarks", "kinect")

    with caplog.at_level(logging.WARNING):
        for i in range(100):
            watch.compare_ways((0.05 * i, 0.0), (0.0, 0.0))

    assert not caplog.records


@pytest.mark.parametrize(("own_m", "says"), [(1.0, False), (1.8, False), (5.0, True), (0.2, True), (1000.0, True)])
def test_a_factor_of_five_is_told_from_slip(own_m: float, says: bool) -> None:
    assert (complaint_about_way(own_m, 1.0) is not None) == says
