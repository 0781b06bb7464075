"""What a run writes and reports: the taught path, and the events that sinks receive."""

from __future__ import annotations

import warnings
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, Self

from trailmark.commands import Command
from trailmark.estimates import Applied, Belief, Estimate, EstimateRecord
from trailmark.frames import Frame, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces.session import Access, LocalizerMap, Part
from trailmark.paths import Keyframe, Path, Waypoint

if TYPE_CHECKING:
    from trailmark.config.base import PluginConfig

__all__ = ["PathStore", "RunEnd", "Sink"]


class PathStore(Part):
    """Keeps a taught path. It belongs to the pipeline; localizers see their `LocalizerMap` only."""

    @classmethod
    def open(cls, config: PluginConfig, access: Access | None, base_dir: FilePath | None) -> Self | None:
        """Return a store for one access, constructed and not started; None if the config does not say which one.

        This default is for a config with the keys ``path`` (empty: not said) and ``access``; of a config that lacks
        one of them it leaves that alone.

        Parameters
        ----------
        config : PluginConfig
            The store's own keys.
        access : {"read", "create", "append", "overwrite"} or None
            How it is opened; None: for teaching, as the config says, or else ``create``.
        base_dir : Path or None
            Where a relative path starts; None: where we work.
        """
        from trailmark.config.files import resolve_path  # the config stands above the interfaces, and pydantic is slow

        keys = dict(config)
        if keys.get("path") == "":
            return None
        changes: dict[str, Any] = {}
        if keys.get("path"):
            changes["path"] = str(resolve_path(keys["path"], base_dir))
        if "access" in keys:
            changes["access"] = access or ("create" if keys["access"] == "read" else keys["access"])
        return cls(config.model_copy(update=changes))

    @abstractmethod
    def append(self, waypoint: Waypoint) -> None:
        """Add a waypoint to the open transaction.

        Parameters
        ----------
        waypoint : Waypoint
            The next waypoint of the path.
        """

    @abstractmethod
    def path(self) -> Path | None:
        """Return the committed path, or None while there is none."""

    @abstractmethod
    def localizer_map(self, owner: str) -> LocalizerMap:
        """Return the map of one localizer.

        Parameters
        ----------
        owner : str
            Name of the localizer in the config.

        Returns
        -------
        LocalizerMap
            Its map; empty where nothing was kept for it.
        """

    def drawer(self, owner: str) -> LocalizerMap:
        """Call `localizer_map` by its old name; it goes with version 0.3."""
        warnings.warn("PathStore.drawer is called localizer_map now", DeprecationWarning, stacklevel=2)
        return self.localizer_map(owner)

    @abstractmethod
    def commit(self) -> None:
        """Make everything so far durable: when this returns, a kill at any instant loses none of it."""

    def owners(self) -> tuple[str, ...]:
        """Return whose localizer maps there are; empty where the store cannot say."""
        return ()

    def move(self, waypoints: Sequence[Pose2], keyframes: Mapping[str, Sequence[Keyframe]]) -> bool:
        """Put the path, and what is remembered along it, where they lie after loops were closed; all of it or nothing.

        Part of the open transaction. Whose keyframes move is not finished any more.

        Parameters
        ----------
        waypoints : sequence of Pose2
            A pose for each waypoint.
        keyframes : mapping of str to sequence of Keyframe
            All keyframes of some owners, in their order.

        Returns
        -------
        bool
            False: the store cannot, and nothing is changed.
        """
        return False

    def is_finished(self, owner: str) -> bool:
        """Return whether `Localizer.finish` ran for this owner, or has nothing to work from.

        A store that keeps no book of it answers True: it cannot ask for what it cannot record.

        Parameters
        ----------
        owner : str
            Name of the localizer in the config.

        Returns
        -------
        bool
            True if nothing is left to do for it.
        """
        return True

    def mark_finished(self, owner: str) -> None:
        """Write down that `Localizer.finish` ran for this owner; part of the open transaction.

        Parameters
        ----------
        owner : str
            Name of the localizer in the config.
        """

    def set_sensors(self, sensors: Mapping[str, SensorInfo]) -> None:
        """Keep the sensors that the path is taught with; part of the open transaction.

        Parameters
        ----------
        sensors : mapping of str to SensorInfo
            Kind, size, calibration and mounting of each, by name.
        """

    def sensors(self) -> Mapping[str, SensorInfo]:
        """Return the sensors that the path was taught with, by name; empty where none were kept."""
        return {}

    def set_meta(self, meta: Mapping[str, Any]) -> None:
        """Keep the provenance of the path; part of the open transaction.

        Parameters
        ----------
        meta : mapping of str to Any
            Plain data for JSON: versions, git revision, config.
        """


@dataclass(frozen=True, slots=True)
class RunEnd:
    """How a run ended, as sinks receive it.

    Attributes
    ----------
    status : {"done", "stopped", "interrupted", "failed"}
        At the end of the frames or the goal; by the guard; by the user; by an error.
    reason : str
        One line, empty for a plain end.
    counters : mapping of str to int
        Frames, drops, late, gated, lost ..., by dotted name.
    """

    status: Literal["done", "stopped", "interrupted", "failed"]
    reason: str = ""
    counters: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))


class Sink(Part):
    """Receives the events of a run: a recorder, a viewer, a bridge. Each method does nothing unless overridden.

    Only methods that a sink overrides are called.
    """

    def on_frame(self, frame: Frame) -> None:
        """Receive a frame that was taken from a source.

        Parameters
        ----------
        frame : Frame
            The frame, after checks and faults; its arrays are read-only.
        """

    def on_estimate_record(self, record: EstimateRecord) -> None:
        """Receive an estimate that was applied.

        Parameters
        ----------
        record : EstimateRecord
            When it arrived, the localizer's name, the estimate, and what became of it.
        """
        self.on_estimate(record.source, record.estimate, record.outcome)

    def on_estimate(self, source: str, estimate: Estimate, applied: Applied) -> None:
        """Receive an estimate that was applied, without its arrival.

        `on_estimate_record` calls this unless it is overridden.

        Parameters
        ----------
        source : str
            Name of the localizer.
        estimate : Estimate
            What it said.
        applied : Applied
            What became of it.
        """

    def on_belief(self, belief: Belief) -> None:
        """Receive the belief after all localizers saw a frame.

        Parameters
        ----------
        belief : Belief
            Pose, covariance, twist and ages at the frame's stamp.
        """

    def on_command(self, stamp_s: float, command: Command) -> None:
        """Receive a command that was given.

        Parameters
        ----------
        stamp_s : float
            Stamp of the belief that it was computed from [s].
        command : Command
            The controller's command, or the guard's `Stop`.
        """

    def on_end(self, end: RunEnd) -> None:
        """Receive the end of the run.

        Parameters
        ----------
        end : RunEnd
            Status, reason and counters.
        """
