"""Whether depth lies on colour: edges of both are compared."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from trailmark.arrays import Depth, Grey8
from trailmark_kinect_landmarks.registration import Registration, RegistrationCheck, find_registration

SIZE = (640, 480)
BESIDE = Registration(scale=0.9, right_px=-4.0, down_px=1.0)


def boxes(seed: int = 3) -> tuple[Grey8, Depth]:
    """Return a picture of boxes before a wall, and depth that lies on it."""
    rng = np.random.default_rng(seed)
    grey, depth_m = np.full(SIZE[::-1], 120, np.uint8), np.full(SIZE[::-1], 4.0, np.float32)
    for _ in range(12):
        u, v, w, h = (int(n) for n in rng.integers((0, 0, 40, 60), (600, 440, 140, 200)))
        cv2.rectangle(grey, (u, v), (u + w, v + h), int(rng.integers(0, 255)), -1)
        cv2.rectangle(depth_m, (u, v), (u + w, v + h), float(rng.uniform(1.2, 2.5)), -1)
    return np.clip(grey + rng.normal(0.0, 2.0, grey.shape), 0, 255).astype(np.uint8), depth_m


def not_registered(depth_m: Depth) -> Depth:
    """Return what needs `BESIDE` to lie on its colour picture."""
    scale = 1.0 / BESIDE.scale
    return Registration(scale, -BESIDE.right_px * scale, -BESIDE.down_px * scale).apply(depth_m)


def test_depth_that_lies_on_colour_is_left_where_it_is() -> None:
    found = find_registration(*boxes())

    assert found is not None
    assert found.offset_px(Registration(), SIZE) < 2.0


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_depth_camera_of_another_lens_is_found(seed: int) -> None:
    grey, depth_m = boxes(seed)

    found = find_registration(grey, not_registered(depth_m))

    assert found is not None
    assert found.offset_px(BESIDE, SIZE) < 3.0


def test_a_registration_is_undone_by_its_inverse() -> None:
    _, depth_m = boxes()

    again = BESIDE.apply(not_registered(depth_m))

    known = np.isfinite(again)
    assert known.mean() > 0.75  # beyond the borders nothing was seen
    assert (again[known] == depth_m[known]).mean() > 0.97  # but for the outlines


@pytest.mark.parametrize("depth_m", [np.full((480, 640), 2.0, np.float32), np.full((480, 640), np.nan, np.float32)])
def test_without_outlines_nothing_is_said(depth_m: Depth) -> None:
    assert find_registration(boxes()[0], depth_m) is None


def test_outlines_without_edges_in_colour_say_nothing() -> None:
    noise = np.random.default_rng(0).integers(100, 110, (480, 640)).astype(np.uint8)

    assert find_registration(noise, boxes()[1]) is None


def test_three_pictures_that_agree_decide() -> None:
    grey, depth_m = boxes()
    check = RegistrationCheck()

    news = [check.look(0.2 * i, grey, not_registered(depth_m), is_steady=True) for i in range(5)]

    assert news == [False, False, True, False, False]
    assert check.state == "measured"
    assert check.found is not None
    assert check.found.offset_px(BESIDE, SIZE) < 3.0


def test_depth_that_lies_right_is_confirmed_without_news() -> None:
    grey, depth_m = boxes()
    check = RegistrationCheck()

    assert not any(check.look(0.2 * i, grey, depth_m, is_steady=True) for i in range(5))
    assert check.state == "as given"


def test_pictures_that_disagree_or_turn_decide_nothing() -> None:
    grey, depth_m = boxes()
    turning, torn = RegistrationCheck(), RegistrationCheck()

    for i in range(9):
        turning.look(0.2 * i, grey, not_registered(depth_m), is_steady=False)
        torn.look(0.2 * i, grey, depth_m if i % 2 else not_registered(depth_m), is_steady=True)

    assert turning.state == torn.state == "unknown"
