"""What the worlds say of themselves for drawing."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.geometry import Pose2
from trailmark_sim.outlines import box_outline, circle_outline
from trailmark_sim.worlds.solids import Solids


def test_a_box_is_as_long_as_it_is_along_its_heading() -> None:
    corners = box_outline(Pose2(1.0, 2.0, math.pi / 2), 4.0, 1.0)

    np.testing.assert_allclose(np.ptp(corners, axis=0), [1.0, 4.0])
    np.testing.assert_allclose(corners[:4].mean(axis=0), [1.0, 2.0])
    np.testing.assert_array_equal(corners[0], corners[-1])


def test_a_pole_is_round() -> None:
    points = circle_outline(3.0, -1.0, 0.2)

    np.testing.assert_allclose(np.hypot(points[:, 0] - 3.0, points[:, 1] + 1.0), 0.2)
    np.testing.assert_allclose(points[0], points[-1], atol=1e-12)


def test_a_room_has_its_walls_and_everything_in_it() -> None:
    solids = Solids(-1.0, 3.0, -2.0, 2.0)
    solids.box("a table", 1.0, 0.0, 0.5, 0.5)
    solids.pole("a plant", 2.0, 1.0, 0.1)

    walls, table, plant = solids.outlines()

    assert (walls.min(axis=0).tolist(), walls.max(axis=0).tolist()) == ([-1.0, -2.0], [3.0, 2.0])
    np.testing.assert_allclose(np.ptp(table, axis=0), 0.5)
    assert plant[:, 0].max() == pytest.approx(2.1)
