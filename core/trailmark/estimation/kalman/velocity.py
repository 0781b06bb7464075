"""Velocity and yaw rate as states: what motion says of them is filtered, and a gap goes on with them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.innovation import Innovation, LinearModel
from trailmark.estimation.kalman.layout import Layout
from trailmark.estimation.kalman.motions import MotionStep
from trailmark.estimation.kalman.state import FilterState, Gaussian
from trailmark.estimation.kalman.trust import root_of
from trailmark.estimation.kalman.weighing import information_of
from trailmark.estimation.symmetric import ZERO
from trailmark.geometry import Twist2

if TYPE_CHECKING:
    from trailmark.estimation.kalman.correction import Filter

__all__ = ["VelocityModel"]


class VelocityModel:
    """A velocity that forgets itself in ``coast_s`` (a Gauss-Markov process); unheard of, it is `drift_sigma`.

    Where motion is measured, the pose moves by it and the velocity is corrected by it; that the two share the motion's
    error is left out. Where it is not, the pose goes on with the velocity, and a later fix corrects both.

    Parameters
    ----------
    layout : Layout
        Of the state, with velocity.
    kalman : Filter
        Does the arithmetic.
    coast_s : float
        Time in which a velocity forgets itself [s].
    """

    def __init__(self, layout: Layout, kalman: Filter, coast_s: float) -> None:
        self._layout = layout
        self._filter = kalman
        self._tau_s = coast_s
        self._variances = np.square(layout.velocity_sigmas)

    def coast(self, x: Floats, dt_s: float) -> tuple[MotionStep, float]:
        """Return the step of a gap, without noise, and for how long the velocity would make it [s]."""
        held_s = self._tau_s * -math.expm1(-dt_s / self._tau_s)
        forward, left, yaw = x[3:6].tolist()
        twist = Twist2(forward, left, yaw)
        pose = twist.after(held_s)
        return MotionStep(pose.x, pose.y, pose.theta, ZERO, None, twist), held_s

    def carry(self, moved: Floats, jacobian: Floats, noise: Floats, turned: Floats, dt_s: float, held_s: float) -> None:
        """Carry the velocity on over a piece of time, in place; `held_s` is 0 where the pose moves as measured."""
        tau_s = self._tau_s
        kept = math.exp(-dt_s / tau_s)
        moved[3:6] *= kept
        jacobian[range(3, 6), range(3, 6)] = kept
        noise[range(3, 6), range(3, 6)] = self._variances * (1.0 - kept * kept)
        if held_s == 0.0:
            return
        jacobian[:3, 3:6] += held_s * turned
        way = tau_s * tau_s * (2.0 * dt_s / tau_s - 3.0 + 4.0 * kept - kept * kept)
        noise[:3, :3] += turned @ np.diag(self._variances * max(way, 0.0)) @ turned.T
        both = turned @ np.diag(self._variances * tau_s * (1.0 - kept) ** 2)
        noise[:3, 3:6] += both
        noise[3:6, :3] += both.T

    def update(
        self, state: FilterState, steps: Sequence[MotionStep], dt_s: float, columns: Floats | None
    ) -> FilterState:
        """Return a state whose velocity is corrected by the steps just made."""
        assert state.gaussian is not None
        x, covariance = state.gaussian.x, state.gaussian.covariance
        for step in steps:
            root = root_of(information_of(step)) * dt_s
            jacobian = np.zeros((len(root), len(x)))
            jacobian[:, 3:6] = root
            if columns is not None and len(steps) == 1:
                jacobian[:, 6:] = -root @ columns[:, 6:] / dt_s
            twist = step.twist
            measured = np.array([twist.forward_mps, twist.left_mps, twist.yaw_radps])
            innovation = root @ (measured - x[3:6])
            seen = Innovation(innovation, jacobian, covariance)
            x, covariance = self._filter.update(x, covariance, seen, LinearModel(innovation, jacobian, x))
        return self.with_twist(replace(state, gaussian=Gaussian(x, covariance, state.gaussian.lasting)))

    def with_twist(self, state: FilterState) -> FilterState:
        """Return a state whose odometry has the estimated velocity."""
        assert state.gaussian is not None
        forward, left, yaw = state.gaussian.x[3:6].tolist()
        return replace(state, odometry=replace(state.odometry, twist=Twist2(forward, left, yaw)))
