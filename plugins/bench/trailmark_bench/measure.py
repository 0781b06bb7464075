"""What is kept of a cell: its figures for the tables, and a small picture of the run for its page."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from trailmark.arrays import Floats, Indices
from trailmark.evaluation import (
    FUSED,
    GROUND_TRUTH,
    Evaluation,
    RunEvaluation,
    collisions_of,
    quantity_of,
)
from trailmark.geometry import Trajectory
from trailmark.pipeline import RunResult

__all__ = ["DETAIL_POINTS", "measure_cell", "times_of", "verdict_of"]

#: Points of a line on the page of a cell.
DETAIL_POINTS = 100

_STEPS = 4000
_MOST_WAYS = 5
# Of a shorter way what a metre costs says nothing.
_LEAST_WAY_M = 0.1
# What a belief is judged for as its localizers are: not the same quantity, for it may be wrong where they are not.
_OF_BELIEF = "silent"


def measure_cell(
    request: Mapping[str, Any], result: RunResult, document: Mapping[str, Any], evaluated: RunEvaluation
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return ``result.json`` and ``detail.json`` of a cell that has run.

    Parameters
    ----------
    request : mapping
        Of the cell.
    result : RunResult
        How the run ended.
    document : mapping
        ``metrics.json`` of the run.
    evaluated : RunEvaluation
        What that is of.
    """
    subject, localizer = request["subject"], request["localizer"]
    state, reason = verdict_of(result, document, subject, localizer)
    answer = {
        "state": state,
        "reason": reason,
        "errors": document["errors"],
        "metrics": _metrics(document, subject, localizer),
        "floor": (document["stands_still"] or {}).get("metrics", {}),
        "quantities": document["quantities"],
        "times": times_of(result, localizer, _way_m(document, subject)),
        "counters": {name: count for name, count in result.counters.items() if count},
        "alignment": document["trajectories"].get(subject, {}).get("alignment", {}).get("used"),
    }
    return answer, _detail(request, evaluated, document, result)


def verdict_of(result: RunResult, document: Mapping[str, Any], subject: str, localizer: str) -> tuple[str, str]:
    """Return state and reason: a run that was stopped, or says nothing to compare, is no result."""
    if result.status != "done":
        return "failed", f"{result.status}: {result.reason}".rstrip(": ")
    if collisions_of(result.counters):
        return "failed", "the robot touched something"
    trajectory = document["trajectories"].get(subject)
    told = document["sources"].get(localizer, {"estimates": 0, "outcomes": {}})
    if trajectory is None or not (trajectory["poses"] or told.get("says_places") is False):
        return "failed", f"'{subject}' gave no pose"
    if told["estimates"] <= told["outcomes"].get("lost", 0):  # a belief that nobody feeds stands still, and is a pose
        return "failed", f"'{localizer}' never said where it is"
    if "problem" in trajectory and told.get("says_places", True):  # who says path offsets alone has no way
        return "failed", str(trajectory["problem"])
    for warning in document["warnings"]:
        is_about = warning["about"] in (subject, localizer) or (not warning["about"] and subject == FUSED)
        if warning["is_worthless"] and is_about:
            return "failed", f"{warning['about'] or 'the run'}: {warning['fact']}"
    return "ok", ""


def _metrics(document: Mapping[str, Any], subject: str, localizer: str) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    for name, value in document["trajectories"].get(subject, {}).get("metrics", {}).items():
        found[f"belief_{name}" if quantity_of(name).startswith(_OF_BELIEF) else name] = value
    found |= document["sources"].get(localizer, {}).get("metrics", {})
    truth = document["trajectories"].get(GROUND_TRUTH, {}).get("metrics", {})
    return found | {f"true_{name}": value for name, value in truth.items()}  # how a robot that was driven really went


def _way_m(document: Mapping[str, Any], subject: str) -> float:
    """Return the way that was driven; where the truth is not known, as the subject says [m]."""
    ways = document["trajectories"]
    return float(ways.get(GROUND_TRUTH, ways.get(subject, {})).get("length_m", 0.0))


def times_of(result: RunResult, localizer: str, way_m: float) -> dict[str, float]:
    """Return how long it took: a localizer per call and per metre of the way, and the whole run.

    Parameters
    ----------
    result : RunResult
        With the times of its stages.
    localizer : str
        Its name.
    way_m : float
        The way that was driven; of one that hardly is any, a metre has no cost [m].
    """
    timing = result.timing
    stage = timing["stages"].get(f"localizer.{localizer}", {})
    times = {f"call_{name}": value for name, value in stage.items() if name.endswith("_ms")}
    if stage and way_m >= _LEAST_WAY_M:
        times["call_ms_per_m"] = stage["n"] * stage["mean_ms"] / way_m
    frames, wall_s = timing["frames"], timing["wall_s"]
    return {**times, "frames": frames, "run_s": wall_s, "frames_per_s": frames / wall_s if wall_s else 0.0}


