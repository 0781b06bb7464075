"""Each finder finds what it is for, and nothing in an empty picture."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from trailmark_kinect_landmarks.finders import FINDERS, Region, Regions, WorkingImage, find

WALL_M = np.full((480, 640), 2.0, np.float32)


def _canvas() -> np.ndarray:
    return np.full((480, 640, 3), 150, np.uint8)


def _near(regions: Regions, u: float, v: float, tolerance_px: float = 3.0) -> list[Region]:
    return [region for region in regions if np.hypot(region.centre[0] - u, region.centre[1] - v) <= tolerance_px]


@pytest.mark.parametrize("name", FINDERS)
def test_nothing_is_found_in_an_empty_picture(name: str) -> None:
    assert len(find(WorkingImage(_canvas(), np.full((480, 640), np.nan, np.float32)), [name])) == 0


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_colour_blob_is_found_at_the_centre_of_its_frame(scale: float) -> None:
    bgr = _canvas()
    cv2.circle(bgr, (200, 150), 20, (30, 30, 220), -1)

    (found,) = _near(find(WorkingImage(bgr, WALL_M, scale), ["blobs"]), 200, 150)

    assert found.kind == "blob"
    assert found.width == pytest.approx(41, abs=6)


def test_touching_colours_are_two_blobs() -> None:
    bgr = _canvas()
    bgr[100:140, 100:140], bgr[100:140, 140:180] = (30, 30, 220), (220, 60, 30)

    found = find(WorkingImage(bgr, WALL_M), ["blobs"])

    assert _near(found, 119.5, 119.5)
    assert _near(found, 159.5, 119.5)


def test_a_rectangle_is_found_and_a_triangle_is_none() -> None:
    bgr = _canvas()
    cv2.rectangle(bgr, (100, 100), (180, 160), (20, 20, 20), -1)
    cv2.fillPoly(bgr, [np.array([[400, 100], [480, 200], [330, 220]], np.int32)], (20, 20, 20))

    found = find(WorkingImage(bgr, WALL_M), ["rectangles"])

    assert _near(found, 140, 130)
    assert not _near(found, 405, 160, 60.0)


def test_the_corners_of_a_door_are_edges() -> None:
    bgr = _canvas()
    cv2.rectangle(bgr, (200, 100), (320, 400), (60, 60, 60), -1)

    found = find(WorkingImage(bgr, WALL_M), ["edges"])

    for u, v in ((200, 100), (320, 100), (320, 400), (200, 400)):
        assert _near(found, u, v, 5.0)


@pytest.mark.parametrize(("axes", "kind"), [((40, 40), "circle"), ((60, 30), "ellipse")])
def test_a_round_contour_is_named_by_its_axes(axes: tuple[int, int], kind: str) -> None:
    bgr = _canvas()
    cv2.ellipse(bgr, (300, 200), axes, 20, 0, 360, (30, 30, 30), -1)

    found = _near(find(WorkingImage(bgr, WALL_M), ["ellipses"]), 300, 200)

    assert {region.kind for region in found} == {kind}


def test_a_square_is_no_ellipse() -> None:
    bgr = _canvas()
    cv2.rectangle(bgr, (260, 160), (340, 240), (30, 30, 30), -1)

    assert len(find(WorkingImage(bgr, WALL_M), ["ellipses"])) == 0


def test_hough_s_circles_find_a_circle() -> None:
    bgr = _canvas()
    cv2.circle(bgr, (300, 200), 50, (20, 20, 20), -1)

    assert _near(find(WorkingImage(bgr, WALL_M), ["hough_circles"]), 300, 200, 5.0)


def test_the_ends_of_a_line_are_found() -> None:
    bgr = _canvas()
    cv2.line(bgr, (100, 300), (400, 340), (0, 0, 0), 3)

    found = find(WorkingImage(bgr, WALL_M), ["lines"])

    assert _near(found, 100, 300, 12.0)
    assert _near(found, 400, 340, 12.0)


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_box_before_a_wall_is_flat(scale: float) -> None:
    depth_m = np.full((480, 640), 3.0, np.float32)
    depth_m[160:320, 240:400] = 1.5

    found = find(WorkingImage(_canvas(), depth_m, scale), ["flats"])

    assert _near(found, 319.5, 239.5, 12.0)


def test_a_stable_area_is_found_without_colour() -> None:
    bgr = _canvas()
    cv2.rectangle(bgr, (300, 200), (330, 225), (40, 40, 40), -1)
    bgr = cv2.GaussianBlur(bgr, (31, 31), 0)

    assert _near(find(WorkingImage(bgr, WALL_M), ["mser"]), 315, 212.5)


def test_finders_keep_the_order_they_are_named_in() -> None:
    bgr = _canvas()
    cv2.rectangle(bgr, (100, 100), (180, 160), (20, 20, 20), -1)
    view = WorkingImage(bgr, WALL_M)

    kinds = find(view, ["edges", "blobs"]).kinds

    assert kinds == sorted(kinds, reverse=True)
    assert set(kinds) == {"edge", "blob"}
