"""Sec. IV-B, second part: half a metre of the path is covered with carpet after teaching."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import Table, Trial, beside_faithful
from trailmark_papers.nagai2015.playback import read_playback
from trailmark_papers.nagai2015.runs import course, drive, keys_of, tracking_config

__all__ = ["cover_rows"]

#: Everything is believed that the search finds: the place of least error, whatever the groups say.
_NO_CONSENSUS: Mapping[str, Any] = {
    "tolerance_px": 1e3,
    "min_groups": 1,
    "min_correlation": -1.0,
    "heading_sigma_deg": 90.0,
}
_FALSE_M = 5e-3
_PAPER_NOTE = "the paper: the vehicle deviated from the path"

#: Length of teaching [s], where the carpet lies [m], round trips.
_FULL = (20.0, 2.0, 2.5, 1.0)
_QUICK = (5.0, 0.4, 0.9, 0.5)
#: A vehicle that has left its path may never find its end [s].
_GIVE_UP_S = 60.0


def cover_rows(options: ExperimentOptions) -> list[Row]:
    """Return what the carpet does, with the consensus of the four groups and without."""
    modes = ("refined",) if options.quick else ("refined", "paper")
    trial = Trial.of(options)
    options.map(_teach, [(trial, mode, options.quick) for mode in modes])
    cases = [(mode, has_consensus) for mode in modes for has_consensus in (True, False)]
    options.map(_repeat, [(trial, *case, options.quick) for case in cases])
    found = {case: _rows(options, *case) for case in cases}
    rows = []
    for has_consensus in (True, False):
        rows += beside_faithful(found["refined", has_consensus], found.get(("paper", has_consensus), []))
    return rows


def _rows(options: ExperimentOptions, mode: str, has_consensus: bool) -> Table:
    names = (_teaching(mode), _playback(mode, has_consensus), f"{_teaching(mode)}.trail")
    found = read_playback(*(options.out / name for name in names))
    case = f"{mode}, {'with' if has_consensus else 'without'} consensus"
    options.report(f"0.5 m of carpet, {case}: {found.reason or found.status}")
    table = Table(f"B 0.5 m covered, {case}", len(found.searches.places))
    n_false = int((found.false_m() > _FALSE_M).sum())
    deviation_mm = 1e3 * float(np.abs(found.offsets[:, 1]).max())
    bar_n, bar_mm, note = (0, 20.3, "") if has_consensus else (None, None, _PAPER_NOTE)
    table.add("false corrections (more than 5 mm)", "", n_false, bar=bar_n)
    table.add("searches rejected", "%", found.rejected_percent())
    table.add("offset from the path, max", "mm", deviation_mm, bar=bar_mm, n=len(found.offsets), note=note)
    return table


def _teaching(mode: str) -> str:
    return f"cover-teach-{mode}"


def _playback(mode: str, has_consensus: bool) -> str:
    return f"cover-replay-{mode}-{'with' if has_consensus else 'without'}"


def _teach(trial: Trial, mode: str, is_quick: bool) -> Path:
    duration_s = (_QUICK if is_quick else _FULL)[0]
    source, keys = course("straight", trial.place, duration_s=duration_s), keys_of(mode)
    config = tracking_config(source, trial.seed, motion=keys, patches=keys)
    return drive(trial.out / _teaching(mode), config, trial.out / f"{_teaching(mode)}.trail", mode="teach")


def _repeat(trial: Trial, mode: str, has_consensus: bool, is_quick: bool) -> Path:
    _, from_m, to_m, trips = _QUICK if is_quick else _FULL
    covered = [{"from_m": from_m, "to_m": to_m, "floor": "carpet"}]
    patches = keys_of(mode) | ({} if has_consensus else dict(_NO_CONSENSUS))
    source = course("straight", trial.place, options={"covered": covered}, duration_s=_GIVE_UP_S)
    config = tracking_config(source, trial.seed, repeat=trips, motion=keys_of(mode), patches=patches)
    folder = trial.out / _playback(mode, has_consensus)
    return drive(folder, config, trial.out / f"{_teaching(mode)}.trail", mode="replay")
