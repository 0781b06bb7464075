"""What to do with a measurement that fails its test: keep it out, or give up the belief.

==========================================  =============================================  ===========================
rejections of the localizer                 what else is known                             decision
==========================================  =============================================  ===========================
fewer than `recover_after`                  -                                              keep the belief
as many                                     others support the belief in these directions  keep the belief
as many                                     they measured all directions, and agree on     relocate to that pose
                                            one pose
four times as many                          they agree on no pose                          inflate the covariance
as many, fewer than four times              they measured all directions, and agree on     keep the belief
                                            no pose
as many                                     they never measured all directions             inflate the covariance
==========================================  =============================================  ===========================
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.recovery import agreed_pose, directions_of
from trailmark.estimation.kalman.state import FilterState, RejectedMeasurement

__all__ = ["Inflate", "Keep", "RecoveryPolicy", "Relocate"]

# So many times `recover_after` rejections are waited for an agreement, before one alone is believed.
_PATIENCE = 4


@dataclass(frozen=True, slots=True)
class Keep:
    """The belief stays, the measurement stays out."""

    reason: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Relocate:
    """The rejected measurements agree on another pose: it replaces the belief.

    Attributes
    ----------
    pose : (3,) float64
        In the map.
    covariance : (3, 3) float64
        Of the pose.
    """

    pose: Floats
    covariance: Floats


@dataclass(frozen=True, slots=True)
class Inflate:
    """The covariance grows until the measurement is nothing unusual, and it is used."""


class RecoveryPolicy:
    """Decides between a belief and the measurements that contradict it.

    Parameters
    ----------
    recover_after : int
        How many more of a localizer must be rejected than accepted before the belief is questioned.
    support_s : float
        For how long an accepted measurement of another localizer supports the belief [s].
    """

    def __init__(self, recover_after: int, support_s: float) -> None:
        self.recover_after = recover_after
        self._support_s = support_s

    @property
    def most_rejections(self) -> int:
        """The count of rejections saturates here, so that a localizer that is right again is soon believed."""
        return _PATIENCE * self.recover_after

    def decide(
        self, state: FilterState, source: str, rejected: Sequence[RejectedMeasurement], directions: Floats, n: int
    ) -> Keep | Relocate | Inflate:
        """Return what to do about the last of some rejected measurements.

        Parameters
        ----------
        state : FilterState
            The belief that they contradict.
        source : str
            The localizer.
        rejected : sequence of RejectedMeasurement
            All of its measurements that were rejected of late.
        directions : (k, 3) float64
            Directions of the pose that the last one measures.
        n : int
            How many more were rejected than accepted.
        """
        if n < self.recover_after:
            return Keep()
        if self._is_supported(state, source, directions):
            return Keep("but others support the belief")
        assert state.gaussian is not None
        odom, believed = state.odometry.pose_odom_base, state.gaussian.x
        if directions_of(rejected, odom, believed) < 3:
            return Inflate()
        agreed = agreed_pose(rejected, odom, believed)
        if agreed is not None:
            return Relocate(*agreed)
        return Inflate() if n >= self.most_rejections else Keep("and they do not agree on another pose")

    def _is_supported(self, state: FilterState, source: str, directions: Floats) -> bool:
        """Return whether other localizers, accepted of late, measure these directions: then the belief is right."""
        rows = [
            fix.directions
            for other, fix in state.rejections.corroborations.items()
            if other != source and state.stamp_s - fix.stamp_s <= self._support_s
        ]
        return bool(rows) and _spans(np.vstack(rows), directions)


def _spans(rows: Floats, wanted: Floats) -> bool:
    """Return whether some directions, in metres and radians, contain others."""
    rank = np.linalg.matrix_rank(_unit(rows), tol=1e-3)
    return bool(np.linalg.matrix_rank(_unit(np.vstack([rows, wanted])), tol=1e-3) == rank)


def _unit(rows: Floats) -> Floats:
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))
