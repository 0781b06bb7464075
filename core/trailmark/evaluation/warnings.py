"""What a run should not be taken for a success without: a pure function of what the run left.

Each warning says the fact, with its number, and what to do about it. ``trailmark run`` prints them on standard error,
``--strict`` makes them a failure.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from trailmark.evaluation.counter_warnings import warnings_of_counters
from trailmark.evaluation.lost_reasons import reasons_of
from trailmark.evaluation.motion_warnings import warnings_of_motion
from trailmark.evaluation.run_folder import FUSED, RunFolder
from trailmark.evaluation.run_warning import RunWarning

__all__ = ["run_warnings"]

#: A camera sees no more ground than this, and no less [m].
WIDEST_GROUND_M = 30.0
NARROWEST_GROUND_M = 5e-3
#: A larger share of late or refused estimates is told.
MOST_UNUSABLE = 0.05
#: A larger share that contradicts the belief is no matter of outliers.
MOST_GATED = 0.5


def run_warnings(run: RunFolder) -> list[RunWarning]:
    """Return what is wrong with a run that may have ended well, in the order of localizers, motion, sensors.

    Parameters
    ----------
    run : RunFolder
        The run, as `read_run` returns it.

    Returns
    -------
    list of RunWarning
        A subject, what is wrong with it and what to do.
    """
    return [
        *_of_localizers(run),
        *_of_use(run),
        *warnings_of_motion(run),
        *_of_sensors(run.run.get("sensors")),
        *warnings_of_counters(run),
    ]


def _of_localizers(run: RunFolder) -> Iterator[RunWarning]:
    if run.estimates is None:
        return
    spoke = set(run.estimates.sources())
    for name in run.trajectories:
        if name != FUSED and name not in spoke and not _only_remembers(run, name):
            yield RunWarning(
                name,
                "said nothing in the whole run",
                "it never had what it waits for: its sensor, a belief or a way driven (a localizer that gives motion)",
            )
    for name in run.estimates.sources():
        own = run.estimates.of(name)
        counts, n = own.counts(), len(own)
        if counts.get("lost", 0) == n:
            if _only_remembers(run, name) and run.run["counters"].get(f"localizer.{name}.frozen", 0) == n:
                yield RunWarning(
                    name,
                    f"remembers nothing of {n} pictures: its sensor repeated itself",
                    "teach again where these are a large part of the way",
                    is_worthless=False,
                )
                continue
            reason = next(iter(reasons_of(own)), "")
            yield RunWarning(
                name, f"was lost all the time, {n} of {n} ({reason})", "change what the reason names, or leave it out"
            )
            continue
        for outcome, (most, remedy) in _REMEDIES.items():
            if counts.get(outcome, 0) > most * n:
                reason = next(iter(reasons_of(own, outcome)), "")
                fact = f"{counts[outcome]} of {n} estimates were {outcome} ({reason})"
                yield RunWarning(name, fact, remedy, is_worthless=counts[outcome] == n)


def _only_remembers(run: RunFolder, name: str) -> bool:
    """Return whether a localizer looked while a path was taught: it remembers, and has nothing to tell yet."""
    counters = run.run.get("counters")
    if run.run.get("mode") != "teach" or not isinstance(counters, Mapping):
        return False
    return any(str(key).startswith(f"localizer.{name}.") and value for key, value in counters.items())


#: Which share of an outcome is told, and what to do about it.
_REMEDIES = {
    "refused": (MOST_UNUSABLE, "look at its stamps (units, order, equal ones) and covariances"),
    "late": (MOST_UNUSABLE, "make it faster, lower its rate, or lengthen the estimator's history"),
    "gated": (
        MOST_GATED,
        "it or the belief is wrong all along: look at its mounting, its map and units, and at the start pose",
    ),
}


def _of_use(run: RunFolder) -> Iterator[RunWarning]:
    if run.estimates is not None and len(run.estimates) and not (run.estimates.outcome == "accepted").any():
        yield RunWarning(
            "",
            "no estimate was used, so the fused pose is not known or stands still",
            "look at the outcomes and reasons in estimates.csv, and at 'use' of the estimator",
        )


def _of_sensors(sensors: Any) -> Iterator[RunWarning]:
    if not isinstance(sensors, Mapping):
        return
    for name, sensor in sensors.items():
        calibration, size = (
            (sensor.get(key) for key in ("calibration", "size"))
            if isinstance(sensor, Mapping)
            else (
                None,
                None,
            )
        )
        scale = calibration.get("metres_per_pixel") if isinstance(calibration, Mapping) else None
        if not scale or not size:
            continue
        width_m = float(np.ravel(scale)[0]) * float(size[0])
        if not NARROWEST_GROUND_M <= width_m <= WIDEST_GROUND_M:
            yield RunWarning(
                str(name),
                f"a picture shows {width_m:.3g} m of ground",
                "metres_per_pixel is in metres: 0.4 mm per pixel are 0.0004",
            )
