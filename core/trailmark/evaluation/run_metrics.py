"""Metrics of a run from its folder, and ``metrics.json``."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from trailmark import paths
from trailmark.errors import DataError
from trailmark.evaluation.alignment import STATIC_M
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.evaluation.lateral import lateral_error
from trailmark.evaluation.naming import quantity_of
from trailmark.evaluation.path_file import PATH_FILE, write_path
from trailmark.evaluation.plugged import (
    JudgedEstimates,
    MetricFunction,
    PluggedMetric,
    as_plugged,
    declared_quantities,
    extra_metrics,
)
from trailmark.evaluation.run_evaluation import RunEvaluation, compared_span, evaluate_run_folder
from trailmark.evaluation.run_folder import FUSED, GROUND_TRUTH, RunFolder, read_run
from trailmark.evaluation.tracking import tracked_fraction
from trailmark.evaluation.trajectory_metrics import Protocol, evaluate
from trailmark.evaluation.warnings import run_warnings
from trailmark.geometry import Trajectory
from trailmark.writing import write_whole

__all__ = ["METRICS_FILE", "RunEvaluation", "evaluate_run", "evaluate_run_folder", "metrics_document", "write_metrics"]

METRICS_FILE = "metrics.json"
# Of what metrics say of estimates, what is said of the belief, too.
_OF_BELIEFS = ("silent", "silent_single")

Metrics = Mapping[str, PluggedMetric | MetricFunction]
Documents = dict[str, dict[str, Any]]


def evaluate_run(
    folder: str | Path,
    *,
    protocol: Protocol | None = None,
    metrics: Metrics | None = None,
    path: paths.Path | None = None,
    write: bool = True,
) -> dict[str, Any]:
    """Evaluate the folder of a run and write ``metrics.json`` beside its trajectories.

    Parameters
    ----------
    folder : path
        The run.
    protocol : Protocol, optional
        How to compare.
    metrics : mapping of str to PluggedMetric or function, optional
        Further metrics, as `metrics_of` gives them; a plain function is ``(estimate, truth) -> {name: number}``.
    path : trailmark.paths.Path, optional
        The taught path; with it the lateral errors of all trajectories, and of the truth, are told.
    write : bool
        False: only return.

    Returns
    -------
    dict
        What is written: ``reference``, ``errors`` (False: the numbers are differences), ``trajectories``,
        ``sources``, ``quantities`` (what metrics declared), ``problems``. A number that is not finite is None.

    Raises
    ------
    DataError
        If the folder is not that of a run, or cannot be written to.
    """
    evaluated = evaluate_run_folder(read_run(folder), protocol, path)
    if write:
        return write_metrics(evaluated, metrics=metrics, path=path)
    document: dict[str, Any] = _without_nan(metrics_document(evaluated, metrics=metrics, path=path))
    return document


def write_metrics(
    evaluated: RunEvaluation, *, metrics: Metrics | None = None, path: paths.Path | None = None
) -> dict[str, Any]:
    """Write ``metrics.json`` of a run that has been evaluated into its folder, and the taught path beside it.

    Parameters
    ----------
    evaluated : RunEvaluation
        As `evaluate_run_folder` returns it.
    metrics, path
        As for `evaluate_run`.

    Returns
    -------
    dict
        What is written, as from `evaluate_run`.

    Raises
    ------
    DataError
        If the folder cannot be written to.
    """
    folder = evaluated.run.path
    document: dict[str, Any] = _without_nan(metrics_document(evaluated, metrics=metrics, path=path))
    if path is not None:
        write_path(path, folder / PATH_FILE)
    _write(folder / METRICS_FILE, document)
    return document


def metrics_document(
    evaluated: RunEvaluation,
    *,
    metrics: Metrics | None = None,
    path: paths.Path | None = None,
) -> dict[str, Any]:
    """Return the content of ``metrics.json``; see `evaluate_run`.

    Parameters
    ----------
    evaluated : RunEvaluation
        As `evaluate_run_folder` returns it.
    metrics : Metrics or None
        Further metrics by name, besides the registered ones.
    path : Path or None
        The taught path, for offsets from it.

    Returns
    -------
    dict of str to Any
        Plain data: numbers, texts, lists and mappings.
    """
    problems = list(evaluated.run.problems)
    trajectories = {name: _trajectory(evaluated, name) for name in evaluated.run.trajectories}
    sources = {name: source.document() for name, source in evaluated.sources.items()}
    plugged = as_plugged(metrics)
    problems += _add_of_trajectories(trajectories, evaluated, plugged)
    problems += _add_of_estimates(sources, evaluated, plugged)
    problems += _add_of_beliefs(trajectories, evaluated, plugged)
    if evaluated.run.truth is not None:
        trajectories[GROUND_TRUTH] = _plain(evaluated.run.truth)
    if path is not None:
        _add_lateral(trajectories, evaluated, path)
    return {
        "reference": evaluated.reference,
        "errors": evaluated.has_truth,
        "align": evaluated.protocol.align,
        "map_frame": evaluated.map_frame.note,
        "truth": _truth_note(evaluated.run),
        "stands_still": _stands_still(evaluated),
        "warnings": [warning.document() for warning in run_warnings(evaluated.run)],
        "trajectories": trajectories,
        "sources": sources,
        "quantities": declared_quantities(plugged),
        "problems": problems,
    }


def _truth_note(run: RunFolder) -> str:
    """Return why a ground truth that there is was not used; empty where it was, or there is none."""
    if run.truth is None or len(run.truth) > 1:
        return ""
    poses = "no frame" if not len(run.truth) else "one frame"
    return (
        f"The source has a ground truth, but it covers {poses} of the run: its poses may be too far apart"
        " (max_truth_gap_s), or of another time (time_offset_s)"
    )


def _stands_still(evaluated: RunEvaluation) -> dict[str, Any] | None:
    """Return the figures of a robot that never moved: the baseline that a localizer must beat."""
    truth = evaluated.run.truth
    if not evaluated.has_truth or truth is None:
        return None
    start_s, stop_s = compared_span(evaluated.run, truth)
    within = truth.between(start_s, stop_s)
    if len(within) < 2 or within.length_m() < STATIC_M:
        return None
    still = Trajectory(within.stamps_s, np.tile(within.poses[:1], (len(within), 1)))
    try:
        found = evaluate(still, within, replace(evaluated.protocol, align="origin"))
    except DataError:
        return None
    return found.document() | {"is_floor": True}


def _add_of_trajectories(
    trajectories: Documents, evaluated: RunEvaluation, metrics: Sequence[PluggedMetric]
) -> list[str]:
    """Add what metrics say of the trajectories, and return what went wrong."""
    problems = []
    for name, evaluation in evaluated.evaluations.items():
        numbers, complaints = extra_metrics({metric.name: metric for metric in metrics}, evaluation)
        trajectories[name]["metrics"].update(numbers)
        problems += [f"{name}: {complaint}" for complaint in complaints]
    return problems


def _add_of_estimates(sources: Documents, evaluated: RunEvaluation, metrics: Sequence[PluggedMetric]) -> list[str]:
    """Add what metrics say of the localizers' estimates, and return what went wrong."""
    estimates = evaluated.run.estimates
    told = {} if estimates is None else {name: estimates.of(name) for name in sources}
    return _add_judged(sources, told, evaluated, metrics)


