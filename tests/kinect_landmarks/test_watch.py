"""What a user is told of depth that cannot be right."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from trailmark_kinect_landmarks.watch import DepthWatch, complaint_about_depths, complaint_about_way

#: What a twentieth, half and all but a twentieth of the depths are nearer than: a desk by hand, two simulated rooms,
#: the wall that a robot stands before, a hall.
ROOMS_M = [(0.8, 1.3, 3.3), (1.6, 4.3, 6.3), (1.6, 3.1, 6.0), (0.5, 0.6, 0.8), (1.0, 5.5, 9.0)]


@pytest.mark.parametrize("depths_m", ROOMS_M)
def test_depths_of_a_room_are_not_complained_about(depths_m: tuple[float, float, float]) -> None:
    assert complaint_about_depths([depths_m] * 10) is None


@pytest.mark.parametrize("factor", [5.0, 1000.0, 1.0 / 5.0, 1.0 / 1000.0])
@pytest.mark.parametrize("depths_m", ROOMS_M[:3])
def test_a_wrong_depth_factor_is_named(depths_m: tuple[float, float, float], factor: float) -> None:
    near_m, median_m, far_m = (depth_m * factor for depth_m in depths_m)

    complaint = complaint_about_depths([(near_m, median_m, far_m)] * 10)

    assert complaint is not None
    assert ("implausibly far" if factor > 1.0 else "implausibly near") in complaint
    assert "depth_factor" in complaint


def test_no_depth_at_all_is_said() -> None:
    assert "no depth" in str(complaint_about_depths([(np.nan, np.nan, np.nan)] * 3))


def test_the_user_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    watch = DepthWatch("landmarks", "kinect")

    with caplog.at_level(logging.WARNING):
        for _ in range(100):
            watch.look_at_depths(np.full((48, 64), 6500.0, np.float32))

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
