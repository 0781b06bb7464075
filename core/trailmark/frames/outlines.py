"""What stands around a robot and how large it is, for drawing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ShapeError

__all__ = ["Outlines"]


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """Lines to draw a trajectory among; nothing localizes by them.

    Attributes
    ----------
    around : tuple of (N, 2) float64
        Walls, poles, furniture, landmarks: each an open line of points in the frame of the ground truth, closed where
        its last point is its first [m].
    robot : (N, 2) float64 or None
        The outline of the robot seen from above, in base [m].

    Raises
    ------
    ShapeError
        If a line is not (N, 2) or holds a number that is not finite.
    """

    around: tuple[Floats, ...] = ()
    robot: Floats | None = None

    def __post_init__(self) -> None:
        for line in (*self.around, *([] if self.robot is None else [self.robot])):
            if line.ndim != 2 or line.shape[1] != 2 or not np.isfinite(line).all():
                raise ShapeError(f"an outline has finite points (N, 2), not {line.shape}")
