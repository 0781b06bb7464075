"""Table 1 and Fig. 6: 4 m along a line by a wall; the developed method, SURF alone, and what the selection buys."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.tasaki2010.place import TaughtPlace, supermarket
from trailmark_papers.tasaki2010.plots import draw_line
from trailmark_papers.tasaki2010.variants import Answers, drive, largest_of, mean_of, sd_of

__all__ = ["line_rows"]

_ROUTE_Y_M = 2.0
_WHITE_WALL_M = (1.0, 1.5)  # x of the part in front of the white wall
_N_RUNS, _QUICK_S = 10, 4.0
_N_RESAMPLES = 5000
_QUICK_VARIANTS = ("developed", "simple", "plain")
#: The two readings of the paper's simple method.
_SIMPLE = {"simple": "SURF only, our pose", "plain": "SURF only, least squares of all matches"}

Runs = list[dict[str, Answers]]


def line_rows(options: ExperimentOptions, place: TaughtPlace) -> list[Row]:
    """Return the rows of Table 1 and of the selection, and draw Fig. 6."""
    names = _QUICK_VARIANTS if options.quick else tuple(place.variants)
    variants = [place.variants[name] for name in names]
    source = supermarket(route="wall", sensors=["wheels", "omni"])
    if options.quick:
        source["duration_s"] = _QUICK_S
    n_runs = 1 if options.quick else _N_RUNS
    calls = [(variants, source, options.seed + 100 + k) for k in range(n_runs)]
    runs = options.map(drive, calls)
    for name in names:
        mean_m = mean_of(_pooled(runs, name))
        options.report(f"line, {name}: " + ("no answers" if mean_m is None else f"{1e3 * mean_m:.0f} mm mean error"))
    draw_line(options.out / "tasaki2010_fig6_positions.svg", runs[0])
    rows = [*_table_rows(runs), *_wall_rows(runs)]
    if not options.quick:
        rows += [*_compared_rows(runs), *_other_rows(runs), *_selection_rows(runs, place)]
    return rows


def _pooled(runs: Runs, name: str) -> npt.NDArray[np.float64]:
    """Return the errors of all pictures of all runs; NaN where lost."""
    return np.concatenate([run[name].errors_m for run in runs])


def _to_route(runs: Runs, name: str) -> npt.NDArray[np.float64]:
    """Return the error as the paper measures it: the distance to the line of the route [m]."""
    distances = np.concatenate([np.abs(run[name].said[:, 1] - _ROUTE_Y_M) for run in runs])
    return np.asarray(distances[np.isfinite(distances)])


def _times(runs: Runs, name: str) -> npt.NDArray[np.float64]:
    return np.concatenate([run[name].cpu_ms for run in runs])


def _table_rows(runs: Runs) -> list[Row]:
    """Return the rows of Table 1."""
    common: dict[str, Any] = {"n": len(_pooled(runs, "developed")), "seeds": len(runs)}
    errors, route, times = _pooled(runs, "developed"), _to_route(runs, "developed"), _times(runs, "developed")
    is_answered = np.isfinite(errors)
    name = "Table 1"
    note = "the paper measures the distance to the route; that is the row below"
    return [
        Row(name, "developed, true position error, mean", "m", mean_of(errors), 0.38, 0.20, 0.10,
            note=note, **common),
        Row(name, "developed, true position error, SD", "m", sd_of(errors), 0.21, 0.15, **common),
        Row(name, "developed, distance to the route, mean", "m", mean_of(route), 0.38, **common),
        Row(name, "developed, distance to the route, SD", "m", sd_of(route), 0.21, **common),
        Row(name, "developed, pictures answered", "%", 100 * float(is_answered.mean()), better="higher", **common),
        Row(name, "developed, CPU time of a picture, mean", "ms", float(times.mean()), 16.4, 5.0, 2.0,
            float(times.std()), note="+- is the SD over pictures; the first picture's search for the centre is in",
            **common),
        *(row for variant in _SIMPLE for row in _simple_rows(runs, variant)),
    ]  # fmt: skip


def _simple_rows(runs: Runs, variant: str) -> list[Row]:
    """Return the rows of one reading of the simple method: all points, detected in every picture by itself."""
    errors, route, times = _pooled(runs, variant), _to_route(runs, variant), _times(runs, variant)
    common: dict[str, Any] = {"n": len(errors), "seeds": len(runs)}
    name, story = "Table 1", _SIMPLE[variant]
    return [
        Row(name, f"{story}: true position error, mean", "m", mean_of(errors), 1.61, **common),
        Row(name, f"{story}: true position error, SD", "m", sd_of(errors), 1.36, **common),
        Row(name, f"{story}: distance to the route, mean", "m", mean_of(route), 1.61, **common),
        Row(name, f"{story}: pictures answered", "%", 100 * float(np.isfinite(errors).mean()), better="higher",
            **common),
        Row(name, f"{story}: CPU time of a picture, mean", "ms", float(times.mean()), 46.8, None, None,
            float(times.std()), **common),
    ]  # fmt: skip


def _wall_rows(runs: Runs) -> list[Row]:
    """Return what happens in front of the white wall."""
    errors = []
    for run in runs:
        x = run["developed"].truth[:, 0]
        errors.append(run["developed"].errors_m[(x >= _WHITE_WALL_M[0]) & (x <= _WHITE_WALL_M[1])])
    pooled = np.concatenate(errors)
    common: dict[str, Any] = {"n": len(pooled), "seeds": len(runs)}
    return [
        Row("White wall, x 1.0 to 1.5 m", "developed, largest error", "m", largest_of(pooled), 0.6, 0.6, 0.2, **common),
        Row("White wall, x 1.0 to 1.5 m", "developed, pictures answered", "%",
            100 * float(np.isfinite(pooled).mean()), better="higher", **common),
    ]  # fmt: skip


def _compared_rows(runs: Runs) -> list[Row]:
    """Return the paired comparison: run by run, because the pictures of a run are not independent."""
    from scipy.stats import ttest_rel

    common: dict[str, Any] = {"n": len(runs), "seeds": len(runs)}
    rows = []
    for variant, story in _SIMPLE.items():
        for item, paper in (("error", 4.2), ("time", 2.9)):
            developed, simple = (_run_means(runs, name, item) for name in ("developed", variant))
            p = float(ttest_rel(developed, simple, alternative="less").pvalue)
            ratio = float(simple.mean() / developed.mean())
            rows += [
                Row("Table 1, paired", f"{item}, {story} over developed", "x", ratio, paper, 1.0, better="higher",
                    **common),
                Row("Table 1, paired", f"{item}, {story}: p of the t-test over runs", "", p, None, 0.01, **common),
            ]  # fmt: skip
    return rows


def _run_means(runs: Runs, name: str, item: str) -> npt.NDArray[np.float64]:
    """Return the mean error [m] or CPU time [ms] of every run."""
    if item == "time":
        return np.array([float(run[name].cpu_ms.mean()) for run in runs])
    return np.array([mean_of(run[name].errors_m) for run in runs], dtype=np.float64)


def _other_rows(runs: Runs) -> list[Row]:
    """Return what single departures from the paper do."""
    rows = []
    for name, story in (
        ("paper", "the paper's K = 9, no refresh, 4 agreeing"),
        ("detected", "as developed, but every picture detected"),
    ):
        errors = _pooled(runs, name)
        common: dict[str, Any] = {"n": len(errors), "seeds": len(runs)}
        rows += [
            Row("Departures", f"{story}: error, mean", "m", mean_of(errors), spread=sd_of(errors), **common),
            Row("Departures", f"{story}: pictures answered", "%", 100 * float(np.isfinite(errors).mean()),
                better="higher", **common),
            Row("Departures", f"{story}: CPU time of a picture", "ms", float(_times(runs, name).mean()), **common),
        ]  # fmt: skip
    return rows


def _selection_rows(runs: Runs, place: TaughtPlace) -> list[Row]:
    """Return what the selection buys, with bootstrap intervals over the runs."""
    rows = []
    for name, story in (
        ("developed", f"{place.sizes['developed']} selected by the shipped machine"),
        ("trained", f"{place.sizes['trained']} selected by one trained on 100 of another place"),
        ("unselected", f"all {place.sizes['unselected']}"),
        ("random", f"{place.sizes['random']} at random"),
    ):
        means = _run_means(runs, name, "error")
        tracked = np.array([float(np.nansum(run[name].tracked)) / len(run[name].tracked) for run in runs])
        fixed = np.array([run[name].fixed_share for run in runs])
        common: dict[str, Any] = {"n": len(runs), "seeds": len(runs)}
        rows += [
            Row("Selection", f"{story}: error, mean", "m", mean_of(means),
                note=_interval(means, "m") + (f"; {place.training}" if name == "trained" else ""), **common),
            Row("Selection", f"{story}: pictures answered by tracking", "%", 100 * float(tracked.mean()),
                better="higher", note=_interval(100 * tracked, "%"), **common),
            Row("Selection", f"{story}: pictures answered", "%", 100 * float(fixed.mean()), better="higher",
                note=_interval(100 * fixed, "%"), **common),
        ]  # fmt: skip
    return rows


def _interval(values: npt.NDArray[np.float64], unit: str) -> str:
    """Return the 95 % bootstrap interval of the mean, in words."""
    rng = np.random.default_rng(0)
    means = values[rng.integers(0, len(values), (_N_RESAMPLES, len(values)))].mean(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return f"95 % interval over runs {low:.3g} to {high:.3g} {unit} (bootstrap)"
