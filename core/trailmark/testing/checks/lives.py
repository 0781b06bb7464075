"""A localizer's life on a synthetic run: taught, finished, and asked again in replay, with true beliefs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.config import PluginConfig, sensor_roles
from trailmark.config.base import UNNAMED
from trailmark.estimates import Belief, Estimate, Fix, Lost, Motion, PathOffset, information_from_sigmas
from trailmark.frames import Frame, Payload
from trailmark.geometry import Twist2
from trailmark.interfaces import Localizer, LocalizerMap, Mode, Session
from trailmark.paths import Path, Waypoint
from trailmark.pipeline.teaching.localizer_maps import VersionedMap
from trailmark.stores import SqlitePathStore, SqliteStoreConfig
from trailmark.testing.memory_map import MemoryMap
from trailmark.testing.runs import AnyRun

__all__ = ["LocalizerCase", "LocalizerLife", "answers", "arrays_of", "document_of", "spoil_frame", "true_belief"]

_SPACING_M = 0.05
_SIGMAS = (0.01, 0.01, 0.005)  # of the beliefs that the localizers are asked with [m, m, rad]


@dataclass(frozen=True)
class LocalizerLife:
    """What a localizer said: while it was taught, and afterwards over the same frames in replay.

    Attributes
    ----------
    taught : tuple of Estimate
        Estimates while it was taught, in order.
    replayed : tuple of Estimate
        Estimates over the same frames in replay, in order.
    """

    taught: tuple[Estimate, ...]
    replayed: tuple[Estimate, ...]

    def __iter__(self) -> Iterator[Estimate]:
        return iter((*self.taught, *self.replayed))


@dataclass(frozen=True)
class LocalizerCase:
    """A localizer with its config and the run that it is checked on.

    Attributes
    ----------
    localizer : type
        The class.
    config : PluginConfig
        Its config.
    frames : run or callable
        The run, or a function that makes it.
    """

    localizer: type[Localizer]
    config: PluginConfig
    frames: AnyRun | Callable[[], AnyRun]

    @cached_property
    def run(self) -> AnyRun:
        """The run, made when it is first asked for."""
        return self.frames() if callable(self.frames) else self.frames

    def make(self) -> Localizer:
        """Return the localizer, its roles filled with the run's sensors."""
        return self.localizer(self.config.model_copy(update=self._roles()))

    def _roles(self) -> dict[str, str]:
        """Return the roles that the config leaves open, each with the first sensor of a fitting kind."""
        found: dict[str, str] = {}
        for role, mark in sensor_roles(type(self.config)).items():
            if getattr(self.config, role) == UNNAMED:
                sensors = self.run.sensors.values()
                fitting = [info.name for info in sensors if not mark.kinds or info.kind in mark.kinds]
                assert fitting, f"the run has no sensor for the role {role!r}, which takes {', '.join(mark.kinds)}"
                found[role] = fitting[0]
        return found

    def frames_asked_for(self, frames: Sequence[Frame] | None = None) -> Iterator[Frame]:
        """Yield the frames of the sensors that the config names."""
        config = self.config.model_copy(update=self._roles())
        named = {getattr(config, role) for role in sensor_roles(type(config))}
        return (frame for frame in (self.run.frames if frames is None else frames) if frame.sensor in named)

    @cached_property
    def path(self) -> Path:
        """The true path, with a waypoint every 5 cm."""
        return Path(_waypoints(self.run))

    def session(self, mode: Mode, localizer_map: LocalizerMap | None, seed: int = 0) -> Session:
        """Return the session that the pipeline would give it."""
        start_pose = self.run.truth[0][1]
        path = self.path if mode == "replay" else None
        rng = np.random.default_rng(seed)
        return Session("checked", mode, self.run.sensors, path, start_pose, localizer_map, rng)

    @cached_property
    def life(self) -> LocalizerLife:
        """What fresh localizers say, lived when it is first asked for: most checks look at the same life."""
        localizer_map, taught = self._teaching
        return LocalizerLife(taught, self.replay(localizer_map.copy()))

    @cached_property
    def _teaching(self) -> tuple[MemoryMap, tuple[Estimate, ...]]:
        localizer_map = MemoryMap()
        return localizer_map, self.teach(localizer_map)

    def taught_map(self) -> MemoryMap:
        """Return a copy of what a fresh localizer remembers of the run."""
        return self._teaching[0].copy()

    def run_life(self, localizer: Localizer | None = None) -> LocalizerLife:
        """Teach a localizer the run, let it finish, and ask it again in replay; None: a fresh one for each."""
        localizer_map = MemoryMap()
        taught = self.teach(localizer_map, localizer or self.make())
        return LocalizerLife(taught, self.replay(localizer_map, localizer or self.make()))

    def teach(self, localizer_map: LocalizerMap, localizer: Localizer | None = None) -> tuple[Estimate, ...]:
        """Teach the run into a localizer map, and return what was said."""
        localizer = localizer or self.make()
        localizer.start(self.session("teach", VersionedMap(localizer_map, localizer.map_format)))
        said = tuple(answers(localizer, self, self.frames_asked_for(), on_path=False))
        localizer.finish()
        localizer.close()
        return said

    def replay(self, localizer_map: LocalizerMap, localizer: Localizer | None = None) -> tuple[Estimate, ...]:
        """Return what is said over the run with what a localizer map remembers."""
        localizer = localizer or self.make()
        localizer.start(self.session("replay", localizer_map))
        said = tuple(answers(localizer, self, self.frames_asked_for(), on_path=True))
        localizer.close()
        return said

    @contextmanager
    def ready(self) -> Iterator[Localizer]:
        """Give a localizer that was taught the run and has started in replay."""
        localizer = self.make()
        localizer.start(self.session("replay", self.taught_map()))
        try:
            yield localizer
        finally:
            localizer.close()

    @contextmanager
    def store(self) -> Iterator[Callable[[], SqlitePathStore]]:
        """Give a function that opens a store on disk which the run was taught into."""
        with TemporaryDirectory() as folder:
            place = str(FilePath(folder) / "place.trail")
            store = _open_store(place, "create")
            self.teach(store.localizer_map("checked"))
            for waypoint in _waypoints(self.run):
                store.append(waypoint)
            store.commit()
            store.close()
            opened: list[SqlitePathStore] = []

            def reopen() -> SqlitePathStore:
                opened.append(_open_store(place, "read"))
                return opened[-1]

            try:
                yield reopen
            finally:
                for one in opened:
                    one.close()


