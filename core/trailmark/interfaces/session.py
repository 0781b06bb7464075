"""The base of every part: its life, its session, and its own place in the path store."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from trailmark.frames import SensorInfo
from trailmark.geometry import Pose2
from trailmark.paths import Keyframe, Path

__all__ = ["Access", "LocalizerMap", "Mode", "Pace", "Part", "Session"]

#: What a run is for: to localize only, to remember a path, or to come back to a remembered one.
Mode = Literal["track", "teach", "replay"]

#: How fast a run goes: as fast as possible and reproducible, or held to the stamps.
Pace = Literal["step", "realtime"]

#: How a path store is opened: ``read`` changes nothing, ``append`` goes on with the path in it.
Access = Literal["read", "create", "append", "overwrite"]


class LocalizerMap(ABC):
    """One localizer's own place in the path store; usable from any thread, writable in teach."""

    @abstractmethod
    def add(self, keyframe: Keyframe) -> None:
        """Remember a keyframe; it is committed with the waypoint that follows it.

        Parameters
        ----------
        keyframe : Keyframe
            Pose, stamp, station and the localizer's own arrays.

        Raises
        ------
        StoreError
            If the store is open for reading only.
        """

    @abstractmethod
    def keyframes(self) -> Sequence[Keyframe]:
        """Return all keyframes in the order in which they were added."""

    @abstractmethod
    def save(self, name: str, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Store named arrays under a name, replacing what stood there.

        Parameters
        ----------
        name : str
            Of the arrays' place; the localizer chooses it.
        arrays : mapping of str to array
            Arrays of numbers or booleans, by name.
        """

    @abstractmethod
    def load(self, name: str) -> Mapping[str, npt.NDArray[Any]] | None:
        """Return the arrays saved under a name.

        Parameters
        ----------
        name : str
            As it was given to `save`.

        Returns
        -------
        mapping of str to array or None
            The arrays, read-only; None where nothing was saved.
        """


def _default_rng() -> np.random.Generator:
    return np.random.default_rng(0)


def _no_latency() -> float:
    return 0.0


def _ignore_pose(pose_map_base: Pose2, covariance: npt.NDArray[np.float64] | None = None) -> None:
    """Take a pose and do nothing: the default of `Session.tell_pose`."""


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """What one part is given when it starts. Every field has a default.

    Attributes
    ----------
    name : str
        The part's name in the config.
    mode : {"track", "teach", "replay"}
        Localize only, remember a path, or come back to a remembered one.
    sensors : mapping of str to SensorInfo
        All sensors of the run, by name.
    path : Path or None
        The taught path, in replay (and in track with a store).
    start_pose : Pose2 or None
        Base in the map at the start; None: unknown.
    map : LocalizerMap or None
        This part's own place in the store.
    rng : numpy.random.Generator
        Seeded from (seed, kind, name): adding a part changes no other part's numbers.
    last_latency_s : callable
        Returns the duration of this part's last call: measured in realtime, modelled in step [s].
    tell_pose : callable
        For sources: ``tell_pose(pose_map_base, covariance)`` passes on where a person says that the robot is. From any
        thread; the estimator's `Estimator.set_pose` is told before the next frame.
    """

    name: str = ""
    mode: Mode = "track"
    sensors: Mapping[str, SensorInfo] = field(default_factory=lambda: MappingProxyType({}))
    path: Path | None = None
    start_pose: Pose2 | None = None
    map: LocalizerMap | None = None
    rng: np.random.Generator = field(default_factory=_default_rng)
    last_latency_s: Callable[[], float] = _no_latency
    tell_pose: Callable[[Pose2, npt.NDArray[np.float64] | None], None] = _ignore_pose

    @property
    def drawer(self) -> LocalizerMap | None:
        """The old name of `map`; it goes with version 0.3."""
        warnings.warn("Session.drawer is called Session.map now", DeprecationWarning, stacklevel=2)
        return self.map


class Part(ABC):  # noqa: B024  (each kind of part has abstract methods of its own)
    """Anything that a config can name.

    Parameters
    ----------
    config : Any
        The part's validated options.
    """

    def __init__(self, config: Any) -> None:
        """Keep the config. Cheap: opens no file or device and compiles nothing."""
        self.config = config

    def start(self, session: Session) -> None:  # noqa: B027  (a default on purpose)
        """Open, load and warm up.

        The pipeline calls it before the clock starts. Called again, the part is as new.

        Parameters
        ----------
        session : Session
            Sensors, path, start pose, random numbers and the part's own map.
        """

    def close(self) -> None:  # noqa: B027
        """Release what `start` took. Any thread, any state, twice."""

    def counters(self) -> Mapping[str, int]:
        """Return what the part counted since `start`, by name: skipped frames, retries, overflows."""
        return {}
