"""Metrics that plugins bring, ours among them: what they are given, what they are called, what goes wrong with them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from trailmark.errors import TrailmarkError
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.evaluation.map_frame import ONE_FRAME, MapFrame
from trailmark.evaluation.naming import quantity_of
from trailmark.evaluation.trajectory_metrics import Evaluation
from trailmark.geometry import Trajectory
from trailmark.metrics import Judged, MetricSpec
from trailmark.paths import Path

if TYPE_CHECKING:
    from trailmark.plugins import Registry

__all__ = [
    "JudgedEstimates",
    "MetricFunction",
    "PluggedMetric",
    "as_plugged",
    "declared_quantities",
    "extra_metrics",
    "metrics_of",
]

#: What a ``metric`` plugin points at: paired, aligned trajectories of equal stamps in, named numbers out; or, where it
#: judges estimates, a `JudgedEstimates` in.
MetricFunction = Callable[..., Mapping[str, float]]


@dataclass(frozen=True, slots=True, eq=False)
class JudgedEstimates:
    """What a metric that judges estimates is given of each localizer.

    Attributes
    ----------
    estimates : EstimateTable
        Every estimate of the localizer as it told it, `Lost` included.
    truth : Trajectory or None
        Where base really was; None where that is not known.
    map_frame : MapFrame
        How the map lies in the frame of the truth.
    path : Path or None
        The taught path, which path offsets are about.
    """

    estimates: EstimateTable
    truth: Trajectory | None = None
    map_frame: MapFrame = ONE_FRAME
    path: Path | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PluggedMetric:
    """A registered metric.

    Attributes
    ----------
    name : str
        As it was registered.
    function : callable
        See `MetricFunction`.
    judges : {"trajectory", "estimates"}
        What it is given.
    quantities : tuple of MetricSpec
        What it declared of its numbers, by their full names.
    """

    name: str
    function: MetricFunction
    judges: Judged = "trajectory"
    quantities: tuple[MetricSpec, ...] = ()

    def numbers(self, *given: Any) -> tuple[dict[str, float], list[str]]:
        """Return its numbers by full name, and a line for each failure; a failing metric does not affect others."""
        try:
            found = {self._full(key): float(value) for key, value in self.function(*given).items()}
        except TrailmarkError as error:
            return {}, [f"metric '{self.name}': {error}"]
        except Exception as error:
            return {}, [f"metric '{self.name}' raised {type(error).__name__}: {error}"]
        return found, []

    def _full(self, key: str) -> str:
        """Return ``metric.key``; a quantity that was declared by this very name stays as it is."""
        declared = {spec.name for spec in self.quantities}
        return key if quantity_of(key) in declared else f"{self.name}.{key}"


def metrics_of(registry: Registry) -> dict[str, PluggedMetric]:
    """Return the registered metrics by name; each is imported.

    Parameters
    ----------
    registry : Registry
        Where plugins have registered their metrics.

    Returns
    -------
    dict of str to PluggedMetric
        Functions with their declared quantities.
    """
    return {
        spec.name: PluggedMetric(spec.name, spec.load(), spec.judges, spec.quantities)
        for spec in registry.specs("metric")
    }


def as_plugged(metrics: Mapping[str, PluggedMetric | MetricFunction] | None) -> list[PluggedMetric]:
    """Return metrics as `metrics_of` gives them; a plain function judges trajectories."""
    given = (metrics or {}).items()
    return [item if isinstance(item, PluggedMetric) else PluggedMetric(name, item) for name, item in given]


def extra_metrics(
    extra: Mapping[str, PluggedMetric | MetricFunction], evaluation: Evaluation
) -> tuple[dict[str, float], list[str]]:
    """Return what metrics say of a trajectory, by full name, and what went wrong, a line each.

    Each is given the pairs after the alignment that was used: equal stamps, one frame. A metric that raises loses
    its own numbers only; one that judges estimates has none here.

    Parameters
    ----------
    extra : mapping of str to PluggedMetric or MetricFunction
        Metrics by name.
    evaluation : Evaluation
        Aligned pairs of one trajectory, and what else a metric may look at.

    Returns
    -------
    (dict of str to float, list of str)
        Numbers by full name, and a line for each metric that failed.
    """
    aligned = evaluation.absolute.alignment.apply(evaluation.pairs.estimate)
    numbers: dict[str, float] = {}
    problems: list[str] = []
    for metric in as_plugged(extra):
        if metric.judges == "trajectory":
            found, complaints = metric.numbers(aligned, evaluation.pairs.truth)
            numbers |= found
            problems += complaints
    return numbers, problems


def declared_quantities(metrics: Iterable[PluggedMetric]) -> dict[str, Any]:
    """Return what metrics declared, by full name, as plain data for ``metrics.json``."""
    return {spec.name: spec.document() for metric in metrics for spec in metric.quantities}
