"""How the map lies in the frame of the truth: the same frame, unless a run shows that it is another one.

What a localizer says of a place is judged in the map, without an alignment: a fit would take an honest error for
another frame, and tells of a liar how well he agrees with himself. Only where the map plainly is another frame, as
where a run begins at the origin and the truth comes from motion capture, the fixes are fitted to the truth, and the
uncertainty of the fit counts beside theirs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from trailmark.arrays import Floats
from trailmark.evaluation.alignment import UNDETERMINED_RAD, rotation_sigma_rad
from trailmark.evaluation.relative import between
from trailmark.geometry import Pose2
from trailmark.geometry.rigid import fit_pose2

__all__ = ["ONE_FRAME", "MapFrame", "find_map_frame", "map_frame_of_start"]

# A fit must leave this share of the raw errors at most, before the map is taken for another frame.
_FRAME_SHARE = 0.1
# ... and the run must not begin where the truth begins: within these, or a third of the raw error, which is larger.
_START_M = 0.05
_START_RAD = math.radians(10.0)
_LEAST_FIXES = 5


@dataclass(frozen=True, slots=True, eq=False)
class MapFrame:
    """The map in the frame of the truth.

    Attributes
    ----------
    pose_truth_map : Pose2 or None
        ``pose_truth = pose_truth_map @ pose_map``; None where the way does not tell how the two are turned.
    note : str
        What has to be known about it; empty where the two are one frame.
    centre_map : (2,) float64
        The turn is uncertain about this place [m].
    sigma_m, sigma_rad : float
        Standard deviation of each coordinate of that place, and of the turn; 0 where the two are one frame.
    """

    pose_truth_map: Pose2 | None = Pose2()
    note: str = ""
    centre_map: Floats = field(default_factory=lambda: np.zeros(2))
    sigma_m: float = 0.0
    sigma_rad: float = 0.0

    def in_map(self, poses_truth: Floats) -> Floats:
        """Return true poses (N, 3) as seen from the map; NaN where that is not known."""
        if self.pose_truth_map is None:
            return np.full(poses_truth.shape, np.nan)
        return between(np.broadcast_to(self.pose_truth_map.array(), poses_truth.shape), poses_truth)

    def weaken(self, information: Floats, positions_map: Floats) -> Floats:
        """Return information (N, 3, 3) about poses in the map with the uncertainty of this frame on top.

        ``(I^-1 + S)^-1 = (1 + I S)^-1 I``, which holds where nothing was measured in a direction, too.
        """
        if self.sigma_m == 0.0 and self.sigma_rad == 0.0:
            return information
        lever = positions_map - self.centre_map
        turn = np.stack([-lever[:, 1], lever[:, 0], np.ones(len(lever))], axis=1)
        spread = self.sigma_rad**2 * turn[:, :, None] * turn[:, None, :]
        spread[:, [0, 1], [0, 1]] += self.sigma_m**2
        weakened = np.linalg.solve(np.eye(3) + information @ spread, information)
        return np.asarray((weakened + weakened.transpose(0, 2, 1)) / 2.0)


ONE_FRAME = MapFrame()


def find_map_frame(fixes_map: Floats, truth: Floats, start: tuple[Pose2, Pose2] | None) -> MapFrame:
    """Return how the map lies in the frame of the truth.

    Parameters
    ----------
    fixes_map, truth : (N, 3) float64
        What was said of places, and where base was then, in their own frames.
    start : (Pose2, Pose2) or None
        The first pose of the run's belief, and the true one at that stamp.
    """
    if len(fixes_map) < _LEAST_FIXES:
        return ONE_FRAME
    raw_m = float(np.median(np.linalg.norm(fixes_map[:, :2] - truth[:, :2], axis=1)))
    if raw_m <= _START_M:
        return ONE_FRAME
    fit = fit_pose2(truth[:, :2], fixes_map[:, :2])
    residuals = fit @ np.ascontiguousarray(fixes_map[:, :2]) - truth[:, :2]
    left_m = float(np.median(np.linalg.norm(residuals, axis=1)))
    if left_m > _FRAME_SHARE * raw_m or (start is not None and _is_at_start(*start, raw_m)):
        return ONE_FRAME
    sigma_rad = rotation_sigma_rad(truth[:, :2], residuals)
    away = f"the frame of the map is not that of the ground truth: {fit.distance_to(Pose2()):.2f} m away"
    if sigma_rad > UNDETERMINED_RAD:
        note = f"{away}, and the way is too short to tell its turn, so fixes are not compared with the truth"
        return MapFrame(None, note)
    turned = f"turned by {math.degrees(fit.theta):.1f} ± {math.degrees(sigma_rad):.1g}°"
    spread_m = math.sqrt(float((residuals * residuals).sum()) / (2 * len(residuals)))
    sigma_m = sigma_rad * math.sqrt(float(((truth[:, :2] - truth[:, :2].mean(axis=0)) ** 2).sum(axis=1).mean()))
    return MapFrame(
        fit,
        f"{away}, {turned}; fixes are compared after a fit, with its uncertainty",
        fixes_map[:, :2].mean(axis=0),
        min(sigma_m, spread_m),
        sigma_rad,
    )


def map_frame_of_start(believed: Pose2, true: Pose2) -> MapFrame:
    """Return how a map lies in the frame of the truth that the run itself lays, from where its belief begins.

    Parameters
    ----------
    believed, true : Pose2
        The first pose of the run's belief, and the true one at that stamp.
    """
    if _is_at_start(believed, true, 0.0):
        return ONE_FRAME
    pose_truth_map = true @ believed.inverse()
    away_m, turned_deg = pose_truth_map.distance_to(Pose2()), math.degrees(pose_truth_map.theta)
    return MapFrame(
        pose_truth_map,
        f"the map begins where it is taught from: the frame of the ground truth is {away_m:.2f} m away and turned by"
        f" {turned_deg:.1f}°; beliefs are compared from there",
    )


def _is_at_start(believed: Pose2, true: Pose2, raw_m: float) -> bool:
    apart = believed.between(true)
    return math.hypot(apart.x, apart.y) <= max(_START_M, raw_m / 3.0) and abs(apart.theta) <= _START_RAD
