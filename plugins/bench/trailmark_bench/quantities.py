"""The quantities of the tables: which way each is better, and where a cell has it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from trailmark.errors import ConfigError
from trailmark.evaluation import QUANTITIES, find_metric, quantities_of, spec_of
from trailmark.metrics import Better, MetricSpec
from trailmark.plugins.hints import nearest_or_all
from trailmark_bench.index import CellRecord

__all__ = ["Metric", "metric_of", "metrics_of", "refuse_unknown"]

_OF_PROCESS = ("wall_s", "cpu_s", "peak_rss_mb")
# What a bench measures besides what a run's folder says.
_OF_BENCH = (
    MetricSpec("frames_per_s", "1/s", "higher", "nothing"),
    MetricSpec("call_ms_per_m", "ms/m", "lower", "nothing", "cost"),
    MetricSpec("belief_silent", "share"),
)


@dataclass(frozen=True, slots=True)
class Metric:
    """A quantity of the tables.

    Attributes
    ----------
    spec : MetricSpec
        What was declared of it; its name is as in ``metrics.json``, without its protocol: ``ate_rmse_m``.
    """

    spec: MetricSpec

    @property
    def name(self) -> str:
        """Its name, without its protocol."""
        return self.spec.name

    @property
    def better(self) -> Better:
        """Which way is better."""
        return self.spec.better

    @property
    def is_of_machine(self) -> bool:
        """Whether it was measured with a clock or a meter: it differs each time, whatever the seed."""
        return self.name in (*_OF_PROCESS, "run_s", "frames_per_s") or self.name.startswith("call_")

    def oriented(self, value: float) -> float:
        """Return a number that is lower where the value is better; of a failure infinity."""
        return self.spec.oriented(value)

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


def metric_of(name: str, declared: Sequence[MetricSpec] = QUANTITIES) -> Metric:
    """Return the quantity of a name."""
    return Metric(spec_of(name, (*declared, *_OF_BENCH)))


def metrics_of(names: Sequence[str], records: Sequence[CellRecord]) -> tuple[Metric, ...]:
    """Return the quantities of some names; where no cell has a ground truth, the differences that stand for errors."""
    finished = [record.result for record in records if record.state == "ok"]
    has_truth = not finished or any(result.get("errors") for result in finished)
    metrics = [metric_of(name, quantities_of(finished)) for name in names]
    differences = [metric.spec.as_difference() for metric in metrics]
    return tuple(
        metric if has_truth or difference is None else Metric(difference)
        for metric, difference in zip(metrics, differences, strict=True)
    )


def refuse_unknown(asked: Sequence[str], metrics: Sequence[Metric], records: Sequence[CellRecord]) -> None:
    """Refuse a quantity on the command line that no cell has.

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
