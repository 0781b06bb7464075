"""Clouds of points as their senders lay them out, and as they may not."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trailmark.errors import SourceError
from trailmark_ros2.clouds import points_of, slice_as_scan

POINTS = np.array([[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], [[7.0, 8.0, 9.0], [-1.0, -2.0, np.nan]]])


def cloud(code: str = "<f4", padding: int = 0, **changed: Any) -> SimpleNamespace:
    """Return a cloud of 2 x 2 points with an intensity before them, and so many bytes behind each row."""
    size = np.dtype(code).itemsize
    step, datatype = 4 + 3 * size, {4: 7, 8: 8}[size]
    rows = np.full((2, 2 * step + padding), 255, np.uint8)
    for row, column in np.ndindex(2, 2):
        at = column * step + 4
        rows[row, at : at + 3 * size] = POINTS[row, column].astype(code).view(np.uint8)
    fields = [SimpleNamespace(name=n, offset=4 + size * i, datatype=datatype, count=1) for i, n in enumerate("xyz")]
    message = {"height": 2, "width": 2, "point_step": step, "row_step": rows.shape[1], "data": rows.ravel()}
    message |= {"fields": fields, "is_bigendian": code[0] == ">"}
    return SimpleNamespace(**message | changed)


@pytest.mark.parametrize("padding", [0, 12])
@pytest.mark.parametrize("code", ["<f4", ">f4", "<f8", ">f8"])
def test_points_are_read_in_either_order_of_bytes_and_with_padded_rows(code: str, padding: int) -> None:
    np.testing.assert_array_equal(points_of(cloud(code, padding), "/points"), POINTS.reshape(-1, 3)[:3])


@pytest.mark.parametrize(
    ("changed", "what"),
    [
        ({"row_step": 20}, "bytes are no cloud of 2x2 points of 16 bytes"),
        ({"height": 3}, "64 bytes are no cloud of 2x3"),
        ({"point_step": 0}, "bytes are no cloud"),
        ({"point_step": 12, "row_step": 32}, "field z reaches beyond its point"),
        ({"fields": []}, "a cloud without x, y, z; it has no field"),
    ],
)
def test_a_cloud_that_lies_of_its_size_is_refused(changed: dict[str, Any], what: str) -> None:
    with pytest.raises(SourceError, match=what):
        points_of(cloud(**changed), "/points")


def test_of_points_in_one_direction_the_nearest_is_seen() -> None:
    points = np.array([[3.0, 0.0, 0.0], [2.0, 0.0, 0.04], [1.0, 0.0, 0.5]])

    scan = slice_as_scan(points, (-0.05, 0.05), np.radians(1.0))

    seen = np.isfinite(scan.ranges_m)
    np.testing.assert_allclose(scan.ranges_m[seen], [2.0])
    np.testing.assert_allclose(scan.angles()[seen], [0.0], atol=1e-6)
