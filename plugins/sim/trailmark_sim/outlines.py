"""What stands in a world, as lines to draw."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Pose2

__all__ = ["box_outline", "circle_outline"]

_CORNERS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [1.0, 1.0]])
_N_CIRCLE = 16


def box_outline(pose: Pose2, length_m: float, width_m: float) -> Floats:
    """Return the closed outline of a box in the middle of a pose, `length_m` along its heading, (5, 2) [m]."""
    return np.asarray(pose @ (_CORNERS * (length_m / 2.0, width_m / 2.0)))


def circle_outline(x: float, y: float, radius_m: float) -> Floats:
    """Return the closed outline of something round, (N, 2) [m]."""
    turns = np.linspace(0.0, 2.0 * np.pi, _N_CIRCLE + 1)
    return np.column_stack([x + radius_m * np.cos(turns), y + radius_m * np.sin(turns)])
