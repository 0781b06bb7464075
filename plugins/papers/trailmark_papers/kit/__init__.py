"""What the experiments of all papers are made of: runs, sweeps, watchers, tables and figures."""

from __future__ import annotations

from typing import Any

from trailmark.deprecation import deprecated_name
from trailmark_papers.kit.figures import panels
from trailmark_papers.kit.keepers import AnswerKeeper, FrameKeeper
from trailmark_papers.kit.numbers import largest_of, mean_of, rms, sd_of, spread_of
from trailmark_papers.kit.places import Trial, over_places
from trailmark_papers.kit.runs import OnStep, collisions_of, run_config, sim_source, started_source, truth_of, world_of
from trailmark_papers.kit.stores import arrays_of, keyframes_of, path_of
from trailmark_papers.kit.sweeps import group_by, sweep
from trailmark_papers.kit.tables import Table, begin_with, beside_faithful
from trailmark_papers.kit.watching import Watcher, observe_timed, show

__all__ = [
    "AnswerKeeper",
    "FrameKeeper",
    "OnStep",
    "Table",
    "Trial",
    "Watcher",
    "arrays_of",
    "begin_with",
    "beside_faithful",
    "collisions_of",
    "group_by",
    "keyframes_of",
    "largest_of",
    "mean_of",
    "observe_timed",
    "over_places",
    "panels",
    "path_of",
    "rms",
    "run_config",
    "sd_of",
    "show",
    "sim_source",
    "spread_of",
    "started_source",
    "sweep",
    "truth_of",
    "world_of",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"grouped": group_by, "simulated": sim_source, "timed": observe_timed})
