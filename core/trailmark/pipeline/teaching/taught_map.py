"""The taught map of a run: its path store, its path, and where its localizers remember."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any

from trailmark.errors import ConfigError, StoreFailedError
from trailmark.failures import raise_failure
from trailmark.frames import SensorInfo
from trailmark.frames.documents import sensor_to_document
from trailmark.geometry import Pose2, Trajectory
from trailmark.interfaces import Access, LocalizerMap, PathStore
from trailmark.paths import Path, TaughtPlaces
from trailmark.pipeline.instruments import Instruments
from trailmark.pipeline.lifecycle import PartStarter, Sessions
from trailmark.pipeline.localizers.runner import LocalizerFailedError
from trailmark.pipeline.outputs.provenance import provenance
from trailmark.pipeline.parts import LocalizerPart, Parts
from trailmark.pipeline.teaching.closing import close_loops, owners_beside
from trailmark.pipeline.teaching.guarded_store import GuardedMap, GuardedStore
from trailmark.pipeline.teaching.localizer_maps import ContinuedMap, VersionedMap, check_format
from trailmark.pipeline.teaching.true_places import keep_true_places, read_true_places
from trailmark.pipeline.teaching.way_log import WAY_LOG
from trailmark.pipeline.teaching.waypoints import Teaching

__all__ = ["TaughtMap", "open_taught_map"]

logger = logging.getLogger(__name__)


def open_taught_map(parts: Parts, starter: PartStarter) -> TaughtMap | None:
    """Open the path store of a run for reading alone, unless it teaches; None if the config names none.

    Raises
    ------
    ConfigError
        If a replay finds no path in it.
    """
    mode = parts.settings.mode
    store = _open_store(parts, parts.access if mode == "teach" else "read", starter)
    if store is None:
        return None
    taught = TaughtMap(parts, store, starter)
    if mode == "replay" and taught.path is None:
        raise ConfigError("the path store holds no path yet; teach one first")
    return taught


class TaughtMap:
    """A path store that is open, and what the run does with it.

    Attributes
    ----------
    path : Path or None
        The path as it was before the run; straightened, if a teaching that was interrupted is finished first.
    true_places : TaughtPlaces or None
        Where the places of the path really were, where somebody knows; of a replay, once `read_true_places` was called.
    teaching : Teaching or None
        Lays waypoints, in teach.
    """

    def __init__(self, parts: Parts, store: PathStore, starter: PartStarter) -> None:
        self.path: Path | None = store.path()
        self.true_places: TaughtPlaces | None = None
        self.teaching: Teaching | None = None
        self._parts = parts
        self._store = store
        self._starter = starter

    def localizer_map(self, part: LocalizerPart) -> LocalizerMap:
        """Return the map of a localizer; while teaching, one that relates keyframes lets the way be noted too.

        Raises
        ------
        StoreError
            If what is in it was remembered by a newer version of the localizer.
        """
        localizer_map = self._versioned_map(part)
        if self.teaching is not None and part.localizer.relates_keyframes:
            self.teaching.keep_log()
        offset_m = self.teaching.offset_m if self.teaching is not None else 0.0
        return ContinuedMap(localizer_map, offset_m) if offset_m else localizer_map

    def read_true_places(self) -> None:
        """Read where the places of the path really were, by which the run is judged."""
        self.true_places = read_true_places(self._store)

    # --- replay ----------------------------------------------------------------------------------------------------

    def warn_of_changes(self, sensors: Mapping[str, SensorInfo]) -> None:
        """Warn of sensors that are not as they were when the path was taught."""
        for name, taught in self._store.sensors().items():
            now = sensors.get(name)
            if now is None:
                continue
            before, after = sensor_to_document(taught), sensor_to_document(now)
            changed = sorted(key for key in before.keys() | after.keys() if before.get(key) != after.get(key))
            if changed and changed != ["rate_hz"]:
                logger.warning("sensor %r is not as it was when the path was taught: %s", name, ", ".join(changed))

    def finish_leftovers(self, localizers: Sequence[LocalizerPart], sessions: Sessions) -> None:
        """Finish the maps that an interrupted teaching left, before the path is used."""
        unfinished = self._localizers_to_finish(localizers)
        if not unfinished:
            return
        self._reopen("append")
        for part in unfinished:
            logger.info("teaching of %r was not finished: finishing it", part.name)
            session = sessions.session_of("localizer", part.name, mode="teach", map=self._versioned_map(part))
            self._starter.start("localizer", part.localizer, session)
        self.close_loops(unfinished)
        for part in unfinished:
            self.finish(part)
            part.localizer.close()
        self._reopen("read")
        self.path = self._store.path()

    def _localizers_to_finish(self, localizers: Sequence[LocalizerPart]) -> list[LocalizerPart]:
        """Return which are to finish; all that remember the path, if it is to be straightened first."""
        unfinished = [part for part in localizers if not self._store.is_finished(part.name)]
        if self._store.is_finished(WAY_LOG):
            return unfinished
        if not unfinished and owners_beside(self._store, {part.name for part in localizers}):
            return []
        owners = self._store.owners()
        return [part for part in localizers if part in unfinished or part.name in owners]

    # --- teaching --------------------------------------------------------------------------------------------------

    def begin_teaching(
        self,
        start_pose: Pose2 | None,
        *,
        sensors: Mapping[str, SensorInfo],
        document: Mapping[str, Any],
        instruments: Instruments,
    ) -> None:
        """Make ready to lay waypoints; the store keeps sensors, config and provenance with the first of them."""
        assert self._parts.path_store is not None
        self.teaching = Teaching(self._store, self._parts.path_store.options.spacing_m, start_pose, instruments)
        self._store.set_sensors(sensors)
        self._store.set_meta(provenance(self._parts.base_dir) | {"config": dict(document)})

    def close_loops(self, localizers: Sequence[LocalizerPart], switched_off: Sequence[LocalizerPart] = ()) -> int:
        """Straighten the path where places were seen twice; see `close_loops`."""
        return close_loops(self._store, localizers, switched_off)

    def keep_true_places(self, truth: Trajectory | None) -> None:
        """Keep where the waypoints really were, if that is known: a replay is judged in the map as it was taught."""
        if truth is not None and self.teaching is not None and self.teaching.stamps:
            keep_true_places(self._store, self.teaching.stamps, truth)

    def finish(self, part: LocalizerPart) -> None:
        """Call a localizer's `finish` (select, train, index), and record that it ran.

        Raises
        ------
        LocalizerFailedError
            If it fails at that.
        """
        try:
            part.localizer.finish()
        except BaseException as error:
            raise_failure(
                error, f"localizer {part.name!r}", "finish", kind=LocalizerFailedError, keeps=StoreFailedError
            )
        self._store.mark_finished(part.name)
        self._store.commit()

    def _versioned_map(self, part: LocalizerPart) -> LocalizerMap:
        localizer_map = self._store.localizer_map(part.name)
        check_format(localizer_map, part.name, part.localizer, is_continued=self.teaching is not None)
        versioned = VersionedMap(localizer_map, part.localizer.map_format)
        return versioned if self.teaching is None else GuardedMap(versioned)

    def _reopen(self, access: Access) -> None:
        self._store.close()
        store = _open_store(self._parts, access, self._starter)
        assert store is not None  # it was open before
        self._store = store


def _open_store(parts: Parts, access: Access | None, starter: PartStarter) -> PathStore | None:
    store = None if parts.path_store is None else parts.path_store.open(access, parts.base_dir)
    if store is not None:
        session = Sessions(parts.settings.mode, parts.settings.seed).session_of("path_store", "path_store")
        starter.start("path_store", store, session)
    return None if store is None else GuardedStore(store)
