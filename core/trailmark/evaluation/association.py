"""Which pose of an estimate belongs to which true pose.

The side with the shorter usual interval is interpolated at the stamps of the other: a straight line
between two poses is closer to the way the shorter it is. Nothing is extrapolated, and nothing is
interpolated inside a gap.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.errors import DataError
from trailmark.geometry import Trajectory

__all__ = ["Interpolate", "Pairs", "associate", "poses_at", "usual_interval_s"]

Interpolate = Literal["auto", "truth", "estimate"]

# Equal rates differ in their last bits; the estimate is resampled only when it is clearly denser.
_CLEARLY_DENSER = 0.9
#: Two missing samples in a row are still bridged, a longer gap is not.
INTERVALS = 1.5
#: Stamps that differ by less are one: files write microseconds [s].
SAME_INSTANT_S = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """An estimate and the truth at the same stamps.

    Attributes
    ----------
    estimate, truth : Trajectory
        N poses each, at equal stamps.
    interpolated : {"truth", "estimate"}
        Which of the two was interpolated at the stamps of the other.
    max_difference_s : float
        A stamp was used where the interpolated side has a pose at most this far away [s].
    n_estimate, n_truth : int
        How many poses the two had before.
    """

    estimate: Trajectory
    truth: Trajectory
    interpolated: Literal["truth", "estimate"]
    max_difference_s: float
    n_estimate: int
    n_truth: int

    def __len__(self) -> int:
        return len(self.estimate)

    def document(self) -> dict[str, object]:
        """Return how the pairs were found, for a report."""
        return {
            "pairs": len(self),
            "interpolated": "reference" if self.interpolated == "truth" else "estimate",
            "max_difference_s": self.max_difference_s,
            "poses_reference": self.n_truth,
        }


def associate(
    estimate: Trajectory,
    truth: Trajectory,
    *,
    max_difference_s: float | None = None,
    interpolate: Interpolate = "auto",
) -> Pairs:
    """Return the poses of both at common stamps.

    Parameters
    ----------
    estimate, truth : Trajectory
        Stamps of one clock.
    max_difference_s : float, optional
        How far the nearest pose of the interpolated side may be away; default: 1.5 of its usual
        intervals, so that gaps of three intervals are bridged and longer ones are not [s].
    interpolate : {"auto", "truth", "estimate"}
        Which side is interpolated; "auto": the estimate where it is clearly denser, else the truth.

    Raises
    ------
    DataError
        If one has fewer than two poses, or fewer than two pairs are found.
    """
    for name, trajectory in (("estimate", estimate), ("ground truth", truth)):
        if len(trajectory) < 2:
            count = "1 pose" if len(trajectory) == 1 else "no poses"
            raise DataError(f"the {name} has {count}; at least 2 are needed")
    side = _side_to_interpolate(estimate, truth, interpolate)
    dense, sparse = (truth, estimate) if side == "truth" else (estimate, truth)
    tolerance_s = INTERVALS * usual_interval_s(dense.stamps_s) if max_difference_s is None else max_difference_s
    stamps = sparse.stamps_s[_usable(sparse.stamps_s, dense.stamps_s, tolerance_s)]
    if len(stamps) < 2:
        raise DataError(_no_overlap(estimate, truth, len(stamps), tolerance_s))
    inside_s = np.clip(stamps, dense.stamps_s[0], dense.stamps_s[-1])  # a microsecond over is none
    different_s, places = np.unique(inside_s, return_inverse=True)  # several may be that little over
    resampled, kept = Trajectory(stamps, dense.at(different_s).poses[places]), sparse.at(stamps)
    found = (kept, resampled) if side == "truth" else (resampled, kept)
    return Pairs(*found, side, tolerance_s, len(estimate), len(truth))


def usual_interval_s(stamps_s: Floats) -> float:
    """Return the time between two stamps that nine of ten intervals do not exceed; ``inf`` for fewer than two [s].

    Not the median: stamps taken on arrival come in bursts, and most intervals are then far below the usual one.
    """
    if len(stamps_s) < 2:
        return float("inf")
    return float(np.percentile(np.diff(stamps_s), 90.0, method="lower"))


def poses_at(trajectory: Trajectory, stamps_s: Floats, max_difference_s: float) -> Floats:
    """Return the interpolated poses at stamps in any order, NaN where there is none near enough.

    Parameters
    ----------
    stamps_s : (M,) float64
        In any order, with repetitions [s].
    max_difference_s : float
        As in `associate` [s].

    Returns
    -------
    (M, 3) float64
        x, y, theta; theta is not wrapped [m, m, rad].
    """
    poses = np.full((len(stamps_s), 3), np.nan)
    if len(trajectory) < 2:
        return poses
    usable = _usable(stamps_s, trajectory.stamps_s, max_difference_s)
    columns = (*trajectory.positions.T, np.unwrap(trajectory.headings))
    for index, column in enumerate(columns):
        poses[usable, index] = np.interp(stamps_s[usable], trajectory.stamps_s, column)
    return poses


def _side_to_interpolate(
    estimate: Trajectory, truth: Trajectory, interpolate: Interpolate
) -> Literal["truth", "estimate"]:
    if interpolate != "auto":
        return interpolate
    is_denser = usual_interval_s(estimate.stamps_s) < _CLEARLY_DENSER * usual_interval_s(truth.stamps_s)
    return "estimate" if is_denser else "truth"


def _usable(wanted_s: Floats, stamps_s: Floats, tolerance_s: float) -> Bools:
    after = np.clip(np.searchsorted(stamps_s, wanted_s), 1, len(stamps_s) - 1)
    nearest_s = np.minimum(np.abs(wanted_s - stamps_s[after - 1]), np.abs(wanted_s - stamps_s[after]))
    inside = (wanted_s >= stamps_s[0] - SAME_INSTANT_S) & (wanted_s <= stamps_s[-1] + SAME_INSTANT_S)
    return np.asarray(inside & (nearest_s <= tolerance_s))


def _no_overlap(estimate: Trajectory, truth: Trajectory, n: int, tolerance_s: float) -> str:
    spans = [f"{item.stamps_s[0]:.3f} to {item.stamps_s[-1]:.3f} s" for item in (estimate, truth)]
    return (
        f"estimate and ground truth have {n} common stamps within {tolerance_s:.3g} s; at least 2 are needed."
        f" The estimate covers {spans[0]}, the ground truth {spans[1]}: are the clocks the same?"
    )
