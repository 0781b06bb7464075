"""The bench: localizers, pipelines, sources, faults and seeds crossed; cells that cannot hurt each other; tables."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trailmark.bench.cell import Cell
    from trailmark.bench.executor import Executor, ExecutorConfig, Finished, Job, Outcome
    from trailmark.bench.index import Index
    from trailmark.bench.matrix import Bench, load_bench
    from trailmark.bench.scheduler import run_bench

__all__ = [
    "Bench",
    "Cell",
    "Executor",
    "ExecutorConfig",
    "Finished",
    "Index",
    "Job",
    "Outcome",
    "load_bench",
    "run_bench",
]

_LAZY = {
    "Bench": "trailmark.bench.matrix",
    "Cell": "trailmark.bench.cell",
    "Executor": "trailmark.bench.executor",
    "ExecutorConfig": "trailmark.bench.executor",
    "Finished": "trailmark.bench.executor",
    "Index": "trailmark.bench.index",
    "Job": "trailmark.bench.executor",
    "Outcome": "trailmark.bench.executor",
    "load_bench": "trailmark.bench.matrix",
    "run_bench": "trailmark.bench.scheduler",
}


def __getattr__(name: str) -> Any:  # the process of a cell imports this package and little of it
    if name not in _LAZY:
        raise AttributeError(f"module 'trailmark.bench' has no attribute {name!r}")
    return getattr(import_module(_LAZY[name]), name)