def answers(
    localizer: Localizer, case: LocalizerCase, frames: Sequence[Frame] | Iterator[Frame], on_path: bool
) -> Iterator[Estimate]:
    """Yield what a started localizer says to frames, each with the true belief of its stamp."""
    path = case.path if on_path else None
    for frame in frames:
        yield from localizer.observe(frame, true_belief(case.run, frame.stamp_s, path))


def true_belief(run: AnyRun, stamp_s: float, path: Path | None = None) -> Belief:
    """Return the truth at a stamp as a belief of a centimetre and a third of a degree."""
    truth = run.truth
    inside_s = min(max(stamp_s, float(truth.stamps_s[0])), float(truth.stamps_s[-1]))
    _, pose = truth.at([inside_s])[0]
    information = information_from_sigmas(*_SIGMAS)
    on_path = None
    if path is not None:
        place = path.locate(pose)
        on_path = PathOffset(stamp_s, place.station_m, place.lateral_m, place.heading_rad, information)
    travelled_m = float(np.interp(inside_s, truth.stamps_s, truth.travelled_m()))
    covariance = np.diag(np.square(_SIGMAS))
    odometry = truth[0][1].between(pose)
    return Belief(stamp_s, pose, covariance, odometry, _twist(run, inside_s), travelled_m, on_path, 0.0, 0.0)


def _twist(run: AnyRun, stamp_s: float) -> Twist2:
    stamps = run.truth.stamps_s
    if len(stamps) < 2:
        return Twist2()
    index = int(np.clip(np.searchsorted(stamps, stamp_s), 1, len(stamps) - 1))
    (before_s, before), (after_s, after) = run.truth[index - 1], run.truth[index]
    forward_m, left_m, turn_rad = before.between(after).log()
    dt_s = after_s - before_s
    return Twist2(forward_m / dt_s, left_m / dt_s, turn_rad / dt_s)


def _waypoints(run: AnyRun) -> list[Waypoint]:
    stations, waypoints = run.truth.travelled_m(), list[Waypoint]()
    for index, (_, pose) in enumerate(run.truth):
        station_m = float(stations[index])
        if not waypoints or station_m >= waypoints[-1].station_m + _SPACING_M:
            waypoints.append(Waypoint(len(waypoints), station_m, pose))
    return waypoints


def _open_store(place: str, access: Any) -> SqlitePathStore:
    store = SqlitePathStore(SqliteStoreConfig(path=place, access=access))
    store.start(Session("path_store"))
    return store


def document_of(estimate: Estimate) -> tuple[Any, ...]:
    """Return an estimate as plain values that are equal only when every bit is."""
    details = tuple(sorted((key, repr(value)) for key, value in estimate.details.items()))
    match estimate:
        case Motion():
            numbers: tuple[Any, ...] = (estimate.since_s, estimate.pose_since_now, estimate.information.tobytes())
        case Fix():
            numbers = (estimate.pose_map_base, estimate.information.tobytes())
        case PathOffset():
            numbers = (estimate.station_m, estimate.lateral_m, estimate.heading_rad, estimate.information.tobytes())
        case Lost():
            numbers = (estimate.reason,)
    return type(estimate).__name__, estimate.stamp_s, numbers, details


def spoil_frame(frame: Frame, payload: Any) -> Frame:
    """Return a frame with another payload."""
    return replace(frame, payload=payload)


def arrays_of(payload: Payload) -> list[AnyArray]:
    """Return all arrays of a payload."""
    values = [getattr(payload, name, None) for name in getattr(type(payload), "__slots__", ())]
    values += list(getattr(payload, "arrays", {}).values())
    return [value for value in values if isinstance(value, np.ndarray)]
