"""Drives in a simulated world: a person teaches a way, a robot replays it, and both are known exactly."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Trajectory
from trailmark.paths import Path as TaughtPath
from trailmark.paths import Waypoint
from trailmark.pipeline import RunResult
from trailmark_papers.kit import OnStep, run_config, sim_source, truth_of

__all__ = [
    "AFTERNOON",
    "FAITHFUL",
    "PEERS",
    "SPEED_MPS",
    "STREAMS",
    "Deviation",
    "Localizers",
    "Place",
    "Replay",
    "Taught",
]

#: Localizers of a config, by name.
Localizers: TypeAlias = Mapping[str, Mapping[str, Any]]

#: Speed of all experiments of the paper [m/s].
SPEED_MPS = 0.3
STREAMS: Mapping[str, Any] = {"plugin": "divs", "camera": "front"}
#: The same as printed; `drift_steering` has a preset of this name too.
FAITHFUL: Mapping[str, Any] = {**STREAMS, "preset": "paper"}
#: What people would use instead, on the same rows of the picture.
PEERS: Localizers = {
    name: {"plugin": plugin, "camera": "front", "region": [0.0, 0.5]}
    for name, plugin in (("columns", "column_ncc"), ("patches", "patch_ncc"), ("phase", "phase_shift"))
}
#: What differs from teaching, in the morning with nobody about.
AFTERNOON: Mapping[str, Any] = {"time": "afternoon", "people": 3}

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
    world_seed : int
        Which of the worlds of that kind.
    """

    world: str
    length_m: float
    width_px: int
    route: str = "straight"
    world_seed: int = 1

    @property
    def duration_s(self) -> float:
        """How long teaching takes [s]."""
        return _START_S + self.length_m / SPEED_MPS

    def source(self, options: Mapping[str, Any], **more: Any) -> dict[str, Any]:
        """Return the config of the source, in the morning where `options` do not say otherwise."""
        given = {"time": "morning", **options, "width_px": self.width_px}
        return sim_source(self.world, route=self.route, world_seed=self.world_seed, threads=1, options=given, **more)

    def teach(
        self,
        folder: Path,
        localizers: Localizers,
        seed: int,
        *,
        on_step: OnStep | None = None,
        sensors: Mapping[str, Any] | None = None,
    ) -> Taught:
        """Drive the route with a pilot who knows it, and remember it.

        Parameters
        ----------
        sensors : mapping, optional
            Keys of the source that give it other sensors.
        """
        store, source = folder / "path.trail", self.source({}, duration_s=self.duration_s, **(sensors or {}))
        config = {"sources": {"robot": source}, "localizers": {**_WHEELS, **localizers}, "seed": seed}
        result = run_config(config, folder / "teach", "teach", store=store, on_step=on_step)
        return Taught(self, store, truth_of(result))


@dataclass(frozen=True, slots=True)
class Replay:
    """How a taught way is driven again.

    Attributes
    ----------
    localizers : mapping
        Who looks, by name, besides the wheels.
    seed : int
        Of noise, people and slip.
    options : mapping
        Options of the world that differ from teaching.
    turned_deg : float
        How far a hand turns the robot at the start [deg].
    use : sequence of str, optional
        Localizers that are believed besides the wheels; default: all.
    controller : mapping
        Options of `drift_steering`.
    put_down_m : float, optional
        Put it down that far along a straight route instead, and do not tell it where [m].
    """

    localizers: Localizers
    seed: int
    options: Mapping[str, Any] = field(default_factory=dict)
    turned_deg: float = 0.0
    use: Sequence[str] | None = None
    controller: Mapping[str, Any] = field(default_factory=dict)
    put_down_m: float | None = None

    def config(self, place: Place) -> dict[str, Any]:
        """Return the config of the run."""
        put_off = [0.0, 0.0, self.turned_deg]
        source = place.source(self.options, put_off=put_off, duration_s=_PATIENCE * place.duration_s)
        config: dict[str, Any] = {
            "sources": {"robot": source},
            "localizers": {**_WHEELS, **self.localizers},
            "controller": {"plugin": "drift_steering", "speed_mps": SPEED_MPS, **self.controller},
            "seed": self.seed,
        }
        if self.put_down_m is not None:
            config["start"] = "unknown"
            source["start"] = [self.put_down_m, 0.0, 0.0]
        if self.use is not None:
            config["estimator"] = {"plugin": "dead_reckoning", "use": ["wheels", *self.use]}
        return config


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

    stations_m: Floats
    lateral_m: Floats
    heading_rad: Floats
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

    def path(self) -> TaughtPath:
        """Return the way that was truly taught, as a path with a waypoint every 5 cm."""
        stations_m = self.truth.travelled_m()
        wanted = np.arange(0.0, stations_m[-1], _WAYPOINT_M)
        rows = np.unique(np.searchsorted(stations_m, wanted))
        return TaughtPath(Waypoint(k, float(stations_m[row]), self.truth[int(row)][1]) for k, row in enumerate(rows))

    def replay(self, how: Replay, on_step: OnStep | None = None) -> RunResult:
        """Put the robot down at the start, turned by a hand, and let it follow the path."""
        with tempfile.TemporaryDirectory() as folder:
            return run_config(how.config(self.place), Path(folder), "replay", store=self.store, on_step=on_step)

    def deviation(self, result: RunResult) -> Deviation:
        """Return how a replay deviated from what was truly taught."""
        path, found, near_m = self.path(), [], None
        for _, pose in truth_of(result):
            on_path = path.locate(pose, near_m)
            near_m = on_path.station_m
            found.append((on_path.station_m, on_path.lateral_m, on_path.heading_rad))
        stations_m, lateral_m, heading_rad = np.array(found).T
        return Deviation(stations_m, lateral_m, heading_rad, "end of the path" in result.reason)

    def follow(self, how: Replay) -> Deviation:
        """Replay the way, and return how the robot deviated from it."""
        return self.deviation(self.replay(how))
