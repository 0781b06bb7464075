"""The independent runs of an experiment: one function, many cells, some at a time."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from typing import Any, TypeVar

from trailmark.deprecation import deprecated_name
from trailmark.experiments import ExperimentOptions

__all__ = ["group_by", "sweep"]

K = TypeVar("K", bound=Hashable)
G = TypeVar("G", bound=Hashable)
T = TypeVar("T")


def sweep(options: ExperimentOptions, function: Callable[..., T], cells: Mapping[K, tuple[Any, ...]]) -> dict[K, T]:
    """Call a function with the arguments of every cell, in up to ``options.jobs`` processes.

    Parameters
    ----------
    function : callable
        At the top of a module, as `ExperimentOptions.map` asks.
    cells : mapping of key to tuple
        The arguments of each call.

    Returns
    -------
    dict
        The answer of each cell, in their order.
    """
    return dict(zip(cells, options.map(function, cells.values()), strict=True))


def group_by(found: Mapping[K, T], group_of: Callable[[K], G]) -> dict[G, list[T]]:
    """Return answers by a group of their keys, in their order: the seeds of a condition, for example."""
    groups: dict[G, list[T]] = {}
    for key, answer in found.items():
        groups.setdefault(group_of(key), []).append(answer)
    return groups


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"grouped": group_by})
