"""Starting the parts of a run, in the order in which they need each other."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from trailmark.arrays import Floats
from trailmark.config import RunSettings
from trailmark.errors import ConfigError, TrailmarkError
from trailmark.failures import call_guarded
from trailmark.frames import SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Estimator, Session
from trailmark.pipeline.instruments import LOCALIZER_COUNTS, Instruments, counts_of
from trailmark.pipeline.lifecycle import PartStarter, Sessions
from trailmark.pipeline.localizers import LocalizerRunner, new_runner
from trailmark.pipeline.localizers.estimator import EstimatorRunner
from trailmark.pipeline.parts import LocalizerPart, Parts
from trailmark.pipeline.sources.stream import corrected_sensors

if TYPE_CHECKING:
    from trailmark.paths import Path
    from trailmark.pipeline.control import Control
    from trailmark.pipeline.teaching.taught_map import TaughtMap

__all__ = ["RunningParts", "start_parts"]

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RunningParts:
    """The parts of a run at work.

    Attributes
    ----------
    parts : Parts
        What they were made of, with the localizers that fit the sensors.
    sensors : mapping of str to SensorInfo
        Of all sources, as the config corrects them.
    taught : TaughtMap or None
        The path store.
    localizers : sequence of LocalizerRunner
        In the order of the config.
    estimator : EstimatorRunner
        Makes the belief.
    control : Control or None
        Commands; None: there is no robot, no controller and no limit of `stop_when`.
    session : Session
        What all parts are told alike.
    told_poses : deque
        Poses, with their covariances, that a source was told and the estimator is to be told next.
    closing : ExitStack
        Closes all parts, the last first.
    not_closed : list of TrailmarkError
        What they raised when they were closed.
    """

    parts: Parts
    sensors: Mapping[str, SensorInfo]
    taught: TaughtMap | None
    localizers: Sequence[LocalizerRunner]
    estimator: EstimatorRunner
    control: Control | None
    session: Session
    told_poses: deque[tuple[Pose2, Floats | None]]
    closing: ExitStack
    not_closed: list[TrailmarkError]

    @property
    def path(self) -> Path | None:
        """The path as it was before the run."""
        return None if self.taught is None else self.taught.path

    def own_counters(self) -> Iterator[tuple[str, Callable[[], Mapping[str, int]]]]:
        """Yield what asks each part for what it counted itself, with the part's dotted name."""
        for source in self.parts.sources:
            yield f"source.{source.name}", partial(call_guarded, f"source {source.name!r}", "counters", source.counters)
        for part in self.parts.localizers:
            yield f"localizer.{part.name}", partial(_localizer_counts, part)
        yield "estimator", partial(_estimator_counts, self.parts.estimator)


def start_parts(parts: Parts, pushed: Mapping[str, SensorInfo], instruments: Instruments) -> RunningParts:
    """Start the parts of a run: path store, sources, localizers, estimator, controller, sinks.

    What has started when a later part does not is closed again.

    Parameters
    ----------
    parts : Parts
        Constructed.
    pushed : mapping of str to SensorInfo
        Sensors of frames that are pushed, where there is no source.
    instruments : Instruments
        Of the run.

    Raises
    ------
    ConfigError
        If parts do not fit together.
    RunError, DataError
        If a part does not start.
    """
    _refuse_two_clocks(parts)
    mode, seed = parts.settings.mode, parts.settings.seed
    with ExitStack() as closing:
        starter = PartStarter(closing, instruments.times)
        taught = _taught_map(parts, starter)
        path = None if taught is None else taught.path
        start_pose = _start_pose(parts.settings, path)
        sessions = Sessions(mode, seed, None if mode == "teach" else path, start_pose)
        told_poses: deque[tuple[Pose2, Floats | None]] = deque()
        sources = replace(sessions, tell_pose=lambda pose, covariance: told_poses.append((pose, covariance)))
        sensors = corrected_sensors(pushed, parts.sensors) | _start_sources(parts, sources, starter, instruments)
        sessions = replace(sessions, sensors=sensors)
        parts = parts.fitted_to(sensors)
        if taught is not None and mode == "teach":
            taught.begin_teaching(start_pose, sensors=sensors, document=parts.document, instruments=instruments)
        elif taught is not None:
            taught.warn_of_changes(sensors)
            taught.finish_leftovers(parts.localizers, sessions)
            taught.read_true_places()
            start_pose = _start_pose(parts.settings, taught.path)
            sessions = replace(sessions, path=taught.path, start_pose=start_pose)
        localizers = [new_runner(part, sensors, parts.is_realtime, instruments) for part in parts.localizers]
        for localizer in localizers:
            _start_localizer(localizer, taught, sessions, starter)
        starter.start("estimator", parts.estimator, sessions.session_of("estimator", "estimator"))
        control = _start_control(parts, sessions, starter, instruments)
        for name, sink in parts.sinks.items():
            starter.start("sink", sink, sessions.session_of("sink", name))
        return RunningParts(
            parts=parts,
            sensors=sensors,
            taught=taught,
            localizers=localizers,
            estimator=EstimatorRunner(parts.estimator, parts.use, instruments.times.stage("estimator")),
            control=control,
            session=sessions.session_of("run", "run"),
            told_poses=told_poses,
            closing=closing.pop_all(),
            not_closed=starter.not_closed,
        )


