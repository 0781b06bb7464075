"""Poses that are written as matrices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import SourceError
from trailmark_datasets.textfiles import number

__all__ = ["matrix_of", "pose_of"]

# Poses are written with six digits or more.
_NOT_A_ROTATION = 1e-2


def matrix_of(fields: Sequence[str], where: str) -> Floats:
    """Return the 12 numbers of a matrix, (3, 4).

    Raises
    ------
    SourceError
        If they are not as many, or not all numbers.
    """
    if len(fields) != 12:
        raise SourceError(f"{where}: expected the 12 numbers of a 3x4 matrix, found {len(fields)}")
    return np.array([number(field, "a number of the matrix", where) for field in fields]).reshape(3, 4)


def pose_of(matrix: Floats, where: str) -> Floats:
    """Return a matrix (3, 4) that is a pose.

    Raises
    ------
    SourceError
        If its first three columns are no rotation: a pose of zeros has no inverse, a mirror is no pose.
    """
    rotation = matrix[:, :3]
    is_rigid = np.abs(rotation).max() <= 2 and np.abs(rotation @ rotation.T - np.eye(3)).max() <= _NOT_A_ROTATION
    if not is_rigid or np.linalg.det(rotation) < 0.0:
        raise SourceError(f"{where}: the first three columns are no rotation")
    return matrix
