"""The belief that is published, made of a state: pose and covariance, odometry, place on the path."""

from __future__ import annotations

import math
from collections.abc import Mapping

from trailmark.arrays import Floats
from trailmark.estimates import Belief, PathOffset
from trailmark.estimation.kalman.alternatives import believed_gaussian
from trailmark.estimation.kalman.dissent import covering_covariance
from trailmark.estimation.kalman.lasting_errors import LastingPrior, lasting_covariance
from trailmark.estimation.kalman.moved_belief import covariance_of_moved
from trailmark.estimation.kalman.one_sided import InnovationSums, covariance_of_one_sided_corrections
from trailmark.estimation.kalman.overruled_motion import covariance_of_overruled
from trailmark.estimation.kalman.repeated_fixes import covariance_of_frozen
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.on_path import offset_on_path
from trailmark.geometry import Pose2
from trailmark.paths import Path

__all__ = ["BeliefPlaces"]


class BeliefPlaces:
    """Makes beliefs of states, and remembers where on the path the last one was.

    Parameters
    ----------
    path : Path or None
        In whose coordinates beliefs are told, too.
    lasting : LastingPrior
        Of the errors of motion that last, before motions say anything of them.
    """

    def __init__(self, path: Path | None, lasting: LastingPrior) -> None:
        self._path = path
        self._lasting = lasting
        self._station_m: float | None = None
        self._innovations = InnovationSums()

    def belief_of(self, state: FilterState, odometry: tuple[Pose2, float], health: Mapping[str, str]) -> Belief:
        """Return the belief of a state.

        Parameters
        ----------
        state : FilterState
            The state, at the stamp of the belief.
        odometry : (Pose2, float)
            Pose in odom and way travelled, as they are published [m].
        health : mapping of str to str
            What is wrong with each localizer.
        """
        pose = covariance = on_path = None
        gaussian = believed_gaussian(state)
        if gaussian is not None:
            x, y, theta = gaussian.x[:3].tolist()
            variances = self._lasting.with_parting(state.diagnosis.parting.variances, state.diagnosis.sums)
            lasting = lasting_covariance(gaussian.lasting, variances.plus(state.diagnosis.way_errors))
            one_sided = covariance_of_one_sided_corrections(state, self._innovations)
            covariance = covering_covariance(state, gaussian) + one_sided + lasting
            if state.rejections.moved is not None:
                covariance += covariance_of_moved(state, gaussian)
            if state.diagnosis.repeated:
                covariance += covariance_of_frozen(state, gaussian)
            if state.diagnosis.overruled is not None or state.diagnosis.rivals:
                covariance += covariance_of_overruled(state, gaussian)
            covariance.flags.writeable = False
            pose = Pose2(x, y, theta)
            on_path = self._on_path(state.stamp_s, pose, covariance)
        return Belief(
            stamp_s=state.stamp_s,
            pose_map_base=pose,
            covariance=covariance,
            pose_odom_base=odometry[0],
            twist=state.odometry.twist,
            travelled_m=odometry[1],
            on_path=on_path,
            fix_age_m=state.odometry.travelled_m - state.fixed_at_m,
            motion_age_s=state.odometry.gap_s if state.odometry.has_moved else math.inf,
            health=health,
        )

    def _on_path(self, stamp_s: float, pose: Pose2, covariance: Floats) -> PathOffset | None:
        if self._path is None:
            return None
        xx, xy, xt, _, yy, yt, _, _, tt = covariance.ravel().tolist()
        spread, before_m = (xx, xy, xt, yy, yt, tt), self._station_m
        told = offset_on_path(self._path, pose, spread, stamp_s=stamp_s, near_station_m=before_m)
        self._station_m = told.station_m
        return told
