"""Drives in a simulated world: a person teaches a way, a robot replays it, and both are known exactly."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.geometry import Trajectory
from trailmark.paths import Path as TaughtPath
from trailmark.paths import Waypoint
from trailmark.pipeline import Pipeline, RunResult, Step

__all__ = [
    "PEERS",
    "SPEED_MPS",
    "STREAMS",
    "Deviation",
    "OnStep",
    "Place",
    "Taught",
    "deviation",
    "replay",
    "teach",
    "way_of",
]

OnStep = Callable[[Pipeline, Step], None]

#: Speed of all experiments of the paper [m/s].
SPEED_MPS = 0.3
STREAMS: Mapping[str, Any] = {"plugin": "divs", "camera": "front"}
#: What people would use instead, on the same rows of the picture.
PEERS: Mapping[str, Mapping[str, Any]] = {
    "columns": {"plugin": "column_ncc", "camera": "front", "region": [0.0, 0.5]},
    "patches": {"plugin": "patch_ncc", "camera": "front", "region": [0.0, 0.5]},
    "phase": {"plugin": "phase_shift", "camera": "front", "region": [0.0, 0.5]},
}

_WHEELS = {"wheels": {"plugin": "odometry"}}
_START_S = 0.3  # what a vehicle needs to gather speed, and to spare [s]
_PATIENCE = 1.4  # a replay ends after this many times what teaching took
_WAYPOINT_M = 0.05
_SETTLED_M = 2.0


@dataclass(frozen=True, slots=True)
class Place:
    """Where drives take place, and how finely the camera sees it.

    Attributes
    ----------
    world, route : str
        Of the simulator.
    length_m : float
        How much of the route is taught [m].
    width_px : int
        Width of the pictures; the view is always the same [px].
    options : mapping
        The world's own options in teaching.
    """

    world: str
    length_m: float
    width_px: int
    route: str = "straight"
    options: tuple[tuple[str, Any], ...] = (("time", "morning"),)

    def source(self, options: Mapping[str, Any], **more: Any) -> dict[str, Any]:
        """Return the config of the source."""
        given = {**dict(self.options), **options, "width_px": self.width_px}
        return {
            "plugin": "sim",
            "world": self.world,
            "route": self.route,
            "threads": 1,
            "options": given,
            **more,
        }


@dataclass(frozen=True, slots=True)
class Taught:
    """A taught way.

    Attributes
    ----------
    place : Place
        Where it is.
    store : Path
        The path store.
    truth : Trajectory
        Where the robot truly was.
    """

    place: Place
    store: Path
    truth: Trajectory


@dataclass(frozen=True, slots=True, eq=False)
class Deviation:
    """How a replay truly went.

    Attributes
    ----------
    stations_m, lateral_m, heading_rad : (N,) float64
        In coordinates of the way that was truly taught [m, m, rad].
    arrived : bool
        The controller said that the end was reached.
    """

    stations_m: npt.NDArray[np.float64]
    lateral_m: npt.NDArray[np.float64]
    heading_rad: npt.NDArray[np.float64]
    arrived: bool

    @property
    def end_m(self) -> float:
        """Offset at the end, without its sign [m]."""
        return abs(float(self.lateral_m[-1]))

    @property
    def end_deg(self) -> float:
        """Turn from the taught heading at the end, without its sign [deg]."""
        return abs(math.degrees(self.heading_rad[-1]))

    @property
    def largest_m(self) -> float:
        """Largest offset [m]."""
        return float(np.abs(self.lateral_m).max())

    @property
    def growth_m(self) -> float:
        """How much the offset grew after the first 2 m, at worst, over the least it had been since [m]."""
        later = np.abs(self.lateral_m[self.stations_m > _SETTLED_M])
        return float((later - np.minimum.accumulate(later)).max()) if len(later) else math.inf


def teach(
    folder: Path,
    place: Place,
    localizers: Mapping[str, Mapping[str, Any]],
    seed: int,
    on_step: OnStep | None = None,
    **source: Any,
) -> Taught:
    """Drive the route with a pilot who knows it, and remember it."""
    store = folder / "path.trail"
    told = place.source({}, duration_s=_START_S + place.length_m / SPEED_MPS, **source)
    config = {"sources": {"robot": told}, "localizers": {**_WHEELS, **localizers}, "seed": seed}
    result = _run(config, folder / "teach", mode="teach", store=store, access="overwrite", on_step=on_step)
    assert result.ground_truth is not None
    return Taught(place, store, result.ground_truth)


def replay(
    folder: Path,
    taught: Taught,
    options: Mapping[str, Any],
    localizers: Mapping[str, Mapping[str, Any]],
    seed: int,
    turned_deg: float = 0.0,
    use: Sequence[str] | None = None,
    controller: Mapping[str, Any] | None = None,
    put_down_m: float | None = None,
    on_step: OnStep | None = None,
) -> RunResult:
    """Put the robot down at the start, turned by a hand, and let it follow the path.

    Parameters
    ----------
    folder : Path
        Of the run.
    options : mapping
        Options of the world that differ from teaching.
    use : sequence of str, optional
        Localizers that are believed besides the wheels; default: all.
    controller : mapping, optional
        Options of `drift_steering`.
    put_down_m : float, optional
        Put it down that far along a straight route instead, and do not tell it where [m].
    """
    limit_s = _PATIENCE * (_START_S + taught.place.length_m / SPEED_MPS)
    source = taught.place.source(options, put_off=[0.0, 0.0, turned_deg], duration_s=limit_s)
    config: dict[str, Any] = {
        "sources": {"robot": source},
        "localizers": {**_WHEELS, **localizers},
        "controller": {"plugin": "drift_steering", "speed_mps": SPEED_MPS, **(controller or {})},
        "seed": seed,
    }
    if put_down_m is not None:
        config["start"] = "unknown"
        source["start"] = [put_down_m, 0.0, 0.0]
    if use is not None:
        config["estimator"] = {"plugin": "dead_reckoning", "use": ["wheels", *use]}
    return _run(config, folder, mode="replay", store=taught.store, on_step=on_step)


def way_of(truth: Trajectory) -> TaughtPath:
    """Return a trajectory as a path with a waypoint every 5 cm."""
    stations_m = truth.travelled_m()
    wanted = np.arange(0.0, stations_m[-1], _WAYPOINT_M)
    rows = np.unique(np.searchsorted(stations_m, wanted))
    return TaughtPath(Waypoint(k, float(stations_m[row]), truth[int(row)][1]) for k, row in enumerate(rows))


def deviation(taught: Taught, result: RunResult) -> Deviation:
    """Return how a replay deviated from what was truly taught."""
    assert result.ground_truth is not None
    way, found, near_m = way_of(taught.truth), [], None
    for k in range(len(result.ground_truth)):
        on_path = way.locate(result.ground_truth[k][1], near_m)
        near_m = on_path.station_m
        found.append((on_path.station_m, on_path.lateral_m, on_path.heading_rad))
    stations_m, lateral_m, heading_rad = np.array(found).T
    return Deviation(stations_m, lateral_m, heading_rad, "end of the path" in result.reason)


def _run(config: Mapping[str, Any], folder: Path, **how: Any) -> RunResult:
    from trailmark.api import run

    return run(config, folder, overwrite=True, report=False, **how)
