"""Experiments that plugins register, and the rows that they report: the paper's figure beside ours."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

__all__ = ["CALLS_FOLDER", "Experiment", "ExperimentOptions", "Row"]

_T = TypeVar("_T")

#: Below the folder of an experiment: the answers of calls, until it is done.
CALLS_FOLDER = ".calls"


@dataclass(frozen=True, slots=True)
class Row:
    """One figure of an experiment.

    Attributes
    ----------
    experiment, item, unit : str
        Which experiment, what was measured, and in what unit.
    ours : float or None
        What was measured here; None when it could not be measured.
    paper, bar, stretch : float or None
        What the paper reports; what is asked for here; what would be better still.
    spread : float or None
        Standard deviation over seeds, in the same unit.
    better : {"lower", "higher"}
        Which way is better.
    n, seeds : int
        Samples and seeds behind the figure.
    note : str
        What a reader must know of it, such as how the paper measured.
    faithful : float or None
        The same figure of the method as the paper prints it, measured here beside ours.
    is_headline : bool
        It is one of the few that a page begins with.
    """

    experiment: str
    item: str
    unit: str
    ours: float | None
    paper: float | None = None
    bar: float | None = None
    stretch: float | None = None
    spread: float | None = None
    better: Literal["lower", "higher"] = "lower"
    n: int = 1
    seeds: int = 1
    note: str = ""
    faithful: float | None = None
    is_headline: bool = False

    @property
    def met(self) -> bool | None:
        """Whether ours reaches the bar; None without a bar."""
        if self.bar is None:
            return None
        if self.ours is None or not math.isfinite(self.ours):
            return False
        return self.ours <= self.bar if self.better == "lower" else self.ours >= self.bar

    def document(self) -> dict[str, Any]:
        """Return the row for JSON; numbers that are not finite become null."""
        row = {
            key: None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in asdict(self).items()
        }
        return row | {"met": self.met}


@dataclass(frozen=True, slots=True)
class ExperimentOptions:
    """What the command line asks of an experiment.

    Attributes
    ----------
    quick : bool
        Short versions, for a first look and for CI.
    seed : int
        First seed, of noise, people and the place; further seeds follow from it.
    out : Path
        Folder for runs and plots: every ``*.svg`` in it becomes a picture of the written results.
    report : callable
        Takes one line of progress.
    jobs : int
        Processes that independent runs may be spread over.
    is_kept : bool
        Keep the answers of `map` below `out` until the experiment is done: an interrupted one goes on where it was.
    place : int or None
        The simulated place of all drives (``world_seed``); None: every seed has a place of its own.
    places : int or None
        In how many places everything is repeated; None: as the experiment has it, one place where it is quick.
    """

    quick: bool
    seed: int
    out: Path
    report: Callable[[str], None]
    jobs: int = 1
    is_kept: bool = False
    place: int | None = None
    places: int | None = None

    def n_places(self, usual: int) -> int:
        """Return in how many places an experiment takes place that usually has so many, and one where it is quick."""
        return self.places or (1 if self.quick else usual)

    def place_of(self, seed: int) -> int:
        """Return the ``world_seed`` of drives with a seed: the place that was asked for, or one of the seed's own."""
        return seed + 1 if self.place is None else self.place

    @property
    def world_seed(self) -> int:
        """The place of the first seed."""
        return self.place_of(self.seed)

    def map(self, function: Callable[..., _T], arguments: Iterable[tuple[Any, ...]]) -> list[_T]:
        """Call a function with each tuple of arguments, in up to `jobs` processes, and return the answers in order.

        Parameters
        ----------
        function : callable
            Stands at the top of a module, so that another process finds it by name.
        arguments : iterable of tuple
            Plain data (`trailmark.isolation.plain`), as the answers are, unless all is done in this process: with one
            job, nothing kept.

        Raises
        ------
        Exception
            What the first failing call raised; calls that have not begun are dropped then.
        """
        calls = list(arguments)
        if self.jobs == 1 and not self.is_kept:
            return [function(*call) for call in calls]
        from trailmark.isolation.calls import call_in_cells

        return call_in_cells(function, calls, self.out / CALLS_FOLDER, self.jobs, self.report)


#: An experiment is a function, registered by ``registry.experiment(name, "module:function")``.
Experiment = Callable[[ExperimentOptions], Sequence[Row]]
