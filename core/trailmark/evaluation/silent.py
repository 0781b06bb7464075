"""The share of estimates that are wrong by more than their covariance allows, without being `Lost`.

An answered estimate is *silently wrong* when its error is more than five of its own standard deviations and more than a
floor, in position or in heading. A motion of one frame may hide below the floor what it adds up to, so motions are
also judged chained over a second and over a metre: a picture that stands still while the robot creeps is found there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.evaluation.chaining import chain_windows, covariances_of, windows
from trailmark.evaluation.estimate_errors import EstimateErrors, estimate_errors, true_poses
from trailmark.evaluation.naming import metric_name
from trailmark.evaluation.plugged import JudgedEstimates
from trailmark.evaluation.relative import between
from trailmark.geometry import Trajectory, wrap_angles

__all__ = ["FLOORS", "N_SIGMAS", "ErrorFloor", "are_silently_wrong", "silent", "silently_wrong_ones"]

#: An error within so many of its own standard deviations has been announced.
N_SIGMAS = 5.0
# A direction with a larger variance than this was not measured [m^2].
_WIDE_M2 = 1e4


@dataclass(frozen=True, slots=True)
class ErrorFloor:
    """Errors below which an estimate is right, whatever covariance it claimed.

    Attributes
    ----------
    position_m : float
        Distance [m].
    heading_rad : float
        Turn [rad].
    """

    position_m: float
    heading_rad: float


#: By kind of estimate. What sees shifts of a picture speaks of path offsets: about 6 px of a usual forward camera.
FLOORS: Mapping[str, ErrorFloor] = {
    "motion": ErrorFloor(0.5e-3, np.radians(0.05)),
    "fix": ErrorFloor(20e-3, np.radians(1.0)),
    "pathoffset": ErrorFloor(20e-3, np.radians(1.0)),
}


def silent(judged: JudgedEstimates) -> dict[str, float]:
    """Return the share of silently wrong estimates among the answered, and the share of answers.

    ``silent`` is the largest of the shares of single estimates, of seconds and of metres of motion; without truth there
    is only ``answered_fraction``: of all times that the localizer looked, how often it did not say `Lost`.
    """
    estimates = judged.estimates
    n_lost, n_refused = (int((estimates.outcome == outcome).sum()) for outcome in ("lost", "refused"))
    found: dict[str, float] = {}
    if len(estimates):
        answered = len(estimates) - n_lost - n_refused
        found[metric_name("answered_fraction", f"n={len(estimates)}")] = answered / len(estimates)
    if judged.truth is None:
        return found
    errors = estimate_errors(estimates, judged.truth, judged.map_frame, judged.path)
    shares = dict(_shares(errors, judged.truth))
    if shares:
        n = sum(n for n, _ in shares.values())
        worst = max(share for _, share in shares.values())
        found[metric_name("silent", f"n={n}")] = worst
        found |= {metric_name(f"silent_{name}", f"n={n}"): share for name, (n, share) in shares.items()}
    return found


def are_silently_wrong(errors: Floats, covariances: Floats, floor: ErrorFloor) -> Bools:
    """Return which errors are more than `N_SIGMAS` of their own and more than a floor, (N,).

    Position and heading are judged each by its own marginal covariance. Where a direction of the position was not
    measured, only the other counts.

    Parameters
    ----------
    errors : (N, 3) float64
        x, y, theta, or station, lateral, heading; NaN is not wrong [m, m, rad].
    covariances : (N, 3, 3) float64
        As stated.
    """
    values, axes = np.linalg.eigh(covariances[:, :2, :2])
    along = np.einsum("nij,ni->nj", axes, errors[:, :2])  # columns of `axes` are the directions
    is_measured = values < _WIDE_M2
    sigmas_squared = np.where(is_measured, along**2 / np.maximum(values, 1e-300), 0.0).sum(axis=1)
    size_m = np.sqrt(np.where(is_measured, along**2, 0.0).sum(axis=1))
    turn = np.abs(wrap_angles(errors[:, 2]))
    turn_sigma = np.sqrt(covariances[:, 2, 2])
    in_position = (sigmas_squared > N_SIGMAS**2) & (size_m > floor.position_m)
    in_heading = (turn > N_SIGMAS * turn_sigma) & (turn > floor.heading_rad)
    return np.asarray(in_position | in_heading)


def silently_wrong_ones(judged: EstimateErrors) -> tuple[Bools, Bools]:
    """Return of which estimates the error is known, (N,), and which of these are silently wrong, (N,)."""
    known = np.asarray(np.isfinite(judged.errors).all(axis=1) & np.isfinite(judged.information).all(axis=(1, 2)))
    is_wrong = np.zeros(len(known), dtype=np.bool_)
    for kind, floor in FLOORS.items():
        rows = known & (judged.estimates.kind == kind)
        is_wrong[rows] = are_silently_wrong(judged.errors[rows], covariances_of(judged.information[rows]), floor)
    return known, is_wrong


def _shares(judged: EstimateErrors, truth: Trajectory) -> Iterator[tuple[str, tuple[int, float]]]:
    """Yield the share of silently wrong ones by what was judged, with their number."""
    known, is_wrong = silently_wrong_ones(judged)
    told, wrong = judged.estimates.where(known), is_wrong[known]
    if len(wrong):
        yield "single", (len(wrong), float(wrong.mean()))
    rows = np.asarray(told.kind == "motion")
    motions, own = told.where(rows), covariances_of(judged.information[known][rows])
    if not len(motions):
        return
    since, now = true_poses(truth, motions.since_s), true_poses(truth, motions.stamp_s)
    ways_m = np.linalg.norm(now[:, :2] - since[:, :2], axis=1)
    for name, ways, length in (("1s", motions.stamp_s - motions.since_s, 1.0), ("1m", ways_m, 1.0)):
        pieces = list(windows(motions.since_s, motions.stamp_s, ways, length))
        chained, spreads, first, last = chain_windows(motions.numbers, own, pieces)
        if len(chained):
            off = chained - between(since[first], now[last])
            yield name, (len(chained), float(are_silently_wrong(off, spreads, FLOORS["motion"]).mean()))
