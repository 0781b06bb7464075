"""The paper's future work: how accurate and how fast it stays while people walk about."""

from __future__ import annotations

from typing import Any

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.tasaki2010.place import TaughtPlace, supermarket
from trailmark_papers.tasaki2010.variants import drive, largest_of, mean_of, sd_of

__all__ = ["people_rows"]

#: People, and the share of pictures that must be answered [%].
_CROWDS = ((0, 99.0), (4, 95.0), (8, 90.0))
_QUICK_S = 3.0


def people_rows(options: ExperimentOptions, place: TaughtPlace) -> list[Row]:
    """Return share, largest error and time by the number of people, through all aisles."""
    crowds = _CROWDS[1:2] if options.quick else _CROWDS
    developed, calls = place.variants["developed"], []
    for people, _ in crowds:
        source = supermarket(route="round", sensors=["wheels", "omni"], options={"people": people})
        if options.quick:
            source["duration_s"] = _QUICK_S
        calls.append(([developed], source, options.seed + 200 + people))
    rows: list[Row] = []
    for (people, bar), found in zip(crowds, options.map(drive, calls)):
        answers = found["developed"]
        errors, name = answers.errors_m, f"{people} people walking"
        is_bad = (errors > 0.5) & (answers.nees > 16.0)
        options.report(f"{name}: {100 * answers.fixed_share:.1f} % answered, {int(is_bad.sum())} bad")
        common: dict[str, Any] = {"n": len(errors)}
        rows += [
            Row(name, "pictures answered", "%", 100 * answers.fixed_share, None, bar, better="higher", **common),
            Row(name, "error, mean", "m", mean_of(errors), spread=sd_of(errors), **common),
            Row(name, "error, largest of all answers", "m", largest_of(errors), None, 1.0, **common),
            Row(name, "answers more than 0.5 m off with NEES > 16", "", float(is_bad.sum()), None, 0.0, **common),
            Row(name, "pictures tracked", "%", 100 * (mean_of(answers.tracked) or 0.0), better="higher", **common),
            Row(name, "CPU time of a picture, mean", "ms", float(answers.cpu_ms.mean()),
                spread=float(answers.cpu_ms.std()), **common),
        ]  # fmt: skip
    return rows
