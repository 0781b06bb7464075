"""A next day that is as hard as the paper's, where 8.5 % of the searches were rejected: 12 m of the campus.

On the days of the long course hardly a search fails, so that neither the consensus of the groups nor the second try
has much to do. Here dirt, water and leaves lie on the ground: the default rejects fewer than the paper did, the printed
method more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import Table, Trial, beside_faithful, sweep
from trailmark_papers.nagai2015.directions import add_directions
from trailmark_papers.nagai2015.playback import Playback, read_playback
from trailmark_papers.nagai2015.runs import course, drive, keys_of, tracking_config

__all__ = ["DAY", "hard_day_rows"]

DAY: Mapping[str, Any] = {"day": 2, "dirt": 0.4, "wet": 0.3, "leaves_per_m2": 20.0}
_PUT_OFF = (0.0, 0.006, 0.5)
_TEACH_S = 46.5  # 12 m at 0.26 m/s
_PLAYBACK_HZ = 35.0
_WAYS = ("forward", "reverse")
_METHODS = ("refined", "paper")
_FALSE_M = 5e-3


def hard_day_rows(options: ExperimentOptions) -> list[Row]:
    """Return what the day does to playback, there and back; the quick version leaves this out."""
    if options.quick:
        return []
    trial = Trial.of(options)
    taught = sweep(options, teach, {method: (trial, method) for method in _METHODS})
    cells = {(method, way): (trial, method, way) for method in _METHODS for way in _WAYS}
    folders = sweep(options, repeat, cells)
    rows = {}
    for method in _METHODS:
        found = [read_playback(taught[method], folders[method, way], _store(trial, method)) for way in _WAYS]
        rows[method] = rows_of(found, is_judged=method == "refined")
        rejected = float(np.mean([one.rejected_percent() for one in found]))
        options.report(f"12 m on a hard day, {method}: {rejected:.1f} % rejected, {found[-1].reason}")
    return beside_faithful(rows["refined"], rows["paper"])


def _store(trial: Trial, method: str) -> Path:
    return trial.out / f"hard-day-{method}.trail"


def teach(trial: Trial, method: str) -> Path:
    """Teach the beginning of the course on a clean day, and return the folder of the run."""
    keys = keys_of(method)
    config = tracking_config(course("outdoor", trial.place, duration_s=_TEACH_S), trial.seed, motion=keys, patches=keys)
    return drive(trial.out / f"hard-day-teach-{method}", config, _store(trial, method), "teach")


def repeat(trial: Trial, method: str, way: str) -> Path:
    """Drive it on the hard day from one of its ends, and return the folder of the run."""
    source = course(
        "outdoor",
        trial.place,
        options={"in_replay": dict(DAY)},
        put_off=list(_PUT_OFF),
        rates_hz={"floor": _PLAYBACK_HZ},
    )
    keys, start = keys_of(method), "first" if way == "forward" else "last"
    limits: dict[str, Any] = {"stop_when": {"fix_age_m": 5.0}, "start": start}
    config = tracking_config(source, trial.seed, motion=keys, patches=keys, **limits)
    return drive(trial.out / f"hard-day-{method}-{way}", config, _store(trial, method), "replay")


def rows_of(found: Sequence[Playback], *, is_judged: bool = True) -> Table:
    """Return the rows of the playbacks of a method; the paper's figures are those of its next day."""
    offsets = np.abs(np.concatenate([one.offsets for one in found]))
    is_found = np.concatenate([one.searches.is_found for one in found])
    intervals_m = np.concatenate([one.intervals_m() for one in found])
    table = Table("D 12 m, a hard next day, forward and reverse", len(offsets))
    table.add("searches rejected", "%", 100.0 * float(np.mean(~is_found)), paper=8.5, n=len(is_found))
    for item, unit, ours, paper in (
        ("offset from the path, mean", "mm", 1e3 * offsets[:, 1].mean(), 4.1),
        ("offset from the path, max", "mm", 1e3 * offsets[:, 1].max(), 25.0),
        ("angular offset, mean", "deg", np.degrees(offsets[:, 2]).mean(), 0.49),
        ("angular offset, max", "deg", np.degrees(offsets[:, 2]).max(), 3.2),
        ("way between corrections, mean", "m", intervals_m.mean(), 0.062),
    ):
        table.add(item, unit, float(ours), paper=paper, bar=paper if is_judged else None)
    table.add("way between corrections, max", "m", float(intervals_m.max()))
    add_directions(table, found)
    n_false = sum(int((one.false_m() > _FALSE_M).sum()) for one in found)
    table.add("false corrections (more than 5 mm)", "", n_false, bar=0 if is_judged else None, n=len(is_found))
    return table
