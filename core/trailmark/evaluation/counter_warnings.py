"""What a run counted on its way that its figures do not show."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from trailmark.evaluation.run_folder import RunFolder
from trailmark.evaluation.run_warning import RunWarning

__all__ = ["collisions_of", "warnings_of_counters"]

#: A larger share of readings that were left out is told.
MOST_LEFT_OUT = 0.05


def warnings_of_counters(run: RunFolder) -> Iterator[RunWarning]:
    """Yield what a run counted and should not be taken for a success without.

    Parameters
    ----------
    run : RunFolder
        The run, as `read_run` returns it.

    Yields
    ------
    RunWarning
        Readings that were overwritten or of equal stamps, motions that overlap, stops and collisions.
    """
    counters = run.run.get("counters")
    if not isinstance(counters, Mapping):
        return
    yield from _of_overwritten(run, counters)
    yield from _of_repeats(counters)
    yield from _of_overlaps(counters)
    yield from _of_control(counters)
    yield from _of_collisions(counters)


def _of_overwritten(run: RunFolder, counters: Mapping[str, Any]) -> Iterator[RunWarning]:
    """Yield which localizers were busy for so long that they never saw a part of their readings."""
    if run.estimates is None:
        return
    for name in run.estimates.sources():
        n = counters.get(f"localizer.{name}.overwritten", 0)
        n_all = n + len(run.estimates.of(name))
        if n > MOST_LEFT_OUT * n_all:
            yield RunWarning(
                name,
                f"{n} of {n_all} readings were overwritten by newer ones while it was busy, so it answers more rarely",
                "make it faster, or lower the rate of its sensor",
                is_worthless=False,
            )


def _of_repeats(counters: Mapping[str, Any]) -> Iterator[RunWarning]:
    for key, n in counters.items():
        part, _, name = str(key).removesuffix(".repeated").removesuffix(".own").partition("source.")
        if part or ".perturb." in key or not key.endswith(".repeated") or not isinstance(n, int):
            continue
        n_all = n + counters.get(f"source.{name}.frames", 0)
        if n > MOST_LEFT_OUT * n_all:
            yield RunWarning(
                name,
                f"{n} of {n_all} readings had the stamp of the one before and were left out",
                "give each the time at which it was taken",
                is_worthless=False,
            )


def _of_overlaps(counters: Mapping[str, Any]) -> Iterator[RunWarning]:
    for name, n in counters.items():
        part, _, source = name.partition("overlaps.")
        if part == "estimator." and isinstance(n, int) and n > 0:
            yield RunWarning(
                source,
                f"{n} of its motions began before another one ended; what two of them cover counted once",
                "let each begin where the last one ended",
                is_worthless=False,
            )


def _of_control(counters: Mapping[str, Any]) -> Iterator[RunWarning]:
    n = counters.get("control.stall_stops", 0)
    if isinstance(n, int) and n > 0:
        times = "once" if n == 1 else f"{n} times"
        yield RunWarning(
            "",
            f"the run stood still {times}, and the robot was stopped each time",
            "standard error says where; give slow localizers async: true, or raise stop_when.stall_s",
            is_worthless=False,
        )


def _of_collisions(counters: Mapping[str, Any]) -> Iterator[RunWarning]:
    n = collisions_of(counters)
    if n > 0:
        times = "" if n == 1 else f" {n} times"
        yield RunWarning("", f"the robot touched something{times}", "it has not come through: look where, and why")


def collisions_of(counters: Mapping[str, Any]) -> int:
    """Return how often robots have touched an obstacle in a run: sources count it as ``collisions``.

    Parameters
    ----------
    counters : mapping of str to Any
        Counts of ``run.json``, by name.

    Returns
    -------
    int
        The sum over all sources.
    """
    numbers = (n for name, n in counters.items() if name.rpartition(".")[2] == "collisions")
    return sum(int(n) for n in numbers if isinstance(n, int | float))
