"""Runs of plain configs: every part is named as a config names it, so that it can be swapped there."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from trailmark.deprecation import deprecated_name
from trailmark.errors import ConfigError
from trailmark.evaluation import collisions_of
from trailmark.geometry import Pose2, Trajectory
from trailmark.interfaces import FrameSource, Mode, Session

if TYPE_CHECKING:
    from trailmark.pipeline import Pipeline, RunResult, Step

__all__ = ["OnStep", "collisions_of", "run_config", "sim_source", "started_source", "truth_of", "world_of"]

OnStep = Callable[["Pipeline", "Step"], None]


class SimulatedRoute(Protocol):
    """A way to drive in a simulated world."""

    def pose_at(self, station_m: float) -> Pose2:
        """Return the pose so far along the way [m]."""


class SimulatedWorld(Protocol):
    """What experiments ask of a simulated world: its cameras, its ways, and what is exactly known of it."""

    @property
    def sensors(self) -> Sequence[Any]:
        """The sensors that the config names, in its order."""

    @property
    def routes(self) -> Mapping[str, SimulatedRoute]:
        """Ways to drive, by name."""

    @property
    def truth(self) -> Mapping[str, Any]:
        """Arrays of what stands there, by name."""


@runtime_checkable
class Simulator(Protocol):
    """A source that can say what no sensor of it measures."""

    @property
    def world(self) -> SimulatedWorld:
        """The world, once the source is started."""


def sim_source(world: str, **keys: Any) -> dict[str, Any]:
    """Return the config of a simulated source: a collision ends the drive, and so keeps it from its goal."""
    return {"plugin": "sim", "world": world, "on_collision": "end", **keys}


def run_config(
    config: Mapping[str, Any],
    folder: Path,
    mode: Mode = "track",
    *,
    store: Path | None = None,
    on_step: OnStep | None = None,
) -> RunResult:
    """Run a config into a folder, over what an earlier run left there, without a report.

    Parameters
    ----------
    store : Path, optional
        The path store: teaching overwrites it, a replay reads it.
    on_step : callable, optional
        Called with the pipeline and every step.
    """
    from trailmark.api import run

    return run(
        config,
        folder,
        mode=mode,
        store=store,
        access="overwrite" if mode == "teach" else None,
        overwrite=True,
        report=False,
        on_step=on_step,
    )


def truth_of(result: RunResult) -> Trajectory:
    """Return where the robot truly was: the simulator always knows."""
    assert result.ground_truth is not None
    return result.ground_truth


@contextmanager
def started_source(config: Mapping[str, Any], seed: int = 0, name: str = "robot") -> Iterator[FrameSource]:
    """Give a source that is started on its own, and close it."""
    from trailmark.api import create

    keys = dict(config)
    source: FrameSource = create("source", keys.pop("plugin"), **keys)
    source.start(Session(name, "track", rng=np.random.default_rng(seed)))
    try:
        yield source
    finally:
        source.close()


def world_of(source: FrameSource) -> SimulatedWorld:
    """Return the world of a started simulator.

    Raises
    ------
    ConfigError
        If the source is no simulator: no recording knows where the poles stood.
    """
    if not isinstance(source, Simulator):
        raise ConfigError(f"{type(source).__name__} has no world to look at; a simulated source has")
    return source.world


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"simulated": sim_source})
