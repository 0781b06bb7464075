"""What a run should not be taken for a success without: a pure function of what the run left.

Each warning says the fact, with its number, and what to do about it. ``trailmark run`` prints them on standard error,
``--strict`` makes them a failure.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import numpy as np

from trailmark.evaluation.lost_reasons import reasons_of
from trailmark.evaluation.run_folder import FUSED, RunFolder
from trailmark.evaluation.way_comparison import WayComparison, compare_ways
from trailmark.geometry import Trajectory

__all__ = ["RunWarning", "collisions_of", "run_warnings"]

#: Nothing on wheels is faster; units are wrong then [m/s, rad/s].
MOST_MPS = 60.0
MOST_RADPS = 30.0
#: A camera sees no more ground than this, and no less [m].
WIDEST_GROUND_M = 30.0
NARROWEST_GROUND_M = 5e-3
#: Estimates further apart than this are no odometry: stamps in other units [s].
LONGEST_INTERVAL_S = 20.0
#: A larger share of dropped, late or refused estimates is told.
MOST_UNUSABLE = 0.05
#: Two that move one robot: the way of one over that of the other, and the angle between their directions [deg].
MOST_RATIO = 2.0
MOST_TURNED_DEG = 45.0
#: A larger share that contradicts the belief is no matter of outliers.
MOST_GATED = 0.5


@dataclass(frozen=True, slots=True)
class RunWarning:
    """A reason why the figures of a run are invalid, or less reliable than they look.

    Attributes
    ----------
    about : str
        The localizer or sensor; empty: the whole run.
    fact, remedy : str
        What is wrong, with its number; what to do about it.
    is_worthless : bool
        The figures say nothing at all; a bench takes the cell for failed.
    """

    about: str
    fact: str
    remedy: str
    is_worthless: bool = True

    def __str__(self) -> str:
        return f"{self.about}: {self.fact}; {self.remedy}" if self.about else f"{self.fact}; {self.remedy}"

    def document(self) -> dict[str, Any]:
        """Return it as plain data, for ``metrics.json``."""
        return asdict(self)


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
        *_of_motion(run),
        *_of_ways(run),
        *_of_sensors(run.run.get("sensors")),
        *_of_overlaps(run.run.get("counters")),
        *_of_control(run.run.get("counters")),
        *_of_collisions(run.run.get("counters")),
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


def _of_motion(run: RunFolder) -> Iterator[RunWarning]:
    for name, trajectory in run.trajectories.items():
        if len(trajectory) < 3:
            continue
        interval_s = float(np.median(np.diff(trajectory.stamps_s)))
        if interval_s > LONGEST_INTERVAL_S:
            yield RunWarning(
                name, f"its poses are {interval_s:.3g} s apart", "stamps are seconds: are these milli- or nanoseconds?"
            )
            continue
        speed_mps, turn_radps = _usual_speeds(trajectory)
        if speed_mps > MOST_MPS:
            yield RunWarning(
                name,
                f"it drives {speed_mps:.3g} m/s",
                "lengths are metres and stamps seconds: look for mm, or for metres_per_pixel in mm",
            )
        if turn_radps > MOST_RADPS:
            yield RunWarning(name, f"it turns by {turn_radps:.3g} rad/s", "angles inside are radians: look for degrees")


def _of_ways(run: RunFolder) -> Iterator[RunWarning]:
    """Yield which localizers tell another way than others do; a pair that contradicts says only that one is wrong.

    Only those are compared that told nothing but motions. Fixes scatter, so that the way through them is longer than
    what was driven, and may tell no heading: then nothing says where forward is.
    """
    own = {name: way for name, way in run.trajectories.items() if name != FUSED and _tells_motions_alone(run, name)}
    facts: dict[str, dict[str, str]] = {name: {} for name in own}
    for one, other in combinations(own, 2):
        for name, another in ((one, other), (other, one)):
            compared = compare_ways(own[name], own[another])
            if compared is not None and (fact := _contradiction(compared)):
                facts[name][another] = fact
    most = max((len(contradicted) for contradicted in facts.values()), default=0)
    told: set[str] = set()
    for name, contradicted in facts.items():
        if len(contradicted) < most or not most or told & contradicted.keys():
            continue
        told.add(name)
        others = " and ".join(repr(other) for other in contradicted)
        remedy = "look at the scale (metres_per_pixel, depth_factor) and mounting (yaw_deg) of"
        yield RunWarning(
            name,
            f"{next(iter(contradicted.values()))} {others}",
            f"{remedy} its sensor" if len(contradicted) > 1 else f"one of the two is wrong: {remedy} both sensors",
            is_worthless=False,
        )


def _tells_motions_alone(run: RunFolder, name: str) -> bool:
    if run.estimates is None:
        return False
    own = run.estimates.of(name)
    kinds = set(own.kind[own.outcome != "refused"].tolist()) - {"lost"}
    return kinds == {"motion"}


def _contradiction(compared: WayComparison) -> str:
    """Return in which way one contradicts another, up to the other's name; empty where it does not."""
    facts = []
    if not 1.0 / MOST_RATIO <= compared.ratio <= MOST_RATIO:
        facts.append(f"it comes {compared.ratio:.3g} times as far as")
    turned_deg = math.degrees(compared.turned_rad)
    if abs(turned_deg) > MOST_TURNED_DEG:
        facts.append(f"its forward is turned by {turned_deg:.0f} deg against that of")
    return ", and ".join(facts)


def _usual_speeds(trajectory: Trajectory) -> tuple[float, float]:
    """Return what three of four steps are slower than: 90 m/s for one frame may be an error, not a unit."""
    dt_s = np.diff(trajectory.stamps_s)
    ways_m = np.linalg.norm(np.diff(trajectory.positions, axis=0), axis=1)
    turns = np.abs(np.diff(np.unwrap(trajectory.headings)))
    return float(np.percentile(ways_m / dt_s, 75.0)), float(np.percentile(turns / dt_s, 75.0))


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


def _of_overlaps(counters: Any) -> Iterator[RunWarning]:
    for name, n in counters.items() if isinstance(counters, Mapping) else ():
        part, _, source = name.partition("overlaps.")
        if part == "estimator." and isinstance(n, int) and n > 0:
            yield RunWarning(
                source,
                f"{n} of its motions began before another one ended; what two of them cover counted once",
                "let each begin where the last one ended",
                is_worthless=False,
            )


def _of_control(counters: Any) -> Iterator[RunWarning]:
    n = counters.get("control.stall_stops", 0) if isinstance(counters, Mapping) else 0
    if isinstance(n, int) and n > 0:
        times = "once" if n == 1 else f"{n} times"
        yield RunWarning(
            "",
            f"the run stood still {times}, and the robot was stopped each time",
            "standard error says where; give slow localizers async: true, or raise stop_when.stall_s",
            is_worthless=False,
        )


def _of_collisions(counters: Any) -> Iterator[RunWarning]:
    n = collisions_of(counters) if isinstance(counters, Mapping) else 0
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
