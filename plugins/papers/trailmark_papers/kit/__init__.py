"""What the experiments of all papers are made of: runs, sweeps, watchers, tables and figures."""

from __future__ import annotations

from trailmark_papers.kit.figures import panels
from trailmark_papers.kit.keepers import AnswerKeeper, FrameKeeper
from trailmark_papers.kit.numbers import largest_of, mean_of, rms, sd_of, spread_of
from trailmark_papers.kit.places import Trial, over_places
from trailmark_papers.kit.runs import OnStep, collisions_of, run_config, simulated, started_source, truth_of
from trailmark_papers.kit.stores import arrays_of, keyframes_of, path_of
from trailmark_papers.kit.sweeps import grouped, sweep
from trailmark_papers.kit.tables import Table, beside_faithful
from trailmark_papers.kit.watching import Watcher, show, timed

__all__ = [
    "AnswerKeeper", "FrameKeeper", "OnStep", "Table", "Trial", "Watcher", "arrays_of", "beside_faithful",
    "collisions_of", "grouped", "keyframes_of", "largest_of", "mean_of", "over_places", "panels", "path_of", "rms",
    "run_config", "sd_of", "show", "simulated", "spread_of", "started_source", "sweep", "timed", "truth_of",
]  # fmt: skip
