"""Errors that all motions of a localizer have in common: a gyro's bias, a wheel's scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.innovation import Innovation, LinearModel
from trailmark.estimation.kalman.layout import CommonError, Layout
from trailmark.estimation.kalman.motions import MotionStep
from trailmark.estimation.kalman.trust import root_of
from trailmark.estimation.kalman.weighing import fuse_steps, information_of
from trailmark.estimation.symmetric import Sym3, add, inverse, scaled, to_matrix
from trailmark.geometry import Pose2, Twist2, wrap_angle

if TYPE_CHECKING:
    from trailmark.estimation.kalman.correction import Filter

__all__ = ["CommonErrors"]

# A scale is never believed to be further off than this: a wheel half or twice its size.
_LEAST_SCALE, _MOST_SCALE = -0.5, 1.0
_UNKNOWN = 1e6


class CommonErrors:
    """Takes common errors off what localizers say, and learns them.

    They show in absolute estimates, through the way that was driven since; and where several localizers measure the
    same motion, in their disagreement. With independent errors, the error of the weighted mean of several steps has
    nothing to do with their differences, so a difference may be used as a measurement of its own.

    Parameters
    ----------
    layout : Layout
        Of the state.
    kalman : Filter
        Does the arithmetic.
    is_independent : bool
        Whether the errors of several localizers have nothing in common; otherwise disagreement teaches nothing.
    """

    def __init__(self, layout: Layout, kalman: Filter, is_independent: bool) -> None:
        self._layout = layout
        self._filter = kalman
        self._is_independent = is_independent

    def remove_from(self, x: Floats, steps: Sequence[tuple[str, MotionStep]], dt_s: float) -> list[MotionStep]:
        """Return the steps without their common errors, as far as these are known."""
        return [self._without_error(x, source, step, dt_s) for source, step in steps]

    def jacobian(self, x: Floats, steps: Sequence[tuple[str, MotionStep]], dt_s: float, drift: Sym3) -> Floats:
        """Return how the weighted mean of the steps, without their common errors, changes with the state, (3, n)."""
        unbiased = [(source, self._without_error(x, source, step, dt_s)) for source, step in steps]
        return self._jacobian_of(x, unbiased, dt_s, drift)

    def learn(
        self,
        x: Floats,
        covariance: Floats,
        steps: Sequence[tuple[str, MotionStep]],
        dt_s: float,
        held: Twist2,
        drift: Sym3,
    ) -> tuple[Floats, Floats]:
        """Return the state after what the steps say of each other: each against the mean of those before it."""
        if not self._is_independent:
            return x, covariance
        for k in range(1, len(steps)):
            if not any(source in self._layout.common for source, _ in steps[: k + 1]):
                continue
            unbiased = [(source, self._without_error(x, source, step, dt_s)) for source, step in steps[: k + 1]]
            x, covariance = self._compare_last(x, covariance, unbiased, dt_s, held, drift)
        return x, covariance

    def wander(self, noise: Floats, dt_s: float) -> None:
        """Add what common errors may have changed by, in place."""
        for common in self._layout.common.values():
            noise[common.index, common.index] += common.walk * dt_s

    def _compare_last(
        self,
        x: Floats,
        covariance: Floats,
        unbiased: Sequence[tuple[str, MotionStep]],
        dt_s: float,
        held: Twist2,
        drift: Sym3,
    ) -> tuple[Floats, Floats]:
        before, (source, step) = unbiased[:-1], unbiased[-1]
        # What the others did not measure is next to unknown; the velocity before is theirs, and counted already.
        mean, _ = fuse_steps([other for _, other in before], dt_s, held, scaled(drift, _UNKNOWN), True)
        assert mean.covariance is not None
        root = root_of(information_of(step))
        away = np.array([step.x - mean.x, step.y - mean.y, wrap_angle(step.turn - mean.turn)])
        change = self._gradient(x, source, step, dt_s) - self._jacobian_of(x, before, dt_s, drift)
        whitened = (
            np.linalg.inv(np.linalg.cholesky(root @ to_matrix(mean.covariance) @ root.T + np.eye(len(root)))) @ root
        )
        innovation, jacobian = -whitened @ away, whitened @ change
        seen = Innovation(innovation, jacobian, covariance)
        return self._filter.update(x, covariance, seen, LinearModel(innovation, jacobian, x))

    def _jacobian_of(self, x: Floats, unbiased: Sequence[tuple[str, MotionStep]], dt_s: float, drift: Sym3) -> Floats:
        share = 1.0 if self._is_independent else 1.0 / len(unbiased)
        shares = [scaled(information_of(step), share) for _, step in unbiased]
        total = shares[0]
        for more in shares[1:]:
            total = add(total, more)
        covariance = inverse(total)
        if covariance is None:
            floor = inverse(drift)
            assert floor is not None
            covariance = inverse(add(total, floor)) or drift
        mean = to_matrix(covariance)
        columns = np.zeros((3, self._layout.n))
        for (source, step), information in zip(unbiased, shares):
            if source in self._layout.common:
                columns += mean @ to_matrix(information) @ self._gradient(x, source, step, dt_s)
        return columns

    def _without_error(self, x: Floats, source: str, step: MotionStep, dt_s: float) -> MotionStep:
        common = self._layout.common.get(source)
        if common is None:
            return step
        if common.kind == "gyro_bias":
            turn = step.turn - float(x[common.index]) * dt_s
            return _with_pose(step, Pose2(step.x, step.y, turn), dt_s)
        shrunk = 1.0 / (1.0 + _scale(x, common))
        return _with_pose(step, Pose2(shrunk * step.x, shrunk * step.y, step.turn), dt_s)

    def _gradient(self, x: Floats, source: str, step: MotionStep, dt_s: float) -> Floats:
        """Return how a step without its common error changes with the state, (3, n)."""
        gradient = np.zeros((3, self._layout.n))
        common = self._layout.common.get(source)
        if common is None:
            return gradient
        if common.kind == "gyro_bias":
            gradient[2, common.index] = -dt_s
        else:
            per_scale = -1.0 / (1.0 + _scale(x, common))
            gradient[0, common.index], gradient[1, common.index] = per_scale * step.x, per_scale * step.y
        return gradient


def _scale(x: Floats, common: CommonError) -> float:
    return min(max(float(x[common.index]), _LEAST_SCALE), _MOST_SCALE)


def _with_pose(step: MotionStep, pose: Pose2, dt_s: float) -> MotionStep:
    forward_m, left_m, turn_rad = pose.log()
    twist = Twist2(forward_m / dt_s, left_m / dt_s, turn_rad / dt_s)
    return replace(step, x=pose.x, y=pose.y, turn=pose.theta, twist=twist)