def _add_of_beliefs(trajectories: Documents, evaluated: RunEvaluation, metrics: Sequence[PluggedMetric]) -> list[str]:
    """Add which beliefs were silently wrong, judged as poses of a localizer; when it answered is not for it to say."""
    beliefs = evaluated.run.beliefs
    if beliefs is None or not len(beliefs) or FUSED not in trajectories or not evaluated.has_truth:
        return []
    judged: Documents = {FUSED: {"metrics": {}}}
    problems = _add_judged(judged, {FUSED: beliefs.as_fixes(FUSED)}, evaluated, metrics)
    found = judged[FUSED]["metrics"].items()
    trajectories[FUSED]["metrics"] |= {name: value for name, value in found if quantity_of(name) in _OF_BELIEFS}
    return problems


def _add_judged(
    documents: Documents,
    told: Mapping[str, EstimateTable],
    evaluated: RunEvaluation,
    metrics: Sequence[PluggedMetric],
) -> list[str]:
    problems = []
    judging = [metric for metric in metrics if metric.judges == "estimates"]
    truth = evaluated.run.truth if evaluated.has_truth else None
    for name, table in told.items():
        judged = JudgedEstimates(table, truth, evaluated.map_frame, evaluated.path)
        for metric in judging:
            numbers, complaints = metric.numbers(judged)
            documents[name]["metrics"].update(numbers)
            problems += [f"{name}: {complaint}" for complaint in complaints]
    return problems


def _trajectory(evaluated: RunEvaluation, name: str) -> dict[str, Any]:
    document = _plain(evaluated.run.trajectories[name])
    if name in evaluated.evaluations:
        document.update(evaluated.evaluations[name].document())
        document["metrics"] = dict(document["metrics"])
    elif (span := evaluated.run.span_s()) is not None and span[1] > span[0]:
        document["metrics"] = tracked_fraction(evaluated.run.trajectories[name], *span).metrics()
    if name in evaluated.problems:
        document["problem"] = evaluated.problems[name]
    return document


def _plain(trajectory: Trajectory) -> dict[str, Any]:
    return {"poses": len(trajectory), "length_m": trajectory.length_m(), "metrics": {}}


def _add_lateral(trajectories: dict[str, dict[str, Any]], evaluated: RunEvaluation, path: paths.Path) -> None:
    known = dict(evaluated.run.trajectories)
    if (truth := evaluated.truth_beside_path()) is not None:
        known[GROUND_TRUTH] = truth
    for name, trajectory in known.items():
        if len(trajectory):
            trajectories[name]["metrics"].update(lateral_error(trajectory, path).metrics())


def _write(path: Path, document: Mapping[str, Any]) -> None:
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    try:
        write_whole(path, text + "\n")
    except OSError as error:
        raise DataError(f"cannot write {path}: {error.strerror or error}") from error


def _without_nan(value: Any) -> Any:
    """Return the document with null for numbers that JSON does not have."""
    if isinstance(value, Mapping):
        return {str(key): _without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
