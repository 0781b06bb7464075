"""Metrics of a run from its folder, and ``metrics.json``."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from trailmark import paths
from trailmark.errors import DataError
from trailmark.evaluation.alignment import STATIC_M
from trailmark.evaluation.estimate_errors import true_poses
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.evaluation.lateral import lateral_error
from trailmark.evaluation.map_frame import ONE_FRAME, MapFrame, find_map_frame
from trailmark.evaluation.path_file import PATH_FILE, write_path
from trailmark.evaluation.plugged import (
    JudgedEstimates,
    MetricFunction,
    PluggedMetric,
    as_plugged,
    declared_quantities,
    extra_metrics,
)
from trailmark.evaluation.run_folder import FUSED, GROUND_TRUTH, RunFolder, read_run
from trailmark.evaluation.source_statistics import SourceStatistics, source_statistics
from trailmark.evaluation.taught_places import BentMapFrame, bent_map_frame, said_places, with_unknown_error
from trailmark.evaluation.tracking import tracked_fraction
from trailmark.evaluation.trajectory_metrics import Evaluation, Protocol, evaluate
from trailmark.evaluation.warnings import run_warnings
from trailmark.geometry import Pose2, Trajectory
from trailmark.writing import write_whole

__all__ = ["METRICS_FILE", "RunEvaluation", "evaluate_run", "evaluate_run_folder", "metrics_document", "write_metrics"]

METRICS_FILE = "metrics.json"

Metrics = Mapping[str, PluggedMetric | MetricFunction]
Documents = dict[str, dict[str, Any]]


@dataclass(frozen=True, slots=True, eq=False)
class RunEvaluation:
    """The trajectories of a run compared with the truth, or with one of them.

    Attributes
    ----------
    run : RunFolder
        What was read.
    protocol : Protocol
        How it was compared.
    reference : str or None
        ``groundtruth``; without it ``fused`` or the first localizer; None when there is nothing to compare with.
    evaluations : mapping of str to Evaluation
        By trajectory; without the reference and without those that could not be compared.
    sources : mapping of str to SourceStatistics
        By localizer, where the run has ``estimates.csv``.
    problems : mapping of str to str
        Why a trajectory could not be compared.
    map_frame : MapFrame
        How the map lies in the frame of the truth.
    path : Path or None
        The taught path that path offsets are about.
    """

    run: RunFolder
    protocol: Protocol
    reference: str | None
    evaluations: Mapping[str, Evaluation]
    sources: Mapping[str, SourceStatistics]
    problems: Mapping[str, str]
    map_frame: MapFrame = ONE_FRAME
    path: paths.Path | None = None

    @property
    def has_truth(self) -> bool:
        """True when the numbers are errors; False when they are differences."""
        return self.reference == GROUND_TRUTH

    def truth_beside_path(self) -> Trajectory | None:
        """Return the true trajectory to be compared with the taught path: as seen from a map that is bent."""
        truth = self.run.truth
        if truth is None or not isinstance(self.map_frame, BentMapFrame):
            return truth
        return Trajectory(truth.stamps_s, self.map_frame.in_map(truth.poses))


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


def evaluate_run_folder(
    run: RunFolder, protocol: Protocol | None = None, path: paths.Path | None = None
) -> RunEvaluation:
    """Compare the trajectories of a run with its ground truth, or without it with one of them.

    The taught path is the one that the run left in its folder, unless another is given.

    Parameters
    ----------
    run : RunFolder
        The run, as `read_run` returns it.
    protocol : Protocol or None
        Alignment, distances and gaps; None: the defaults of `Protocol`.
    path : Path or None
        The taught path, for offsets from it; None: the one in the run's folder, if any.

    Returns
    -------
    RunEvaluation
        Errors of the fused trajectory and of each localizer's own.
    """
    protocol, path = protocol or Protocol(), path or run.path_taught
    reference = _reference(run)
    truth = run.truth if reference == GROUND_TRUTH else run.trajectories.get(reference or "")
    evaluations: dict[str, Evaluation] = {}
    problems: dict[str, str] = {}
    for name, trajectory in run.trajectories.items():
        if truth is None or name == reference:
            continue
        try:
            evaluations[name] = evaluate(
                trajectory, truth, protocol, span_s=_span(run, truth), against_truth=reference == GROUND_TRUTH
            )
        except DataError as error:
            problems[name] = str(error)
    known = run.truth if reference == GROUND_TRUTH else None
    map_frame = ONE_FRAME if known is None or run.estimates is None else _map_frame(run, run.estimates, known, path)
    sources = _sources(run, known, map_frame, path)
    return RunEvaluation(run, protocol, reference, evaluations, sources, problems, map_frame, path)


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
    start_s, stop_s = _span(evaluated.run, truth)
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
    problems = []
    judging = [metric for metric in metrics if metric.judges == "estimates"]
    for name, document in sources.items():
        judged = _judged_estimates(evaluated, name)
        for metric in judging:
            numbers, complaints = metric.numbers(judged)
            document["metrics"].update(numbers)
            problems += [f"{name}: {complaint}" for complaint in complaints]
    return problems


def _judged_estimates(evaluated: RunEvaluation, name: str) -> JudgedEstimates:
    assert evaluated.run.estimates is not None
    truth = evaluated.run.truth if evaluated.has_truth else None
    return JudgedEstimates(evaluated.run.estimates.of(name), truth, evaluated.map_frame, evaluated.path)


def _reference(run: RunFolder) -> str | None:
    if run.truth is not None and len(run.truth) > 1:
        return GROUND_TRUTH
    names = [FUSED, *run.trajectories]
    return next((name for name in names if len(run.trajectories.get(name, ())) > 1), None)


def _span(run: RunFolder, reference: Trajectory) -> tuple[float, float]:
    """Return the time of the run that the reference covers: a recording may be longer than the run."""
    first_s, last_s = float(reference.stamps_s[0]), float(reference.stamps_s[-1])
    span = run.span_s()
    if span is None or not max(first_s, span[0]) < min(last_s, span[1]):
        return first_s, last_s
    return max(first_s, span[0]), min(last_s, span[1])


def _sources(
    run: RunFolder, truth: Trajectory | None, map_frame: MapFrame, path: paths.Path | None
) -> dict[str, SourceStatistics]:
    if run.estimates is None:
        return {}
    spoke = run.estimates.sources()
    names = [name for name in run.trajectories if name in spoke]
    names += [name for name in spoke if name not in names]
    fused = run.trajectories.get(FUSED)
    return {name: source_statistics(run.estimates.of(name), truth, map_frame, path, fused) for name in names}


def _map_frame(run: RunFolder, estimates: EstimateTable, truth: Trajectory, path: paths.Path | None) -> MapFrame:
    """Return how the map lies in the frame of the truth.

    A taught map lies there as its teaching did, where that is known; otherwise all fixes and where the belief began
    tell it.
    """
    fixes = estimates.where((estimates.kind == "fix") & (estimates.outcome != "refused"))
    there = true_poses(truth, fixes.stamp_s)
    known = np.isfinite(there).all(axis=1) & np.isfinite(fixes.numbers).all(axis=1)
    plain = find_map_frame(fixes.numbers[known], there[known], _start(run, truth))
    if run.true_places is None:
        return with_unknown_error(plain, fixes.numbers[known], there[known]) if _is_replay(run) else plain
    return bent_map_frame(run.true_places, plain, *said_places(estimates, truth, path))


def _is_replay(run: RunFolder) -> bool:
    return run.run.get("mode") == "replay"


def _start(run: RunFolder, truth: Trajectory) -> tuple[Pose2, Pose2] | None:
    """Return the first pose of the belief for which the truth is known, and the true one."""
    believed = run.trajectories.get(FUSED)
    if believed is None or not len(believed):
        return None
    true = true_poses(truth, believed.stamps_s)
    known = np.flatnonzero(np.isfinite(true).all(axis=1))
    return (believed[int(known[0])][1], Pose2.from_array(true[known[0]])) if len(known) else None


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
