"""Trajectories that no robot drives: units that cannot be, and ways that contradict each other."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations

import numpy as np

from trailmark.evaluation.run_folder import FUSED, RunFolder
from trailmark.evaluation.run_warning import RunWarning
from trailmark.evaluation.way_comparison import WayComparison, compare_ways
from trailmark.geometry import Trajectory

__all__ = ["warnings_of_motion"]

#: Nothing on wheels is faster; units are wrong then [m/s, rad/s].
MOST_MPS = 60.0
MOST_RADPS = 30.0
#: Estimates further apart than this are no odometry: stamps in other units [s].
LONGEST_INTERVAL_S = 20.0
#: Poses this far apart along which a robot creeps so slowly have stamps in other units, too [s, m/s, rad/s]: 5 m/s,
#: seen nearly 1000 times a second, look so where milliseconds are taken for seconds.
LONG_INTERVAL_S = 1.0
CREEPING_MPS, CREEPING_RADPS = 5e-3, 5e-3
#: What comes further than so many of its usual steps drives, and does not scatter about one place.
LEAST_STEPS_AWAY = 10.0
#: Two that move one robot: the way of one over that of the other, and the angle between their directions [deg].
MOST_RATIO = 2.0
MOST_TURNED_DEG = 45.0


def warnings_of_motion(run: RunFolder) -> Iterator[RunWarning]:
    """Yield which localizers tell units that cannot be, and which contradict the way of others.

    Parameters
    ----------
    run : RunFolder
        The run, as `read_run` returns it.

    Yields
    ------
    RunWarning
        In the order of the trajectories, units first.
    """
    yield from _of_units(run)
    yield from _of_ways(run)


def _of_units(run: RunFolder) -> Iterator[RunWarning]:
    for name, trajectory in run.trajectories.items():
        if len(trajectory) < 3:
            continue
        interval_s = float(np.median(np.diff(trajectory.stamps_s)))
        speed_mps, turn_radps = _usual_speeds(trajectory)
        is_creeping = interval_s > LONG_INTERVAL_S and speed_mps < CREEPING_MPS and turn_radps < CREEPING_RADPS
        if interval_s > LONGEST_INTERVAL_S or (is_creeping and _drives(trajectory)):
            at_speed = f", and it drives {speed_mps:.3g} m/s" if is_creeping else ""
            yield RunWarning(
                name,
                f"its poses are {interval_s:.3g} s apart{at_speed}",
                "stamps are seconds: are these milli- or nanoseconds?",
            )
            continue
        if speed_mps > MOST_MPS:
            yield RunWarning(
                name,
                f"it drives {speed_mps:.3g} m/s",
                "lengths are metres and stamps seconds: look for mm, or for metres_per_pixel in mm",
            )
        if turn_radps > MOST_RADPS:
            yield RunWarning(name, f"it turns by {turn_radps:.3g} rad/s", "angles inside are radians: look for degrees")


def _drives(trajectory: Trajectory) -> bool:
    """Return whether it gets away from where it began, and not only as far as its poses scatter."""
    steps_m = np.linalg.norm(np.diff(trajectory.positions, axis=0), axis=1)
    away_m = np.linalg.norm(trajectory.positions - trajectory.positions[0], axis=1)
    return float(away_m.max()) > LEAST_STEPS_AWAY * float(np.median(steps_m)) > 0.0


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
