"""Motions that are wrong in a known way, put right: the option ``correct`` of every localizer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trailmark.arrays import Floats
from trailmark.config import MotionCorrection
from trailmark.estimates import Estimate, Motion
from trailmark.geometry import Pose2

__all__ = ["corrected_motion", "with_corrected_motions"]

_STEP = 1e-6


def with_corrected_motions(estimates: Sequence[Estimate], correction: MotionCorrection) -> tuple[Estimate, ...]:
    """Return estimates, every `Motion` among them corrected."""
    matrix = correction.matrix()
    return tuple(corrected_motion(one, matrix) if isinstance(one, Motion) else one for one in estimates)


def corrected_motion(motion: Motion, matrix: Floats) -> Motion:
    """Return a motion whose twist is multiplied by a (3, 3) matrix, with the information that goes with it."""
    told = motion.pose_since_now
    jacobian = np.empty((3, 3))
    for index, step in enumerate(_STEP * np.eye(3)):
        ahead, behind = (_correct(Pose2.from_array(told.array() + sign * step), matrix) for sign in (1.0, -1.0))
        jacobian[:, index] = np.array([ahead.x - behind.x, ahead.y - behind.y, _turn(behind, ahead)]) / (2.0 * _STEP)
    back = np.linalg.inv(jacobian)
    information = back.T @ motion.information @ back
    symmetric = (information + information.T) / 2.0
    return replace(motion, pose_since_now=_correct(told, matrix), information=symmetric)


def _correct(pose: Pose2, matrix: Floats) -> Pose2:
    return Pose2.exp(*(matrix @ np.array(pose.log())).tolist())


def _turn(a: Pose2, b: Pose2) -> float:
    return Pose2(0.0, 0.0, b.theta - a.theta).theta
