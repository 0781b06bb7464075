"""The taught place of a run: its path store, its path, and where on it the robot starts."""

from __future__ import annotations

import logging
from array import array
from collections.abc import Mapping, Sequence
from typing import Any

from trailmark.errors import ConfigError
from trailmark.frames import SensorInfo
from trailmark.frames.documents import sensor_to_document
from trailmark.geometry import Pose2
from trailmark.interfaces import Access, LocalizerMap, PathStore
from trailmark.paths import Path
from trailmark.pipeline.counters import Counters
from trailmark.pipeline.map_format import VersionedMap, check_format
from trailmark.pipeline.plan import Plan, PlannedLocalizer
from trailmark.pipeline.provenance import provenance
from trailmark.pipeline.starting import Sessions, Starter, guarded
from trailmark.pipeline.teaching import ContinuedMap, Teaching

__all__ = ["Place"]

logger = logging.getLogger(__name__)


class Place:
    """Opens the path store of a run, if it has one: for reading alone, unless it teaches.

    Attributes
    ----------
    path : Path or None
        The path as it was before the run.
    start_pose : Pose2 or None
        Where the robot starts; None: unknown.
    teaching : Teaching or None
        Lays waypoints, in teach.

    Raises
    ------
    ConfigError
        If the run needs a store or a path and there is none.
    """

    def __init__(self, plan: Plan, starter: Starter) -> None:
        self._plan = plan
        self._starter = starter
        self._store: PathStore | None = None
        self.path: Path | None = None
        self.teaching: Teaching | None = None
        if plan.store is not None:
            self._store = self._open(plan.store.teach_access if plan.mode == "teach" else "read")
            self.path = self._store.path()
        elif plan.mode != "track":
            raise ConfigError(f"mode {plan.mode} needs a path store: give one with --store, or as path_store.path")
        if plan.mode == "replay" and self.path is None:
            raise ConfigError("the path store holds no path yet; teach one first")
        self.start_pose = self._start_pose()

    def localizer_map(self, planned: PlannedLocalizer) -> LocalizerMap | None:
        """Return the localizer map of a localizer; None without a store.

        Raises
        ------
        StoreError
            If what is in it was remembered by a newer version of the localizer.
        """
        if self._store is None:
            return None
        localizer_map = self._formatted(self._store, planned)
        offset_m = self.teaching.offset_m if self.teaching is not None else 0.0
        return ContinuedMap(localizer_map, offset_m) if offset_m else localizer_map

    def _formatted(self, store: PathStore, planned: PlannedLocalizer) -> LocalizerMap:
        localizer_map = store.localizer_map(planned.name)
        check_format(localizer_map, planned.name, planned.localizer, is_continued=self.teaching is not None)
        return VersionedMap(localizer_map, planned.localizer.map_format)

    def begin_teaching(
        self, sensors: Mapping[str, SensorInfo], document: Mapping[str, Any], counters: Counters, times: array[int]
    ) -> None:
        """Make ready to lay waypoints; the store keeps sensors, config and provenance with the first of them."""
        assert self._plan.store is not None
        assert self._store is not None
        self.teaching = Teaching(self._store, self._plan.store.spacing_m, self.start_pose, counters, times)
        self._store.set_sensors(sensors)
        self._store.set_meta(provenance(self._plan.config_dir) | {"config": dict(document)})

    def warn_of_changes(self, sensors: Mapping[str, SensorInfo]) -> None:
        """Say which sensors are not as they were when the path was taught."""
        if self._store is None or self._plan.mode == "teach":
            return
        for name, taught in self._store.sensors().items():
            now = sensors.get(name)
            if now is None:
                continue
            before, after = sensor_to_document(taught), sensor_to_document(now)
            changed = sorted(key for key in before.keys() | after.keys() if before.get(key) != after.get(key))
            if changed and changed != ["rate_hz"]:
                logger.warning("sensor %r is not as it was when the path was taught: %s", name, ", ".join(changed))

    def finish_teaching(self, localizers: Sequence[PlannedLocalizer]) -> None:
        """Let every localizer select, train and index what it was taught, and write down that it did."""
        assert self._store is not None
        for planned in localizers:
            _finish(planned, self._store)

    def finish_leftovers(self, localizers: Sequence[PlannedLocalizer], sessions: Sessions) -> None:
        """Let localizers finish what an interrupted teaching left, before the path is used."""
        if self._store is None or self._plan.mode == "teach":
            return
        unfinished = [planned for planned in localizers if not self._store.is_finished(planned.name)]
        if not unfinished:
            return
        self._store.close()
        store = self._open("append")
        for planned in unfinished:
            logger.info("teaching of %r was not finished: finishing it", planned.name)
            session = sessions.of("localizer", planned.name, mode="teach", map=self._formatted(store, planned))
            self._starter.start("localizer", planned.name, planned.localizer, session)
            _finish(planned, store)
            planned.localizer.close()
        store.close()
        self._store = self._open("read")

    def _open(self, access: Access | None) -> PathStore:
        assert self._plan.store is not None
        store = self._plan.store.build(access)
        session = Sessions(self._plan.mode, self._plan.seed).of("path_store", "path_store")
        self._starter.start("path_store", "path_store", store, session)
        return store

    def _start_pose(self) -> Pose2 | None:
        start, path = self._plan.start, self.path
        if isinstance(start, Pose2):
            return start
        if start == "unknown":
            return None
        if start == "last" and path is None:
            raise ConfigError("start: last needs a taught path; give a store, or start: [x, y, deg]")
        if path is None or (start == "first" and self._plan.mode == "teach"):
            return Pose2()
        return path[0 if start == "first" else -1].pose_map_base


def _finish(planned: PlannedLocalizer, store: PathStore) -> None:
    guarded(f"localizer {planned.name!r}", "could not finish", planned.localizer.finish)
    store.mark_finished(planned.name)
    store.commit()
