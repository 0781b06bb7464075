"""The quantities of the tables: which way each is better, and where a cell has it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from trailmark.errors import ConfigError
from trailmark.evaluation import find_metric
from trailmark.plugins.hints import nearest_or_all
from trailmark_bench.index import CellRecord

__all__ = ["Metric", "metric_of", "metrics_of", "refuse_unknown"]

_HIGHER = ("tracked_fraction", "frames_per_s")
_NEAR_ONE = ("nees_per_dof", "nis_per_dof")
_OF_PROCESS = ("wall_s", "cpu_s", "peak_rss_mb")

# Without ground truth there are differences, and they have names of their own.
_DIFFERENCES = {
    "ate_rmse_m": "difference_rmse_m",
    "ate_max_m": "difference_max_m",
    "ate_heading_rmse_deg": "difference_heading_rmse_deg",
    "rpe_rmse_m": "relative_difference_rmse_m",
    "end_error_m": "end_difference_m",
}


@dataclass(frozen=True, slots=True)
class Metric:
    """A quantity of the tables.

    Attributes
    ----------
    name : str
        As in ``metrics.json``, without its protocol: ``ate_rmse_m``.
    better : {"lower", "higher", "near one"}
        Which way is better.
    """

    name: str
    better: Literal["lower", "higher", "near one"] = "lower"

    def oriented(self, value: float) -> float:
        """Return a number that is lower where the value is better; of a failure infinity."""
        if not math.isfinite(value):
            return math.inf
        if self.better == "higher":
            return -value
        if self.better == "near one":
            return abs(math.log(value)) if value > 0 else math.inf
        return value

    def value_of(self, record: CellRecord) -> float | None:
        """Return the value of a cell; None where it was not measured."""
        if self.name in _OF_PROCESS:
            found = getattr(record, self.name)
            return None if found is None else float(found)
        times = record.result.get("times", {})
        if self.name in times:
            return float(times[self.name])
        metrics = record.result.get("metrics", {})
        alignment = record.result.get("alignment")
        value = find_metric(metrics, self.name, *([alignment] if alignment else []))
        return find_metric(metrics, self.name) if value is None else value


def metric_of(name: str) -> Metric:
    """Return the quantity of a name."""
    return Metric(name, "higher" if name in _HIGHER else "near one" if name in _NEAR_ONE else "lower")


def metrics_of(names: Sequence[str], records: Sequence[CellRecord]) -> tuple[Metric, ...]:
    """Return the quantities of some names; where no cell has a ground truth, the differences that stand for errors."""
    return tuple(metric_of(_named(name, records)) for name in names)


def _named(name: str, records: Sequence[CellRecord]) -> str:
    """Return the name of a quantity, or of the difference that stands for it where no cell has a ground truth."""
    finished = [record for record in records if record.state == "ok"]
    other = _DIFFERENCES.get(name)
    has_truth = any(record.result.get("errors") for record in finished)
    return other if other is not None and finished and not has_truth else name


def refuse_unknown(asked: Sequence[str], metrics: Sequence[Metric], records: Sequence[CellRecord]) -> None:
    """Refuse a quantity that somebody asked for and no cell has.

    Raises
    ------
    ConfigError
        With the names that there are.
    """
    finished = [record for record in records if record.state == "ok"]
    for name, metric in zip(asked, metrics, strict=True):
        if finished and all(metric.value_of(record) is None for record in finished):
            known = {key.partition("[")[0] for record in finished for key in record.result.get("metrics", {})}
            known |= {key for record in finished for key in record.result.get("times", {})} | set(_OF_PROCESS)
            raise ConfigError(f"no cell has a metric {name!r}{nearest_or_all(name, sorted(known), 'metrics')}")
