"""Work in processes of its own: what crashes, hangs or eats memory there is an outcome here, and no more.

Experiments make calls this way (`calls`), benches run cells (the plugin ``bench``). Where cells run is the business of
executors, which are plugins: their interface is here, so that one can be written without the bench.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trailmark.isolation.executor import Executor, ExecutorConfig, ExecutorLostError, Finished, Job
    from trailmark.isolation.outcome import Outcome
    from trailmark.isolation.process import IsolatedProcess

__all__ = ["Executor", "ExecutorConfig", "ExecutorLostError", "Finished", "IsolatedProcess", "Job", "Outcome"]

_LAZY = {
    "Executor": "executor",
    "ExecutorConfig": "executor",
    "ExecutorLostError": "executor",
    "Finished": "executor",
    "IsolatedProcess": "process",
    "Job": "executor",
    "Outcome": "outcome",
}


def __getattr__(name: str) -> Any:  # a process of a cell imports this package and little of it
    if name not in _LAZY:
        raise AttributeError(f"module 'trailmark.isolation' has no attribute {name!r}")
    return getattr(import_module(f"trailmark.isolation.{_LAZY[name]}"), name)