def _localizer_counts(part: LocalizerPart) -> dict[str, int]:
    return call_guarded(
        f"localizer {part.name!r}", "counters", lambda: counts_of(part.localizer.counters(), LOCALIZER_COUNTS)
    )


def _estimator_counts(estimator: Estimator) -> dict[str, int]:
    return call_guarded("the estimator", "counters", lambda: counts_of(estimator.counters()))


def _refuse_two_clocks(parts: Parts) -> None:
    if parts.is_live and not all(source.is_live for source in parts.sources):
        live = ", ".join(source.name for source in parts.sources if source.is_live)
        recorded = ", ".join(source.name for source in parts.sources if not source.is_live)
        raise ConfigError(f"{live} live and {recorded} recorded: two clocks make no run")


def _taught_map(parts: Parts, starter: PartStarter) -> TaughtMap | None:
    mode, taught = parts.settings.mode, None
    if parts.path_store is not None:
        from trailmark.pipeline.teaching.taught_map import open_taught_map  # most runs have no store

        taught = open_taught_map(parts, starter)
    if taught is None and mode != "track":
        raise ConfigError(f"mode {mode} needs a path store: give one with --store, or as path_store.path")
    return taught


def _start_pose(settings: RunSettings, path: Path | None) -> Pose2 | None:
    """Return base in the map at the start; None: unknown."""
    start = settings.start
    if settings.start_pose is not None or start == "unknown":
        return settings.start_pose
    if start == "last" and path is None:
        raise ConfigError("start: last needs a taught path; give a store, or start: [x, y, deg]")
    if path is None or (start == "first" and settings.mode == "teach"):
        return Pose2()
    return path[0 if start == "first" else -1].pose_map_base


def _start_sources(
    parts: Parts, sessions: Sessions, starter: PartStarter, instruments: Instruments
) -> dict[str, SensorInfo]:
    sensors: dict[str, SensorInfo] = {}
    for source in parts.sources:
        session = sessions.session_of("source", source.name)
        times = instruments.times.stage(f"source.{source.name}")
        start = partial(source.start, session, instruments.counters, times)
        starter.run("source", source.name, start, source.close)
        sensors |= source.known_sensors(parts.sensors)
    return sensors


def _start_localizer(
    runner: LocalizerRunner, taught: TaughtMap | None, sessions: Sessions, starter: PartStarter
) -> None:
    part = runner.part
    session = sessions.session_of(
        "localizer",
        part.name,
        map=None if taught is None else taught.localizer_map(part),
        last_latency_s=runner.last_latency_s,
    )
    starter.run("localizer", part.name, lambda: runner.start(session), part.localizer.close)
    starter.on_close(f"the runner of localizer {part.name!r}", runner.close)


def _start_control(parts: Parts, sessions: Sessions, starter: PartStarter, instruments: Instruments) -> Control | None:
    settings, robot = parts.settings, parts.robot
    drives_itself = robot is not None and robot.drives_itself
    is_played = robot is None and settings.mode == "teach"  # a recording is taught: nobody is to be driven
    controller = None if drives_itself or is_played else parts.controller
    if drives_itself and parts.controller is not None and settings.mode != "teach":
        logger.warning(
            "the robot of source %r drives itself, the controller is not asked: give the source `driver: commands`",
            _robot_name(parts),
        )
    if robot is not None:
        _check_robot(parts, is_driven=controller is not None or drives_itself)
    is_driven_live = parts.is_live and controller is not None
    is_guarded = settings.mode != "teach" and (is_driven_live or settings.stop_when.limits_belief)
    if controller is None and robot is None and not is_guarded:
        return None
    from trailmark.pipeline.control import Control, Guard, Robot, check_commands  # most runs drive nothing

    if controller is not None:
        if robot is not None:
            check_commands(controller, robot)
        starter.start("controller", controller, sessions.session_of("controller", "controller"))
    guard = Guard(settings.stop_when, is_live=is_driven_live) if is_guarded else None
    return Control(controller, None if robot is None else Robot(robot), guard, settings.control_hz, instruments)


def _check_robot(parts: Parts, is_driven: bool) -> None:
    if not parts.is_realtime and len(parts.sources) > 1:
        raise ConfigError(
            "in step pace a robot is the only source of its run, and this run has"
            f" {', '.join(source.name for source in parts.sources)}:"
            " the frames of the others would be ahead of its commands"
        )
    if not is_driven:
        raise ConfigError(f"the robot of source {_robot_name(parts)!r} does not drive by itself: add a controller")


def _robot_name(parts: Parts) -> str:
    return next(source.name for source in parts.sources if source.drivable is not None)
