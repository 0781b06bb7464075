"""The trajectories and estimates of a run, compared with the truth or with one of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trailmark import paths
from trailmark.errors import DataError
from trailmark.evaluation.estimate_errors import true_poses
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.evaluation.map_frame import ONE_FRAME, MapFrame, find_map_frame, map_frame_of_start
from trailmark.evaluation.run_folder import FUSED, GROUND_TRUTH, RunFolder
from trailmark.evaluation.source_statistics import SourceStatistics, source_statistics
from trailmark.evaluation.taught_places import BentMapFrame, bent_map_frame, said_places, with_unknown_error
from trailmark.evaluation.trajectory_metrics import Evaluation, Protocol, evaluate
from trailmark.geometry import Pose2, Trajectory

__all__ = ["RunEvaluation", "compared_span", "evaluate_run_folder"]


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
                trajectory, truth, protocol, span_s=compared_span(run, truth), against_truth=reference == GROUND_TRUTH
            )
        except DataError as error:
            problems[name] = str(error)
    known = run.truth if reference == GROUND_TRUTH else None
    map_frame = ONE_FRAME if known is None or run.estimates is None else _map_frame(run, run.estimates, known, path)
    sources = _sources(run, known, map_frame, path)
    return RunEvaluation(run, protocol, reference, evaluations, sources, problems, map_frame, path)


def _reference(run: RunFolder) -> str | None:
    if run.truth is not None and len(run.truth) > 1:
        return GROUND_TRUTH
    names = [FUSED, *run.trajectories]
    return next((name for name in names if len(run.trajectories.get(name, ())) > 1), None)


def compared_span(run: RunFolder, reference: Trajectory) -> tuple[float, float]:
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
    tell it. A map that is taught without a fix begins where the robot stands: nothing else says where it lies.
    """
    fixes = estimates.where((estimates.kind == "fix") & (estimates.outcome != "refused"))
    there = true_poses(truth, fixes.stamp_s)
    known = np.isfinite(there).all(axis=1) & np.isfinite(fixes.numbers).all(axis=1)
    start = _start(run, truth)
    if start is not None and not known.any() and run.run.get("mode") == "teach":
        return map_frame_of_start(*start)
    plain = find_map_frame(fixes.numbers[known], there[known], start)
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
