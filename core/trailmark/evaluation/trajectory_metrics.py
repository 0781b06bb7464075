"""All metrics of one trajectory against another."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from trailmark.evaluation.absolute import AbsoluteError, EndError, absolute_error, end_error
from trailmark.evaluation.alignment import ALIGNMENTS, AlignKind, align
from trailmark.evaluation.association import Interpolate, Pairs, associate
from trailmark.evaluation.naming import quantity_of
from trailmark.evaluation.quantities import spec_of
from trailmark.evaluation.relative import Drift, RelativeError, default_distance_m, drift, relative_error
from trailmark.evaluation.tracking import Tracked, tracked_fraction
from trailmark.geometry import Trajectory

__all__ = ["Evaluation", "Protocol", "evaluate"]


@dataclass(frozen=True, slots=True)
class Protocol:
    """How trajectories are compared. The defaults fit most runs; results carry what was used.

    Attributes
    ----------
    align : {"se2", "origin", "none"}
        Alignment of the absolute errors.
    max_difference_s, interpolate
        As in `associate`.
    rpe_distances_m : tuple of float or None
        Distances of the relative errors; None: `default_distance_m` of the true way [m].
    rpe_times_s : tuple of float
        Times of the relative errors [s].
    """

    align: AlignKind = "se2"
    max_difference_s: float | None = None
    interpolate: Interpolate = "auto"
    rpe_distances_m: tuple[float, ...] | None = None
    rpe_times_s: tuple[float, ...] = (1.0,)


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """One trajectory compared with another.

    Attributes
    ----------
    n_poses : int
        Poses of the estimate, paired or not.
    length_m : float
        Way of the estimate [m].
    pairs : Pairs
        What was compared.
    absolute : AbsoluteError
        After the alignment that was asked for.
    other_alignments : tuple of AbsoluteError
        The same after the others.
    end : EndError
        Of the last pair.
    relative : tuple of RelativeError
        Over each distance and time for which there were pairs.
    drift : Drift or None
        None where the way is too short.
    tracked : Tracked
        Share of time.
    against_truth : bool
        False when the reference is itself an estimate: then these are differences, not errors.
    """

    n_poses: int
    length_m: float
    pairs: Pairs
    absolute: AbsoluteError
    other_alignments: tuple[AbsoluteError, ...]
    end: EndError
    relative: tuple[RelativeError, ...]
    drift: Drift | None
    tracked: Tracked
    against_truth: bool = True

    def __repr__(self) -> str:
        kind = "error" if self.against_truth else "difference"
        absolute, end = self.absolute, self.end
        return (
            f"Evaluation({self.n_poses} poses, {self.length_m:.4g} m; {kind} rmse {absolute.position.rmse:.4g} m,"
            f" {math.degrees(absolute.heading.rmse):.4g} deg after {absolute.alignment.used};"
            f" end {end.position_m:.4g} m off; metrics() has all)"
        )

    def metrics(self) -> dict[str, float]:
        """Return all metrics by name; against another estimate they are called differences.

        Against another estimate nothing is an error, and nothing says which of the two drifts.
        """
        parts = [self.absolute, self.tracked, *self.relative, self.drift, self.end, *self.other_alignments]
        merged: dict[str, float] = {}
        for part in parts:
            for name, value in (part.metrics() if part else {}).items():
                merged.setdefault(name, value)
        return merged if self.against_truth else _as_differences(merged)

    def document(self) -> dict[str, object]:
        """Return everything but the poses, for ``metrics.json``."""
        return {
            "poses": self.n_poses,
            "length_m": self.length_m,
            "alignment": self.absolute.alignment.document(),
            "association": self.pairs.document(),
            "metrics": self.metrics(),
        }


def evaluate(
    estimate: Trajectory,
    truth: Trajectory,
    protocol: Protocol | None = None,
    *,
    span_s: tuple[float, float] | None = None,
    against_truth: bool = True,
) -> Evaluation:
    """Compare an estimate with the truth, or with another estimate.

    Parameters
    ----------
    estimate, truth : Trajectory
        Stamps of one clock.
    protocol : Protocol, optional
        How.
    span_s : (float, float), optional
        The time that should have been tracked; default: the time that `truth` covers [s].
    against_truth : bool
        False when `truth` is only a reference.

    Raises
    ------
    DataError
        If one is empty or too short, or they have no stamps in common.
    """
    protocol = protocol or Protocol()
    pairs = associate(estimate, truth, max_difference_s=protocol.max_difference_s, interpolate=protocol.interpolate)
    others = [kind for kind in ALIGNMENTS if kind != protocol.align]
    start_s, stop_s = span_s or (float(truth.stamps_s[0]), float(truth.stamps_s[-1]))
    return Evaluation(
        n_poses=len(estimate),
        length_m=estimate.length_m(),
        pairs=pairs,
        absolute=absolute_error(pairs, align(pairs, protocol.align)),
        other_alignments=tuple(absolute_error(pairs, align(pairs, kind)) for kind in others),
        end=end_error(pairs, align(pairs, "none" if protocol.align == "none" else "origin")),
        relative=_relative_errors(pairs, truth, protocol),
        drift=drift(pairs),
        tracked=tracked_fraction(estimate, start_s, stop_s),
        against_truth=against_truth,
    )


def _relative_errors(pairs: Pairs, truth: Trajectory, protocol: Protocol) -> tuple[RelativeError, ...]:
    distances_m: Sequence[float] | None = protocol.rpe_distances_m
    if distances_m is None:  # of the whole truth, so that all estimates of a run share the distance
        default_m = default_distance_m(truth.length_m())
        distances_m = [] if default_m is None else [default_m]
    found = [relative_error(pairs, delta, "m") for delta in distances_m]
    found += [relative_error(pairs, delta, "s") for delta in protocol.rpe_times_s]
    return tuple(item for item in found if item is not None)


def _as_differences(metrics: Mapping[str, float]) -> dict[str, float]:
    renamed: dict[str, float] = {}
    for name, value in metrics.items():
        quantity = quantity_of(name)
        difference = spec_of(quantity).as_difference()
        if difference is not None:
            renamed[difference.name + name.removeprefix(quantity)] = value
    return renamed
