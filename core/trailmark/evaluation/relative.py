"""Relative pose error over distances and times, and drift."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from trailmark.arrays import Floats, Indices
from trailmark.errors import ConfigError
from trailmark.evaluation.absolute import Summary, summarize
from trailmark.evaluation.association import Pairs
from trailmark.evaluation.naming import metric_name, number_text
from trailmark.geometry import wrap_angles

__all__ = ["Drift", "RelativeError", "between", "default_distance_m", "drift", "relative_error"]


# A pair of poses stands for a delta when it is this near to it: pairs across a gap do not.
_DELTA_TOLERANCE = 0.1
_ROUNDING = 1e-6  # of a delta, at the end of the way: stamps since 1970 have 2.4e-7 s
_N_DRIFT_LENGTHS = 8


@dataclass(frozen=True, slots=True)
class RelativeError:
    """Relative pose error (RPE) over one distance or one time.

    Attributes
    ----------
    delta : float
        How far apart the two poses of a pair are [m or s].
    unit : {"m", "s"}
        Over a distance or over a time.
    n : int
        Number of pairs of poses; all that are `delta` apart within 10 %.
    position : Summary
        Of the lengths of the relative translation errors [m].
    heading : Summary
        Of the absolute relative heading errors [rad].
    """

    delta: float
    unit: Literal["m", "s"]
    n: int
    position: Summary
    heading: Summary

    def metrics(self) -> dict[str, float]:
        """Return the metrics by name: metres and degrees."""
        protocol = (f"{number_text(self.delta)}{self.unit}", f"n={self.n}")
        return {
            **self.position.metrics("rpe", "m", *protocol),
            **self.heading.metrics("rpe_heading", "deg", *protocol, scale=math.degrees(1.0)),
        }


@dataclass(frozen=True, slots=True)
class Drift:
    """How much is lost on the way: relative errors divided by the length of the way, averaged.

    Attributes
    ----------
    shortest_m, longest_m : float
        Lengths of the pieces of way [m].
    n : int
        Number of pieces, overlapping.
    percent : float
        Translation error per length [%].
    deg_per_m : float
        Heading error per length [deg/m].
    """

    shortest_m: float
    longest_m: float
    n: int
    percent: float
    deg_per_m: float

    def metrics(self) -> dict[str, float]:
        """Return the metrics by name."""
        protocol = (f"{number_text(self.shortest_m)}-{number_text(self.longest_m)}m", f"n={self.n}")
        return {
            metric_name("drift_percent", *protocol): self.percent,
            metric_name("drift_deg_per_m", *protocol): self.deg_per_m,
        }


def between(poses_a: Floats, poses_b: Floats) -> Floats:
    """Return the poses b as seen from the poses a, row by row, (N, 3); headings wrapped."""
    cos, sin = np.cos(poses_a[:, 2]), np.sin(poses_a[:, 2])
    dx, dy = (poses_b[:, :2] - poses_a[:, :2]).T
    return np.stack([cos * dx + sin * dy, cos * dy - sin * dx, wrap_angles(poses_b[:, 2] - poses_a[:, 2])], axis=1)


def relative_error(pairs: Pairs, delta: float, unit: Literal["m", "s"]) -> RelativeError | None:
    """Return the relative pose error over a distance or time; None where no two poses are that far apart.

    ``E_ij = (g_i^-1 g_j)^-1 (e_i^-1 e_j)`` for all i, with j the pose nearest to `delta` after i along the true way
    (Sturm et al. 2012, Eq. 4-6). It needs no alignment.

    Parameters
    ----------
    pairs : Pairs
        Estimated and true poses at equal stamps.
    delta : float
        Way between the two poses of a pair [m], or time [s].
    unit : {"m", "s"}
        Whether `delta` is a way or a time.

    Returns
    -------
    RelativeError or None
        Summaries of the differences in position and heading.

    Raises
    ------
    ConfigError
        If the delta is not positive.
    """
    first, last, _ = _pieces(pairs, delta, unit)
    if len(first) == 0:
        return None
    errors = _errors(pairs, first, last)
    lengths = np.linalg.norm(errors[:, :2], axis=1)
    return RelativeError(delta, unit, len(first), summarize(lengths), summarize(errors[:, 2]))


def default_distance_m(length_m: float) -> float | None:
    """Return the 1-2-5 number at or below a tenth of a way; None for no way [m]."""
    tenth = length_m / 10.0
    if not tenth > 0.0:
        return None
    decade = 10.0 ** math.floor(math.log10(tenth))
    return max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= tenth * (1.0 + 1e-9))


def drift(pairs: Pairs, lengths_m: Sequence[float] | None = None) -> Drift | None:
    """Return the mean error per length of way; None where the way is too short.

    As in the KITTI benchmark (Geiger et al. 2012): over pieces of eight lengths, from every pose.

    Parameters
    ----------
    lengths_m : sequence of float, optional
        Lengths of the pieces; default: 1 to 8 times `default_distance_m` of the true way [m].
    """
    if lengths_m is None:
        step = default_distance_m(pairs.truth.length_m())
        lengths_m = [] if step is None else [step * k for k in range(1, _N_DRIFT_LENGTHS + 1)]
    pieces = [(length, *_pieces(pairs, length, "m")) for length in lengths_m]
    found = [piece for piece in pieces if len(piece[1])]
    if not found:
        return None
    first, last, driven = (np.concatenate([piece[k] for piece in found]) for k in (1, 2, 3))
    errors = _errors(pairs, first, last)
    percent = 100.0 * float((np.linalg.norm(errors[:, :2], axis=1) / driven).mean())
    deg_per_m = math.degrees(float((np.abs(errors[:, 2]) / driven).mean()))
    return Drift(found[0][0], found[-1][0], len(first), percent, deg_per_m)


def _pieces(pairs: Pairs, delta: float, unit: Literal["m", "s"]) -> tuple[Indices, Indices, Floats]:
    if not delta > 0.0:
        raise ConfigError(f"a relative error needs a positive distance or time, not {delta} {unit}")
    along = pairs.truth.travelled_m() if unit == "m" else pairs.truth.stamps_s
    target = along + delta
    after = np.clip(np.searchsorted(along, target), 1, len(along) - 1)
    nearest = np.where(target - along[after - 1] < along[after] - target, after - 1, after)
    first = np.arange(len(along))
    apart = along[nearest] - along
    ends_inside = target <= along[-1] + _ROUNDING * delta
    good = ends_inside & (nearest > first) & (np.abs(apart - delta) <= _DELTA_TOLERANCE * delta)
    return first[good], nearest[good], apart[good]


def _errors(pairs: Pairs, first: Indices, last: Indices) -> Floats:
    truth, estimate = pairs.truth.poses, pairs.estimate.poses
    return between(between(truth[first], truth[last]), between(estimate[first], estimate[last]))
