"""The poses of a window of time: one at every instant that was measured, tied together by motion.

What leaves the window is not forgotten: the oldest pose is eliminated (Schur complement, in the form of a covariance
that is carried over the motion to the next pose), so that the next one is known by all that came before it.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.gate import threshold
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.smoother.key_poses import (
    Absolute,
    KeyPose,
    PredictedPose,
    WindowVerdict,
    carried_prior,
    moved_poses,
    nis_of,
)
from trailmark.estimation.smoother.motion_line import MotionLine, relative_motion
from trailmark.estimation.smoother.normal_equations import BandedFactor, ChainMotions
from trailmark.estimation.smoother.problem import Absolutes, WindowProblem, descend
from trailmark.estimation.smoother.recovery import seek_elsewhere, with_open_start
from trailmark.estimation.smoother_config import SmootherConfig
from trailmark.estimation.symmetric import ZERO, Sym3, add, congruence, diagonal, inverse, to_matrix
from trailmark.geometry import Pose2

__all__ = ["Window"]

# A pose without a measurement is laid where the window begins, when the one before it is so much older [s].
_SPACING_S = 1.0


class Window:
    """Estimates all poses of the window together, whenever one of them is measured.

    Parameters
    ----------
    line : MotionLine
        What is known of motion.
    config : SmootherConfig
        Of the estimator.
    stamp_s : float
        When it begins; ``-inf``: before all that will be said [s].
    start : (3,), (3, 3) float64
        The pose there, and its covariance.

    Attributes
    ----------
    n_sought : int
        How often the poses were sought anew and found elsewhere.
    """

    def __init__(self, line: MotionLine, config: SmootherConfig, stamp_s: float, start: tuple[Floats, Floats]) -> None:
        self._line = line
        self._gate = None if config.gate == "off" else config.gate
        self._loss = "none" if self._gate is None else config.loss
        self._floor = diagonal(config.floor_m**2, config.floor_m**2, math.radians(config.floor_deg) ** 2)
        self._prior_mean, covariance = start
        self._prior_information: Floats = np.asarray(np.linalg.inv(covariance))
        self._keys = [KeyPose(stamp_s, line.at(stamp_s))]
        self._stamps = [stamp_s]
        self._poses = self._prior_mean[np.newaxis].copy()
        self._factor: BandedFactor | None = None
        self._n_eliminated = 0  # since the factor was made
        self._covariances: dict[int, Sym3] = {}
        self._fixed_at_m = -math.inf
        self.n_sought = 0

    @property
    def begin_s(self) -> float:
        """The oldest instant that can be measured [s]."""
        return self._stamps[0]

    def n_of(self, source: str, stamp_s: float) -> int:
        """Return how many absolute estimates of a localizer are about an instant."""
        return sum(one.measurement.source == source for one in self._absolutes_at(stamp_s))

    def has(self, measurement: Measurement, stamp_s: float) -> bool:
        """Return whether a measurement of an instant is known."""
        return any(one.measurement.key == measurement.key for one in self._absolutes_at(stamp_s))

    def predict(self, stamp_s: float) -> PredictedPose:
        """Return the pose at a stamp: carried on from the last pose of the window before it."""
        if self._factor is None:
            self._solve()
        index = max(0, bisect_right(self._stamps, stamp_s) - 1)
        key, odometry = self._keys[index], self._line.at(max(stamp_s, self._stamps[0]))
        x, y, theta = self._poses[index].tolist()
        before, covariance = Pose2(x, y, theta), self._covariance(index)
        if odometry.stamp_s == key.stamp_s:
            return PredictedPose(before, covariance, odometry)
        motion, spread = relative_motion(key.odometry, odometry)
        pose = before @ motion
        carried = congruence(covariance, 1.0, 0.0, -(pose.y - y), pose.x - x)
        turned = congruence(spread, math.cos(theta), math.sin(theta), 0.0, 0.0)
        return PredictedPose(pose, add(carried, turned), odometry)

    def fixed_at_m(self, stamp_s: float) -> float:
        """Return the way travelled at the last pose before a stamp that an absolute estimate agrees with [m]."""
        for key in reversed(self._keys[: bisect_right(self._stamps, stamp_s)]):
            if any(one.weight > 0.5 for one in key.absolutes):
                return key.odometry.travelled_m
        return self._fixed_at_m

    def insert(self, stamp_s: float, measurement: Measurement) -> WindowVerdict:
        """Take an absolute estimate, and estimate all poses again."""
        predicted = self.predict(stamp_s)
        nis, dof = nis_of(measurement, predicted)
        limit = math.inf if self._gate is None else threshold(self._gate, dof)
        absolute = Absolute(measurement, limit, 1.0 if nis <= limit else 0.0)
        self._key_at(stamp_s, predicted).absolutes.append(absolute)
        self._solve()
        return WindowVerdict(nis <= limit and absolute.weight > 0.5, nis, dof)

    def note_motion(self, since_s: float) -> None:
        """Take note that motion has changed from a stamp on.

        Where it has changed before the first pose, what is known of that pose stays: it is about the map, and what
        carried it there has been eliminated. Only where odometry puts it moves, and the way since the last fix with it.
        """
        first = bisect_right(self._stamps, since_s)
        travelled_m = self._keys[0].odometry.travelled_m
        for key in self._keys[first:]:
            key.odometry = self._line.at(key.stamp_s)
        self._fixed_at_m += self._keys[0].odometry.travelled_m - travelled_m
        for index in range(max(first, 1), len(self._keys)):
            self._tie(index)
        if first < len(self._keys):
            self._factor = None

    def forget(self, horizon_s: float) -> None:
        """Eliminate the poses that nothing can be inserted between any more."""
        while len(self._keys) > 1 and self._stamps[1] <= horizon_s:
            self._eliminate_first()
        if self._stamps[0] < horizon_s - _SPACING_S:
            self._key_at(horizon_s, self.predict(horizon_s))
            self._eliminate_first()
            self._factor = None
        self._line.forget(self._stamps[0])

    def seek_elsewhere(self) -> bool:
        """Seek poses that agree with more of what was measured than the believed ones do; return whether there are."""
        problem = self._problem()
        absolutes = self._all_absolutes()
        if not absolutes or self._gate is None:
            return False
        found = seek_elsewhere(problem, self._poses, np.array([one.weight for one in absolutes]))
        if found is None:
            return False
        self.n_sought += 1
        opened = with_open_start(problem, found.poses[0])
        self._prior_mean, self._prior_information = opened.prior_mean, opened.prior_information
        self._poses = found.poses
        for one, weight in zip(absolutes, found.weights.tolist()):
            one.weight = weight
        self._solve()
        return True

    def restart(self, stamp_s: float, pose: Floats, covariance: Floats) -> None:
        """Replace the belief at an instant: what was said about earlier ones is forgotten."""
        self._key_at(stamp_s, self.predict(stamp_s))
        index = bisect_left(self._stamps, stamp_s)
        believed = self._poses[index].copy()
        self._keys, self._stamps, self._poses = self._keys[index:], self._stamps[index:], self._poses[index:]
        self._keys[0].absolutes = []
        self._poses = moved_poses(self._poses, believed, pose)
        self._prior_mean, self._prior_information = pose, np.asarray(np.linalg.inv(covariance))
        self._fixed_at_m = self._keys[0].odometry.travelled_m
        for one in self._all_absolutes():
            one.weight = 1.0
        self._solve()

    def _absolutes_at(self, stamp_s: float) -> list[Absolute]:
        index = bisect_left(self._stamps, stamp_s)
        return self._keys[index].absolutes if index < len(self._keys) and self._stamps[index] == stamp_s else []

    def _all_absolutes(self) -> list[Absolute]:
        return [one for key in self._keys for one in key.absolutes]

    def _key_at(self, stamp_s: float, predicted: PredictedPose) -> KeyPose:
        """Return the pose of an instant; a new one begins where it is predicted."""
        index = bisect_left(self._stamps, stamp_s)
        if index < len(self._keys) and self._stamps[index] == stamp_s:
            return self._keys[index]
        key = KeyPose(stamp_s, self._line.at(stamp_s))
        self._keys.insert(index, key)
        self._stamps.insert(index, stamp_s)
        self._poses = np.insert(self._poses, index, predicted.pose.array(), axis=0)
        self._tie(index)
        if index + 1 < len(self._keys):
            self._tie(index + 1)
        self._factor = None
        return key

    def _tie(self, index: int) -> None:
        """Compute the motion to a pose from the one before it."""
        key = self._keys[index]
        motion, covariance = relative_motion(self._keys[index - 1].odometry, key.odometry)
        key.motion, key.motion_covariance = motion, add(covariance, self._floor)
        information = inverse(key.motion_covariance)
        if information is None:  # a difference of far larger numbers: no more than its diagonal is left
            xx, _, _, yy, _, tt = covariance
            key.motion_covariance = add(diagonal(max(xx, 0.0), max(yy, 0.0), max(tt, 0.0)), self._floor)
            information = inverse(key.motion_covariance)
        key.motion_information = to_matrix(information or ZERO)

    def _problem(self) -> WindowProblem:
        keys = self._keys
        later = keys[1:]
        motions = ChainMotions(
            np.array([key.motion.array() for key in later]).reshape(-1, 3),
            np.array([key.motion_information for key in later]).reshape(-1, 3, 3),
        )
        which = [index for index, key in enumerate(keys) for _ in key.absolutes]
        absolutes = self._all_absolutes()
        measurements = [one.measurement for one in absolutes]
        return WindowProblem(
            self._prior_mean,
            self._prior_information,
            motions,
            Absolutes(
                np.array(which, dtype=np.intp),
                np.array([measurement.values for measurement in measurements]).reshape(-1, 3),
                np.array([one.information for one in absolutes]).reshape(-1, 3, 3),
                np.array([one.limit for one in absolutes]),
                [(row, one) for row, one in enumerate(measurements) if one.path is not None],
            ),
            self._loss,
        )

    def _solve(self) -> None:
        absolutes = self._all_absolutes()
        weights = np.array([one.weight for one in absolutes])
        found = descend(self._problem(), self._poses, first_weights=weights)
        for one, weight in zip(absolutes, found.weights.tolist()):
            one.weight = weight
        self._poses, self._factor = found.poses, found.factor
        self._n_eliminated = 0
        self._covariances = {}

    def _covariance(self, index: int) -> Sym3:
        known = self._covariances.get(index + self._n_eliminated)
        if known is None:
            assert self._factor is not None
            xx, xy, xt, _, yy, yt, _, _, tt = self._factor.covariance(index + self._n_eliminated).ravel().tolist()
            known = self._covariances[index + self._n_eliminated] = (xx, xy, xt, yy, yt, tt)
        return known

    def _eliminate_first(self) -> None:
        """Put all that is known of the first pose into what is known of the second."""
        first, prior = self._keys[0], (self._prior_mean, self._prior_information)
        self._prior_mean, self._prior_information = carried_prior(prior, self._poses[0], first, self._keys[1])
        if any(one.weight > 0.5 for one in first.absolutes):
            self._fixed_at_m = first.odometry.travelled_m
        del self._keys[0], self._stamps[0]
        self._poses = self._poses[1:]
        self._n_eliminated += 1
