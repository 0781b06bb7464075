"""The map and the time axis that the page draws: what they show, as plain data that stays small."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from trailmark import paths
from trailmark.arrays import Floats, Indices
from trailmark.evaluation import FUSED, GROUND_TRUTH, OUTCOMES, RunEvaluation
from trailmark.evaluation.estimate_errors import true_poses
from trailmark.geometry import Pose2, Trajectory, wrap_angles
from trailmark.report.gaps import find_gaps
from trailmark.report.numbers import length_unit
from trailmark.report.offsets import Offsets
from trailmark.report.series import breaks, lanes, thin_line
from trailmark.report.style import LineStyle, css_variable, line_styles

__all__ = ["explorer_document"]

Document = dict[str, Any]

#: Of one line, and of all lines of a page.
_LARGEST = 2.0**53  # JavaScript counts no further
_MAX_POINTS, _MAX_ALL = 900, 8000
_MAX_BELIEFS, _MAX_FIXES, _MAX_OUTLINES = 500, 1000, 4000

#: Steps in which numbers are told, per unit: 10 us, 0.1 mm on the map, 1 um of an error, 1e-5 rad.
_TIME, _PLACE, _ERROR, _TURN = 10**5, 10**4, 10**6, 10**5


def explorer_document(
    evaluated: RunEvaluation, trajectories: Mapping[str, Trajectory], path: paths.Path | None, offsets: Offsets
) -> Document | None:
    """Return what the map and the time axis of a run show; None where it left no way at all.

    Parameters
    ----------
    evaluated : RunEvaluation
        The run.
    trajectories : mapping of str to Trajectory
        What is drawn, in one frame: the truth first where it is known, each other aligned as its errors are.
    path : trailmark.paths.Path, optional
        The taught path, in the map.
    offsets : mapping of str to (N, 2) float64
        How far beside it the robot was, and believed to be.
    """
    span, ways = evaluated.run.span_s(), {name: way for name, way in trajectories.items() if len(way)}
    if span is None or not ways:
        return None
    limit = max(100, min(_MAX_POINTS, _MAX_ALL // len(ways)))
    names = [name for name in evaluated.run.trajectories if name != FUSED]
    styles = line_styles([GROUND_TRUTH, *names, *evaluated.sources, FUSED])
    pose = _pose_drawn_map(evaluated)
    run, reference = evaluated.run, _reference(evaluated, ways)
    estimates = run.estimates
    unit, per_m = length_unit(item.absolute.position.rmse for item in evaluated.evaluations.values())
    return {
        "span": round(span[1] - span[0], 5),
        "unit": unit,
        "per_m": per_m,
        "errors": evaluated.has_truth,
        "reference": evaluated.reference or "",
        "tracks": [_track(name, way, reference, styles[name], span[0], limit) for name, way in ways.items()],
        "taught": [] if path is None else _line_in(pose, path.positions),
        "around": _around(evaluated),
        "robot": None if run.outlines is None or run.outlines.robot is None else run.outlines.robot.round(3).tolist(),
        "beliefs": _beliefs(evaluated, pose, span[0]),
        "fixes": _fixes(evaluated, pose, reference, styles, span[0]),
        "lanes": [] if estimates is None else _lanes(evaluated, span[0]),
        "gaps": [] if estimates is None else [gap.document(span[0]) for gap in find_gaps(estimates, span)],
        "offsets": {
            name: {"t": _pack(line[:, 0], _TIME), "v": _pack(line[:, 1], _ERROR)} for name, line in offsets.items()
        },
    }


def _pose_drawn_map(evaluated: RunEvaluation) -> Pose2:
    """Return how the map lies in the frame of the drawing: as the fused trajectory was aligned."""
    if not evaluated.has_truth:
        return Pose2()
    if FUSED in evaluated.evaluations:
        return evaluated.evaluations[FUSED].absolute.alignment.pose_truth_estimate
    return evaluated.map_frame.pose_truth_map or Pose2()


def _reference(evaluated: RunEvaluation, ways: Mapping[str, Trajectory]) -> Trajectory | None:
    """Return what errors or differences are counted from."""
    return None if evaluated.reference is None else ways.get(evaluated.reference)


def _track(
    name: str, way: Trajectory, reference: Trajectory | None, style: LineStyle, start_s: float, limit: int
) -> Document:
    errors = None if reference is None or way is reference else _errors(way.poses, way.stamps_s, reference)
    kept = _kept_points(way, errors, limit)
    cuts = np.searchsorted(kept, breaks(way.stamps_s))

    def column(values: Floats, steps: int) -> list[int | None]:
        return _pack(np.insert(values[kept], cuts, np.nan), steps)

    document: Document = {
        "name": name,
        "colour": css_variable(style.colour),
        "width": style.width,
        "dash": "" if isinstance(style.dashes, str) else " ".join(f"{3 * length:g}" for length in style.dashes[1]),
        "t": column(way.stamps_s - start_s, _TIME),
        "x": column(way.positions[:, 0], _PLACE),
        "y": column(way.positions[:, 1], _PLACE),
        "h": column(np.unwrap(way.headings), _TURN),
    }
    if errors is not None and np.isfinite(errors).any():
        document |= {
            key: column(errors[:, index], steps)
            for index, (key, steps) in enumerate((("ahead", _ERROR), ("left", _ERROR), ("turn", _TURN)))
        }
    return document


def _kept_points(way: Trajectory, errors: Floats | None, limit: int) -> Indices:
    """Return the points of a line that are drawn: evenly over the way, and the peaks of its error."""
    n = len(way)
    even = np.unique(np.linspace(0, n - 1, min(n, limit // 2)).round().astype(np.intp))
    if errors is None:
        return np.unique(np.linspace(0, n - 1, min(n, limit)).round().astype(np.intp))
    return np.union1d(even, thin_line(np.hypot(errors[:, 0], errors[:, 1]), limit // 2))


def _errors(poses: Floats, stamps_s: Floats, reference: Trajectory) -> Floats:
    """Return how far poses are ahead, to the left and turned from the true pose, in its axes (N, 3); NaN if unknown."""
    true = true_poses(reference, stamps_s)
    apart = poses - true
    cos, sin = np.cos(true[:, 2]), np.sin(true[:, 2])
    ahead, left = cos * apart[:, 0] + sin * apart[:, 1], cos * apart[:, 1] - sin * apart[:, 0]
    return np.column_stack([ahead, left, wrap_angles(apart[:, 2])])


def _beliefs(evaluated: RunEvaluation, pose: Pose2, start_s: float) -> Document | None:
    """Return places and standard deviations of the belief: the ellipse on the map, and in the axes of the robot."""
    table = evaluated.run.beliefs
    if table is None or not len(table):
        return None
    kept = thin_line(np.trace(table.covariances[:, :2, :2], axis1=1, axis2=2), _MAX_BELIEFS)  # between fixes it swells
    poses, covariances = table.poses[kept], table.covariances[kept][:, :2, :2]
    values, vectors = np.linalg.eigh(covariances)
    sigmas = np.sqrt(np.clip(values, 0.0, None))
    across = np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1]) + pose.theta  # of the longer axis, in the drawing
    heading = poses[:, 2]
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    along = {
        key: np.sqrt(np.clip(np.einsum("ni,nij,nj->n", axis, covariances, axis), 0.0, None))
        for key, axis in (("ahead", ahead), ("left", left))
    }
    places = pose @ np.ascontiguousarray(poses[:, :2])
    return {
        "t": _pack(table.stamps_s[kept] - start_s, _TIME),
        "x": _pack(places[:, 0], _PLACE),
        "y": _pack(places[:, 1], _PLACE),
        "long": _pack(sigmas[:, 1], _ERROR),
        "short": _pack(sigmas[:, 0], _ERROR),
        "axis": _pack(across, _TURN),
        **{key: _pack(values, _ERROR) for key, values in along.items()},
        "turn": _pack(np.sqrt(np.clip(table.covariances[kept][:, 2, 2], 0.0, None)), _TURN),
    }


def _fixes(
    evaluated: RunEvaluation,
    pose: Pose2,
    reference: Trajectory | None,
    styles: Mapping[str, LineStyle],
    start_s: float,
) -> list[Document]:
    """Return where each localizer said that the robot is, and what became of it; accepted and others thinned apart."""
    estimates = evaluated.run.estimates
    if estimates is None:
        return []
    documents = []
    for name in estimates.sources():
        table = estimates.of(name)
        table = table.where((table.kind == "fix") & np.isfinite(table.numbers).all(axis=1))
        if not len(table):
            continue
        usual = np.flatnonzero(table.outcome == "accepted")
        odd = np.flatnonzero(table.outcome != "accepted")
        kept = np.sort(np.concatenate([item[:: -(-len(item) // _MAX_FIXES) or 1] for item in (usual, odd)]))
        fixes = table.where(np.isin(np.arange(len(table)), kept))
        places = Trajectory(np.arange(len(fixes), dtype=np.float64), fixes.numbers).transformed(pose).poses
        document: Document = {
            "name": name,
            "colour": css_variable(styles[name].colour),
            "t": _pack(fixes.stamp_s - start_s, _TIME),
            "x": _pack(places[:, 0], _PLACE),
            "y": _pack(places[:, 1], _PLACE),
            "outcome": [OUTCOMES.index(str(word)) for word in fixes.outcome],
        }
        if reference is not None and evaluated.has_truth:
            errors = _errors(places, fixes.stamp_s, reference)
            for index, (key, steps) in enumerate((("ahead", _ERROR), ("left", _ERROR), ("turn", _TURN))):
                document[key] = _pack(errors[:, index], steps)
        documents.append(document)
    return documents


def _lanes(evaluated: RunEvaluation, start_s: float) -> list[Document]:
    assert evaluated.run.estimates is not None
    stamps = evaluated.run.estimates.stamp_s
    first_s = float(stamps[np.isfinite(stamps)].min()) - start_s if np.isfinite(stamps).any() else 0.0
    return [
        {
            "name": lane.name,
            "from": round(float(lane.edges_s[0]) + first_s, 5),
            "step": round(float(lane.edges_s[1] - lane.edges_s[0]), 6),
            "shares": {word: _pack(shares, 100) for word, shares in lane.shares.items() if shares.any()},
            "counts": dict(lane.counts),
        }
        for lane in lanes(evaluated.run.estimates, evaluated.sources)
    ]


def _around(evaluated: RunEvaluation) -> list[list[list[float]]]:
    """Return what stands around, as far as it is not too much to draw; it is known in the frame of the truth."""
    outlines = evaluated.run.outlines
    if outlines is None:
        return []
    kept, n_points = [], 0
    for line in outlines.around:
        n_points += len(line)
        if n_points > _MAX_OUTLINES:
            break
        kept.append(line.round(3).tolist())
    return kept


def _line_in(pose: Pose2, points: Floats) -> list[list[float]]:
    """Return the points of a path in the frame of the drawing, one in a while where there are many."""
    step = max(1, -(-len(points) // _MAX_POINTS))
    kept = np.concatenate([points[:-1:step], points[-1:]])
    rows: list[list[float]] = (pose @ np.ascontiguousarray(kept)).round(4).tolist() if len(kept) else []
    return rows


def _pack(values: Floats, steps: int) -> list[int | None]:
    """Return numbers as differences of whole steps, after how many make one; a gap, or what is absurd, is None."""
    packed: list[int | None] = [steps]
    last = 0
    for value in values.tolist():
        if not abs(value * steps) < _LARGEST:  # nor NaN
            packed.append(None)
            continue
        whole = round(value * steps)
        packed.append(whole - last)
        last = whole
    return packed
