"""The parts of a run, started in the order in which they need each other."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from trailmark.config import StopWhen
from trailmark.errors import ConfigError
from trailmark.frames import SensorInfo
from trailmark.interfaces import Drivable, Session
from trailmark.pipeline.async_step import AsyncStep
from trailmark.pipeline.control import Control, check_commands
from trailmark.pipeline.counters import Counters
from trailmark.pipeline.guard import Guard
from trailmark.pipeline.observing import Asked, Observing, SyncLocalizer
from trailmark.pipeline.pacing import RunClock
from trailmark.pipeline.place import Place
from trailmark.pipeline.plan import Plan, PlannedLocalizer
from trailmark.pipeline.sources import corrected
from trailmark.pipeline.starting import Sessions, Starter
from trailmark.pipeline.timing import StageTimes
from trailmark.pipeline.workers import Worker

__all__ = ["Rig"]

logger = logging.getLogger(__name__)


class Rig:
    """The parts of a run at work. What has started when a later part does not is closed again.

    Parameters
    ----------
    plan : Plan
        The parts.
    pushed : mapping of str to SensorInfo
        Sensors of frames that are pushed, where there is no source.

    Attributes
    ----------
    sensors : mapping of str to SensorInfo
        Of all sources, as the config corrects them.
    place : Place
        Path store, path and start.
    localizers : sequence of PlannedLocalizer
        In the order of the config.
    asked : sequence of Asked
        The same at work.
    control : Control
        Commands.
    document : mapping
        The resolved config.

    Raises
    ------
    ConfigError
        If parts do not fit together.
    RunError, DataError
        If a part does not start.
    """

    def __init__(
        self, plan: Plan, counters: Counters, times: StageTimes, clock: RunClock, pushed: Mapping[str, SensorInfo]
    ) -> None:
        self.plan = plan
        self.counters = counters
        self.times = times
        self.clock = clock
        self._starter = Starter(times)
        try:
            self._start(pushed)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close all parts, the last first."""
        self._starter.close()

    @property
    def robot(self) -> Drivable | None:
        """The source that can be driven, if there is one."""
        return next((feed.drivable for feed in self.plan.feeds if feed.drivable is not None), None)

    def session(self) -> Session:
        """Return what all parts are told alike."""
        return self._sessions.of("run", "run")

    def own_counters(self) -> dict[str, Mapping[str, int]]:
        """Return what the parts counted themselves, by dotted name of the part."""
        own = {f"source.{feed.name}": feed.counters() for feed in self.plan.feeds}
        own |= {f"localizer.{planned.name}": planned.localizer.counters() for planned in self.localizers}
        return own | {"estimator": self.plan.estimator.counters()}

    def _start(self, pushed: Mapping[str, SensorInfo]) -> None:
        plan = self.plan
        if plan.is_live and not all(feed.is_live for feed in plan.feeds):
            live, recorded = ([f.name for f in plan.feeds if f.is_live is is_live] for is_live in (True, False))
            raise ConfigError(f"{', '.join(live)} live and {', '.join(recorded)} recorded: two clocks make no run")
        self.place = Place(plan, self._starter)
        path = None if plan.mode == "teach" else self.place.path
        self._sessions = Sessions(plan.mode, plan.seed, path, self.place.start_pose)
        self.sensors = self._start_sources(pushed)
        self._sessions = Sessions(plan.mode, plan.seed, path, self.place.start_pose, self.sensors)

        settled = plan.settle(self.sensors, {feed.name: tuple(feed.sensors) for feed in plan.feeds})
        self.document: Mapping[str, Any] = settled.document
        self.localizers: Sequence[PlannedLocalizer] = settled.localizers
        self.place.warn_of_changes(self.sensors)
        self.place.finish_leftovers(self.localizers, self._sessions)
        if plan.mode == "teach":
            self.place.begin_teaching(self.sensors, self.document, self.counters, self.times.stage("store"))

        self.asked: Sequence[Asked] = [self._start_localizer(planned) for planned in self.localizers]
        self._starter.start("estimator", "estimator", plan.estimator, self._sessions.of("estimator", "estimator"))
        self.control = self._start_control()
        for name, sink in plan.sinks.items():
            self._starter.start("sink", name, sink, self._sessions.of("sink", name))

    def _start_sources(self, pushed: Mapping[str, SensorInfo]) -> dict[str, SensorInfo]:
        found = dict(pushed)
        for feed in self.plan.feeds:
            feed.prepare(self.counters, self.times.stage(f"source.{feed.name}"))
            session = self._sessions.of("source", feed.name)
            self._starter.run("source", feed.name, partial(feed.start, session), feed.close)
            found |= feed.sensors
        overrides = self.plan.sensors
        known = {
            name: corrected(info, overrides[name].mounting, overrides[name].calibration) if name in overrides else info
            for name, info in found.items()
        }
        for feed in self.plan.feeds:
            known |= {name: feed.believed(known[name]) for name in feed.sensors}
        return known

    def _start_localizer(self, planned: PlannedLocalizer) -> Asked:
        is_realtime = self.plan.is_realtime
        times = self.times.stage(f"localizer.{planned.name}")
        observing = Observing(planned, self.sensors, times, is_realtime)
        session = self._sessions.of(
            "localizer",
            planned.name,
            map=self.place.localizer_map(planned),
            last_latency_s=lambda: observing.last_latency_s,
        )
        self._starter.start("localizer", planned.name, planned.localizer, session)
        if not planned.is_async:
            return SyncLocalizer(observing)
        if not is_realtime:
            return AsyncStep(observing, self.counters)
        worker = Worker(observing, self.counters, self.clock.now_s, self.clock.wake)
        self._starter.on_close(f"the thread of localizer {planned.name!r}", worker.close)
        return worker

    def _start_control(self) -> Control:
        plan, robot = self.plan, self.robot
        drives_itself = robot is not None and robot.drives_itself
        is_played = robot is None and plan.mode == "teach"  # a recording is taught: nobody is to be driven
        controller = None if drives_itself or is_played else plan.controller
        if drives_itself and plan.controller is not None and plan.mode != "teach":
            logger.warning(
                "the robot of source %r drives itself, the controller is not asked: give the source `driver: commands`",
                next(feed.name for feed in plan.feeds if feed.drivable is not None),
            )
        if robot is not None:
            self._check_robot(is_driven=controller is not None or drives_itself)
        if controller is not None:
            if robot is not None:
                check_commands(controller, robot)
            session = self._sessions.of("controller", "controller")
            self._starter.start("controller", "controller", controller, session)
        guard = Guard(StopWhen() if plan.mode == "teach" else plan.stop_when)
        return Control(controller, robot, guard, plan.control_hz, self.counters, self.times.stage("controller"))

    def _check_robot(self, is_driven: bool) -> None:
        names = [feed.name for feed in self.plan.feeds]
        if not self.plan.is_realtime and len(names) > 1:
            raise ConfigError(
                f"in step pace a robot is the only source of its run, and this run has {', '.join(names)}:"
                " the frames of the others would be ahead of its commands"
            )
        if not is_driven:
            name = next(feed.name for feed in self.plan.feeds if feed.drivable is not None)
            raise ConfigError(f"the robot of source {name!r} does not drive by itself: add a controller")
