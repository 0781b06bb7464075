"""Absolute trajectory error, and the error at the end."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import DataError
from trailmark.evaluation.alignment import Alignment
from trailmark.evaluation.association import Pairs
from trailmark.evaluation.naming import metric_name
from trailmark.geometry import wrap_angles

__all__ = ["AbsoluteError", "EndError", "Summary", "absolute_error", "absolute_errors", "end_error", "summarize"]


@dataclass(frozen=True, slots=True)
class Summary:
    """Root mean square, mean, median and maximum of non-negative numbers, in their own unit.

    Attributes
    ----------
    rmse, mean, median, max : float
        Of the absolute values.
    """

    rmse: float
    mean: float
    median: float
    max: float

    def metrics(self, stem: str, unit: str, *protocol: str, scale: float = 1.0) -> dict[str, float]:
        """Return the four numbers by the metric names ``stem_rmse_unit[protocol]`` and so on."""
        values = {"rmse": self.rmse, "mean": self.mean, "median": self.median, "max": self.max}
        return {metric_name(f"{stem}_{name}_{unit}", *protocol): scale * value for name, value in values.items()}


def summarize(values: Floats) -> Summary:
    """Return the summary of (N,) numbers.

    Parameters
    ----------
    values : (N,) float64
        The numbers, in any unit.

    Returns
    -------
    Summary
        Root mean square, mean, median and maximum of the absolute values, in that unit.

    Raises
    ------
    DataError
        If there is none.
    """
    if len(values) == 0:
        raise DataError("there is nothing to summarize: 0 values")
    absolute = np.abs(values)
    rmse = math.sqrt(float((absolute * absolute).mean()))
    return Summary(rmse, float(absolute.mean()), float(np.median(absolute)), float(absolute.max()))


@dataclass(frozen=True, slots=True)
class AbsoluteError:
    """Absolute trajectory error (ATE) after an alignment.

    Attributes
    ----------
    alignment : Alignment
        The one that was used.
    n : int
        Number of pairs.
    position : Summary
        Of the distances [m].
    heading : Summary
        Of the absolute heading errors [rad].
    """

    alignment: Alignment
    n: int
    position: Summary
    heading: Summary

    def metrics(self) -> dict[str, float]:
        """Return the metrics by name: metres and degrees."""
        protocol = (self.alignment.used, f"n={self.n}")
        return {
            **self.position.metrics("ate", "m", *protocol),
            **self.heading.metrics("ate_heading", "deg", *protocol, scale=math.degrees(1.0)),
        }


def absolute_errors(pairs: Pairs, alignment: Alignment) -> tuple[Floats, Floats]:
    """Return the distance and the signed heading error of every pair, (N,) [m] and (N,) [rad].

    Parameters
    ----------
    pairs : Pairs
        Estimated and true poses at equal stamps.
    alignment : Alignment
        Takes the estimate to the frame of the truth.

    Returns
    -------
    ((N,) float64, (N,) float64)
        Distances [m], and headings of the estimate minus the true ones, wrapped to [-pi, pi) [rad].
    """
    aligned = alignment.apply(pairs.estimate)
    distances = np.linalg.norm(aligned.positions - pairs.truth.positions, axis=1)
    return distances, wrap_angles(aligned.headings - pairs.truth.headings)


def absolute_error(pairs: Pairs, alignment: Alignment) -> AbsoluteError:
    """Return the absolute trajectory error after an alignment.

    Parameters
    ----------
    pairs : Pairs
        Estimated and true poses at equal stamps.
    alignment : Alignment
        Takes the estimate to the frame of the truth.

    Returns
    -------
    AbsoluteError
        Summaries of distances [m] and headings [rad].
    """
    distances, turns = absolute_errors(pairs, alignment)
    return AbsoluteError(alignment, len(pairs), summarize(distances), summarize(turns))


@dataclass(frozen=True, slots=True)
class EndError:
    """How far the last pose is off.

    Attributes
    ----------
    alignment : Alignment
        "origin", or "none": an alignment that has seen the end would hide its error.
    position_m : float
        Distance of the last pair [m].
    heading_rad : float
        Signed heading error of the last pair [rad].
    length_m : float
        True way driven between the first pair and the last [m].
    """

    alignment: Alignment
    position_m: float
    heading_rad: float
    length_m: float

    def metrics(self) -> dict[str, float]:
        """Return the metrics by name; the share of the way only where there was one."""
        protocol = self.alignment.used
        metrics = {
            metric_name("end_error_m", protocol): self.position_m,
            metric_name("end_heading_error_deg", protocol): abs(math.degrees(self.heading_rad)),
        }
        if self.length_m > 0.0:
            metrics[metric_name("end_error_percent", protocol)] = 100.0 * self.position_m / self.length_m
        return metrics


def end_error(pairs: Pairs, alignment: Alignment) -> EndError:
    """Return the error of the last pair after an alignment.

    Parameters
    ----------
    pairs : Pairs
        Estimated and true poses at equal stamps.
    alignment : Alignment
        Takes the estimate to the frame of the truth.

    Returns
    -------
    EndError
        Distance and heading error at the last stamp, and the way that the truth covers.
    """
    distances, turns = absolute_errors(pairs, alignment)
    return EndError(alignment, float(distances[-1]), float(turns[-1]), pairs.truth.length_m())
