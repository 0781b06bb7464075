"""The paper's future work: how accurate and how fast it stays while people walk about."""

from __future__ import annotations

import numpy as np

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import Table, beside_faithful, largest_of, mean_of, sd_of, sweep
from trailmark_papers.tasaki2010.place import TaughtPlace
from trailmark_papers.tasaki2010.variants import Answers, drive

__all__ = ["people_rows"]

#: People, and the share of pictures that must be answered [%].
_CROWDS = ((0, 99.0), (4, 95.0), (8, 90.0))
_QUICK_S = 3.0


def people_rows(options: ExperimentOptions, place: TaughtPlace) -> list[Row]:
    """Return share, largest error and time by the number of people, through all aisles."""
    crowds = _CROWDS[1:2] if options.quick else _CROWDS
    limits = {"duration_s": _QUICK_S} if options.quick else {}
    cells = {}
    for people, _ in crowds:
        source = place.source(route="round", sensors=["wheels", "omni"], options={"people": people}, **limits)
        cells[people] = ([place.variants[name] for name in ("developed", "paper")], source, options.seed + 200 + people)
    found = sweep(options, drive, cells)
    rows = []
    for people, bar in crowds:
        ours, faithful = (_rows_of(options, people, found[people][name], bar) for name in ("developed", "paper"))
        rows += beside_faithful(ours, faithful)
    return rows


def _rows_of(options: ExperimentOptions, people: int, answers: Answers, bar: float) -> Table:
    errors, cpu_ms = answers.errors_m, answers.cpu_ms
    table = Table(f"{people} people walking", len(errors))
    options.report(f"{table.name}: {100 * answers.fixed_share:.1f} % answered, {answers.n_bad} bad")
    table.add_share("pictures answered", np.isfinite(errors), bar=bar)
    table.add("error, mean", "m", mean_of(errors), spread=sd_of(errors))
    table.add("error, largest of all answers", "m", largest_of(errors), bar=1.0)
    table.add("answers more than 0.5 m off with NEES > 16", "", float(answers.n_bad), bar=0.0)
    table.add_higher("pictures tracked", "%", 100 * (mean_of(answers.tracked) or 0.0))
    table.add("CPU time of a picture, mean", "ms", float(cpu_ms.mean()), spread=float(cpu_ms.std()))
    return table
