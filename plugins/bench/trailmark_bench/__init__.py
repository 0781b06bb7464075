"""The bench: localizers, pipelines, sources, faults and seeds crossed; cells that cannot hurt each other; tables."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trailmark.isolation.executor import Executor, ExecutorConfig, Finished, Job
    from trailmark.isolation.outcome import Outcome
    from trailmark_bench.cell import Cell
    from trailmark_bench.index import Index
    from trailmark_bench.matrix import Bench, load_bench
    from trailmark_bench.scheduler import run_bench

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
    "Bench": "trailmark_bench.matrix",
    "Cell": "trailmark_bench.cell",
    "Executor": "trailmark.isolation.executor",
    "ExecutorConfig": "trailmark.isolation.executor",
    "Finished": "trailmark.isolation.executor",
    "Index": "trailmark_bench.index",
    "Job": "trailmark.isolation.executor",
    "Outcome": "trailmark.isolation.outcome",
    "load_bench": "trailmark_bench.matrix",
    "run_bench": "trailmark_bench.scheduler",
}


def __getattr__(name: str) -> Any:  # the process of a cell imports this package and little of it
    if name not in _LAZY:
        raise AttributeError(f"module 'trailmark_bench' has no attribute {name!r}")
    return getattr(import_module(_LAZY[name]), name)
