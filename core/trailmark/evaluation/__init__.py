"""Metrics of planar trajectories: errors against ground truth, differences without it, consistency."""

from trailmark.evaluation.absolute import (
    AbsoluteError,
    EndError,
    Summary,
    absolute_error,
    absolute_errors,
    end_error,
    summarize,
)
from trailmark.evaluation.alignment import ALIGNMENTS, AlignKind, Alignment, align
from trailmark.evaluation.association import Pairs, associate
from trailmark.evaluation.consistency import Consistency, chi2_quantile, consistency_of, nees
from trailmark.evaluation.counter_warnings import collisions_of
from trailmark.evaluation.estimates_table import OUTCOMES, EstimateTable, read_estimates
from trailmark.evaluation.latency import Percentiles, percentiles
from trailmark.evaluation.lateral import LateralError, lateral_error, offsets_from_path
from trailmark.evaluation.naming import find_metric, metric_name, quantity_of
from trailmark.evaluation.plugged import JudgedEstimates, MetricFunction, PluggedMetric, extra_metrics, metrics_of
from trailmark.evaluation.quantities import QUANTITIES, quantities_of, spec_of
from trailmark.evaluation.relative import Drift, RelativeError, drift, relative_error
from trailmark.evaluation.run_folder import FUSED, GROUND_TRUTH, RunFolder, read_run
from trailmark.evaluation.run_metrics import (
    RunEvaluation,
    evaluate_run,
    evaluate_run_folder,
    metrics_document,
    write_metrics,
)
from trailmark.evaluation.run_warning import RunWarning
from trailmark.evaluation.source_statistics import SourceStatistics, source_statistics
from trailmark.evaluation.tracking import Tracked, tracked_fraction
from trailmark.evaluation.trajectory_metrics import Evaluation, Protocol, evaluate
from trailmark.evaluation.warnings import run_warnings

__all__ = [
    "ALIGNMENTS",
    "FUSED",
    "GROUND_TRUTH",
    "OUTCOMES",
    "QUANTITIES",
    "AbsoluteError",
    "AlignKind",
    "Alignment",
    "Consistency",
    "Drift",
    "EndError",
    "EstimateTable",
    "Evaluation",
    "JudgedEstimates",
    "LateralError",
    "MetricFunction",
    "Pairs",
    "Percentiles",
    "PluggedMetric",
    "Protocol",
    "RelativeError",
    "RunEvaluation",
    "RunFolder",
    "RunWarning",
    "SourceStatistics",
    "Summary",
    "Tracked",
    "absolute_error",
    "absolute_errors",
    "align",
    "associate",
    "chi2_quantile",
    "collisions_of",
    "consistency_of",
    "drift",
    "end_error",
    "evaluate",
    "evaluate_run",
    "evaluate_run_folder",
    "extra_metrics",
    "find_metric",
    "lateral_error",
    "metric_name",
    "metrics_document",
    "metrics_of",
    "nees",
    "offsets_from_path",
    "percentiles",
    "quantities_of",
    "quantity_of",
    "read_estimates",
    "read_run",
    "relative_error",
    "run_warnings",
    "source_statistics",
    "spec_of",
    "summarize",
    "tracked_fraction",
    "write_metrics",
]