def _detail(
    request: Mapping[str, Any], evaluated: RunEvaluation, document: Mapping[str, Any], result: RunResult
) -> dict[str, Any]:
    run = evaluated.run
    subject = evaluated.evaluations.get(request["subject"])
    about = {key: run.run.get(key) for key in ("trailmark", "started", "python", "platform", "cpu", "git", "packages")}
    return {
        "ways": _ways(evaluated, request["subject"]),
        "errors": None if subject is None else _errors(subject),
        "stages": {
            name: [stage[f"{word}_ms"] for word in ("p50", "p95", "p99", "max")]
            for name, stage in result.timing["stages"].items()
            if name.startswith(("localizer.", "estimator", "source."))
        },
        "sources": {
            name: {key: item[key] for key in ("estimates", "outcomes", "nis", "nees")}
            for name, item in document["sources"].items()
        },
        "config": run.config_text,
        "provenance": about | {"code": request["code"], "data": request["data"]},
    }


def _ways(evaluated: RunEvaluation, subject: str) -> dict[str, Any]:
    """Return truth and trajectories, aligned as their errors are, as whole numbers of a step [m]."""
    ways: dict[str, Floats] = {}
    if evaluated.has_truth and evaluated.run.truth is not None:
        ways[GROUND_TRUTH] = _positions(_within(evaluated.run.truth, evaluated.run.span_s()))
    names = sorted(evaluated.run.trajectories, key=lambda name: name != subject)
    for name in names[:_MOST_WAYS]:
        trajectory, compared = evaluated.run.trajectories[name], evaluated.evaluations.get(name)
        if len(trajectory) and (compared is not None or not evaluated.has_truth):
            laid = trajectory if compared is None else compared.absolute.alignment.apply(trajectory)
            ways[name] = _positions(laid)
    if not ways:
        return {}
    everything = np.concatenate(list(ways.values()))
    low = everything.min(axis=0)
    step = max(float((everything.max(axis=0) - low).max()) / _STEPS, 1e-6)
    lines = {name: np.rint((points - low) / step).astype(int).tolist() for name, points in ways.items()}
    return {"step": _short(step), "low": [_short(value) for value in low.tolist()], "lines": lines}


def _within(trajectory: Trajectory, span_s: tuple[float, float] | None) -> Trajectory:
    if span_s is None:
        return trajectory
    inside = (trajectory.stamps_s >= span_s[0]) & (trajectory.stamps_s <= span_s[1])
    return Trajectory(trajectory.stamps_s[inside], trajectory.poses[inside]) if inside.any() else trajectory


def _positions(trajectory: Trajectory) -> Floats:
    return np.asarray(trajectory.positions[_thin(len(trajectory))], dtype=np.float64)


def _thin(n: int) -> Indices:
    return np.unique(np.linspace(0, n - 1, min(n, DETAIL_POINTS)).astype(np.intp))


def _errors(evaluation: Evaluation) -> dict[str, list[float]]:
    """Return errors over the true way: distance, and across the true heading (left is positive) [m, mm, mm, deg].

    Of each piece of the way the largest error stays: a peak is what one looks for.
    """
    truth = evaluation.pairs.truth
    estimate = evaluation.absolute.alignment.apply(evaluation.pairs.estimate)
    way_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(truth.positions, axis=0), axis=1))])
    error = estimate.positions - truth.positions
    heading = truth.poses[:, 2]
    lateral = -np.sin(heading) * error[:, 0] + np.cos(heading) * error[:, 1]
    turn = np.degrees((estimate.poses[:, 2] - heading + np.pi) % (2 * np.pi) - np.pi)
    distance = np.hypot(*error.T)
    pieces = np.array_split(np.arange(len(distance)), min(len(distance), DETAIL_POINTS))
    kept = np.array([piece[np.argmax(distance[piece])] for piece in pieces])
    return {
        "way_m": [_short(value) for value in way_m[kept].tolist()],
        "distance_mm": [_short(1e3 * value) for value in distance[kept].tolist()],
        "lateral_mm": [_short(1e3 * value) for value in lateral[kept].tolist()],
        "turn_deg": [_short(value) for value in turn[kept].tolist()],
    }


def _short(value: float) -> float:
    return float(f"{value:.3g}") if math.isfinite(value) else 0.0
