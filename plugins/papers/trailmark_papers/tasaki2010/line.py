"""Table 1 and Fig. 6: 4 m along a line by a wall; the developed method, SURF alone, and what the selection buys."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Floats
from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import Table, beside_faithful, largest_of, mean_of, sd_of
from trailmark_papers.tasaki2010.place import TaughtPlace
from trailmark_papers.tasaki2010.plots import draw_line
from trailmark_papers.tasaki2010.variants import Answers, drive

__all__ = ["line_rows"]

_ROUTE_Y_M = 2.0
_WHITE_WALL_M = (1.0, 1.5)  # x of the part in front of the white wall
_N_RUNS, _QUICK_S = 3, 4.0  # runs in each place
_N_RESAMPLES = 5000
_QUICK_VARIANTS = ("developed", "simple", "plain", "paper")
#: The two readings of the paper's simple method.
_SIMPLE = {"simple": "SURF only, our pose", "plain": "SURF only, least squares of all matches"}

Runs = list[dict[str, Answers]]


def line_rows(options: ExperimentOptions, place: TaughtPlace) -> list[Row]:
    """Return the rows of Table 1 and of the selection, and draw Fig. 6."""
    names = _QUICK_VARIANTS if options.quick else tuple(name for name in place.variants if "paper, " not in name)
    limits = {"duration_s": _QUICK_S} if options.quick else {}
    source = place.source(route="wall", sensors=["wheels", "omni"], **limits)
    n_runs = 1 if options.quick else _N_RUNS
    calls = [([place.variants[name] for name in names], source, options.seed + 100 + k) for k in range(n_runs)]
    runs = options.map(drive, calls)
    for name in names:
        mean_m = mean_of(_pool_pictures(runs, name, "errors_m"))
        options.report(f"line, {name}: " + ("no answers" if mean_m is None else f"{1e3 * mean_m:.0f} mm mean error"))
    draw_line(options.out / "tasaki2010_fig6_positions.svg", runs[0])
    rows = [
        *beside_faithful(_developed_rows(runs, "developed"), _developed_rows(runs, "paper")),
        *(row for variant in _SIMPLE for row in _simple_rows(runs, variant)),
        *beside_faithful(_wall_rows(runs, "developed"), _wall_rows(runs, "paper")),
    ]
    if not options.quick:
        rows += [*_compared_rows(runs), *_other_rows(runs), *_selection_rows(runs, place)]
    return rows


def _pool_pictures(runs: Runs, name: str, what: str) -> Floats:
    """Return the errors or CPU times of all pictures of all runs; errors are NaN where lost."""
    return np.concatenate([getattr(run[name], what) for run in runs])


def _to_route(runs: Runs, name: str) -> Floats:
    """Return the error as the paper measures it: the distance to the line of the route [m]."""
    distances = np.concatenate([np.abs(run[name].said[:, 1] - _ROUTE_Y_M) for run in runs])
    return np.asarray(distances[np.isfinite(distances)])


def _developed_rows(runs: Runs, variant: str) -> Table:
    """Return the rows of Table 1 for the developed method, or for it as printed."""
    errors, times = _pool_pictures(runs, variant, "errors_m"), _pool_pictures(runs, variant, "cpu_ms")
    route, table = _to_route(runs, variant), Table("Table 1", len(errors), len(runs))
    note = "the paper measures the distance to the route; that is the row below"
    error = "developed, true position error"
    table.add(f"{error}, mean", "m", mean_of(errors), bar=0.20, stretch=0.10, note=note)
    table.add(f"{error}, SD", "m", sd_of(errors), bar=0.15)
    table.add("developed, distance to the route, mean", "m", mean_of(route), paper=0.38)
    table.add("developed, distance to the route, SD", "m", sd_of(route), paper=0.21)
    table.add_share("developed, pictures answered", np.isfinite(errors))
    table.add(
        "developed, CPU time of a picture, mean", "ms", float(times.mean()), paper=16.4, bar=5.0, stretch=2.0,
        spread=float(times.std()), note="+- is the SD over pictures; the first picture's search for the centre is in",
    )  # fmt: skip
    return table


def _simple_rows(runs: Runs, variant: str) -> Table:
    """Return the rows of one reading of the simple method: all points, detected in every picture by itself."""
    errors, times = _pool_pictures(runs, variant, "errors_m"), _pool_pictures(runs, variant, "cpu_ms")
    table, story = Table("Table 1", len(errors), len(runs)), _SIMPLE[variant]
    route = _to_route(runs, variant)
    table.add(f"{story}: true position error, mean", "m", mean_of(errors))
    table.add(f"{story}: true position error, SD", "m", sd_of(errors))
    table.add(f"{story}: distance to the route, mean", "m", mean_of(route), paper=1.61)
    table.add(f"{story}: distance to the route, SD", "m", sd_of(route), paper=1.36)
    table.add_share(f"{story}: pictures answered", np.isfinite(errors))
    time = f"{story}: CPU time of a picture, mean"
    table.add(time, "ms", float(times.mean()), paper=46.8, spread=float(times.std()))
    return table


def _wall_rows(runs: Runs, variant: str) -> Table:
    """Return what happens in front of the white wall."""
    x, errors = _pool_pictures(runs, variant, "truth")[:, 0], _pool_pictures(runs, variant, "errors_m")
    before = errors[(x >= _WHITE_WALL_M[0]) & (x <= _WHITE_WALL_M[1])]
    table = Table("White wall, x 1.0 to 1.5 m", len(before), len(runs))
    table.add("developed, largest error", "m", largest_of(before), paper=0.6, bar=0.6, stretch=0.2)
    table.add_share("developed, pictures answered", np.isfinite(before))
    return table


def _compared_rows(runs: Runs) -> Table:
    """Return the paired comparison: run by run, because the pictures of a run are not independent."""
    from scipy.stats import ttest_rel

    table = Table("Table 1, paired", len(runs), len(runs))
    for variant, story in _SIMPLE.items():
        for item, paper in (("error", 4.2), ("time", 2.9)):
            developed, simple = (_run_means(runs, name, item) for name in ("developed", variant))
            p = float(ttest_rel(developed, simple, alternative="less").pvalue)
            ratio = float(simple.mean() / developed.mean())
            table.add_higher(f"{item}, {story} over developed", "x", ratio, paper=paper, bar=1.0)
            table.add(f"{item}, {story}: p of the t-test over runs", "", p, bar=0.01)
    return table


def _run_means(runs: Runs, name: str, item: str) -> Floats:
    """Return the mean error [m] or CPU time [ms] of every run."""
    what = {"error": "errors_m", "time": "cpu_ms"}[item]
    return np.array([mean_of(getattr(run[name], what)) for run in runs], dtype=np.float64)


def _other_rows(runs: Runs) -> Table:
    """Return what tracking buys: the developed method with every picture detected."""
    errors, story = _pool_pictures(runs, "detected", "errors_m"), "as developed, but every picture detected"
    table = Table("Departures", len(errors), len(runs))
    table.add(f"{story}: error, mean", "m", mean_of(errors), spread=sd_of(errors))
    table.add_share(f"{story}: pictures answered", np.isfinite(errors))
    table.add(f"{story}: CPU time of a picture", "ms", float(_pool_pictures(runs, "detected", "cpu_ms").mean()))
    return table


def _selection_rows(runs: Runs, place: TaughtPlace) -> Table:
    """Return what the selection buys, with bootstrap intervals over the runs."""
    table = Table("Selection", len(runs), len(runs))
    for name, story in (
        ("developed", "selected by the shipped machine"),
        ("trained", "selected by one trained on 100 of another place"),
        ("unselected", "all"),
        ("random", "as many at random"),
    ):
        means = _run_means(runs, name, "error")
        tracked = np.array([float(np.nansum(run[name].tracked)) / len(run[name].tracked) for run in runs])
        fixed = np.array([run[name].fixed_share for run in runs])
        note = f"{place.sizes[name]} landmarks; {_interval(means, 'm')}"
        note += f"; {place.training}" if name == "trained" else ""
        table.add(f"{story}: error, mean", "m", mean_of(means), note=note)
        table.add_share(f"{story}: pictures answered by tracking", tracked, note=_interval(100 * tracked, "%"))
        table.add_share(f"{story}: pictures answered", fixed, note=_interval(100 * fixed, "%"))
    return table


def _interval(values: Floats, unit: str) -> str:
    """Return the 95 % bootstrap interval of the mean, in words."""
    rng = np.random.default_rng(0)
    means = values[rng.integers(0, len(values), (_N_RESAMPLES, len(values)))].mean(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return f"95 % interval over runs {low:.3g} to {high:.3g} {unit} (bootstrap)"
