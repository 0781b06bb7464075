"""Many poses of the plane at once: (N, 3) arrays of x, y, theta, composed row by row."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import wrap_angles

__all__ = ["adjoint_of", "between", "compose", "exp_of", "invert", "log_of"]


def compose(a: Floats, b: Floats) -> Floats:
    """Return ``a @ b`` row by row; a single pose (3,) goes with every row."""
    a, b = np.broadcast_arrays(a, b)
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + cos * b[..., 0] - sin * b[..., 1]
    y = a[..., 1] + sin * b[..., 0] + cos * b[..., 1]
    return np.stack([x, y, wrap_angles(a[..., 2] + b[..., 2])], axis=-1)


def invert(a: Floats) -> Floats:
    """Return the inverse of every row."""
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = -cos * a[..., 0] - sin * a[..., 1]
    y = sin * a[..., 0] - cos * a[..., 1]
    return np.stack([x, y, wrap_angles(-a[..., 2])], axis=-1)


def between(a: Floats, b: Floats) -> Floats:
    """Return ``b`` as seen from ``a``, row by row."""
    return compose(invert(a), b)


def exp_of(twists: Floats) -> Floats:
    """Return the motion of every constant twist (forward, left, turn): the exponential of SE(2)."""
    turn = twists[..., 2]
    sine, cosine = _arc(turn)
    x = sine * twists[..., 0] - cosine * twists[..., 1]
    y = cosine * twists[..., 0] + sine * twists[..., 1]
    return np.stack([x, y, wrap_angles(turn)], axis=-1)


def log_of(poses: Floats) -> Floats:
    """Return the twist (forward, left, turn) of which every row is the motion; the turn is within half a turn."""
    half = poses[..., 2] / 2.0
    is_small = np.abs(half) < 1e-6
    scale = np.where(is_small, 1.0 - half * half / 3.0, half / np.tan(np.where(is_small, 1.0, half)))
    x = scale * poses[..., 0] + half * poses[..., 1]
    y = scale * poses[..., 1] - half * poses[..., 0]
    return np.stack([x, y, poses[..., 2]], axis=-1)


def adjoint_of(poses: Floats) -> Floats:
    """Return the (..., 3, 3) adjoint of every row: ``twist_a = adjoint_of(pose_a_b) @ twist_b``."""
    cos, sin = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    zero, one = np.zeros_like(cos), np.ones_like(cos)
    rows = [cos, -sin, poses[..., 1], sin, cos, -poses[..., 0], zero, zero, one]
    return np.stack(rows, axis=-1).reshape(*cos.shape, 3, 3)


def _arc(turn: Floats) -> tuple[Floats, Floats]:
    """Return sin(a) / a and (1 - cos(a)) / a."""
    is_small = np.abs(turn) < 1e-6
    safe = np.where(is_small, 1.0, turn)
    sine = np.where(is_small, 1.0 - turn * turn / 6.0, np.sin(safe) / safe)
    cosine = np.where(is_small, turn / 2.0, 2.0 * np.sin(safe / 2.0) ** 2 / safe)
    return sine, cosine
