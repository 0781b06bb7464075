"""The way of one frame through a run: localizers, estimator, sinks, teaching, controller."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from trailmark.estimates import Belief, EstimateRecord, Lost
from trailmark.frames import Frame
from trailmark.interfaces import Sink
from trailmark.pipeline.instruments import Instruments
from trailmark.pipeline.localizers import (
    FreezeWatch,
    LocalizerFailedError,
    LocalizerRunner,
    ObserveResult,
    beginning_early,
)
from trailmark.pipeline.outputs.fanout import SinkFanout
from trailmark.pipeline.outputs.result import Step
from trailmark.pipeline.parts import LocalizerPart
from trailmark.pipeline.sources.stream import ground_truth_of
from trailmark.pipeline.startup import RunningParts

if TYPE_CHECKING:
    from trailmark.pipeline.sources.realtime import Event
    from trailmark.pipeline.teaching.taught_map import TaughtMap

__all__ = ["FrameProcessor"]

logger = logging.getLogger(__name__)

_FOLD_EVERY = 4096  # frames


class FrameProcessor:
    """Takes frames through the parts of a run, one after the other.

    At each frame: results that are due are applied; the localizers that subscribe are asked in the order of the
    config, each with the belief at the frame's stamp, and its estimates are applied before the next is asked (all are
    `Lost` where the sensor has frozen, see `FreezeWatch`); in teach a waypoint is laid; the controller is asked, if it
    is time.

    Parameters
    ----------
    running : RunningParts
        The parts, started.
    sinks : SinkFanout
        Are told what happens.
    instruments : Instruments
        Clock, counters and times.
    """

    def __init__(self, running: RunningParts, sinks: SinkFanout, instruments: Instruments) -> None:
        self._running, self._sinks = running, sinks
        self._estimator, self._control = running.estimator, running.control
        self._teaching = None if running.taught is None else running.taught.teaching
        self._is_realtime = running.parts.is_realtime
        self._clock, self._counters, self._times = instruments.clock, instruments.counters, instruments.times
        self._freezes = FreezeWatch(running.estimator)
        self._switched_off: list[LocalizerPart] = []
        self._set_localizers(running.localizers)

    def process(self, event: Event) -> Step:
        """Take a frame through all parts; at a tick, ask only the controller."""
        now_s = event.stamp_s
        records: list[EstimateRecord] = []
        if self._running.told_poses:
            self._tell_estimator_poses()
        for localizer in self._async_localizers:
            try:
                records += self._apply(localizer, localizer.poll(now_s))
            except LocalizerFailedError as error:
                self._on_failure(localizer, error)
        frame = event if isinstance(event, Frame) else None
        if frame is not None:
            records += self._observe(frame)
        belief = self._estimator.belief(now_s)
        if frame is not None:
            if self._subscribers.get(frame.sensor):
                self._freezes.keep(frame, belief)
            self._sinks.tell(Sink.on_belief, belief)
            if self._teaching is not None:
                self._teaching.on_belief(belief)
        command = None if self._control is None else self._control.step(belief)
        if self._is_realtime:
            self._clock.beat()
        if command is not None:
            self._sinks.tell(Sink.on_command, now_s, command)
        return Step(now_s, frame, belief, tuple(records), command)

    def _tell_estimator_poses(self) -> None:
        """Tell the estimator where a person says that the robot is."""
        while self._running.told_poses:
            pose, covariance = self._running.told_poses.popleft()
            outcome = self._estimator.set_pose(pose, covariance)
            self._counters[f"told_poses.{outcome.status}"] += 1
            if outcome.status != "accepted":
                logger.warning("the pose that was told (%s) is %s: %s", pose, outcome.status, outcome.reason)

    def _observe(self, frame: Frame) -> list[EstimateRecord]:
        """Ask the localizers that subscribe to the frame's sensor, one after the other."""
        self._counters["frames"] += 1
        if self._counters["frames"] % _FOLD_EVERY == 0:
            self._times.fold()
        self._sinks.tell(Sink.on_frame, frame)
        records: list[EstimateRecord] = []
        subscribers = self._subscribers.get(frame.sensor, ())
        lost = self._freezes.lost(frame) if subscribers else None
        if lost is None and frame.payload.is_snapshot:  # a reading is not worth a thread
            for early in self._beginning_early.get(frame.sensor, ()):
                early.begin(frame)
        for localizer in subscribers:
            try:
                if lost is not None and localizer.looks_at_frames:
                    self._counters[f"localizer.{localizer.name}.frozen"] += 1
                    said: Sequence[ObserveResult] = (ObserveResult(frame.stamp_s, frame.stamp_s, (lost,)),)
                else:
                    belief = self._estimator.belief(frame.stamp_s) if localizer.uses_belief else Belief(frame.stamp_s)
                    said = localizer.submit(frame, belief)
                records += self._apply(localizer, said)
            except LocalizerFailedError as error:
                self._on_failure(localizer, error)
        return records

    def _apply(self, localizer: LocalizerRunner, results: Sequence[ObserveResult]) -> list[EstimateRecord]:
        """Let the estimator take what a localizer said; count and tell what became of it."""
        records: list[EstimateRecord] = []
        for result in results:
            for estimate in result.estimates:
                outcome = self._estimator.apply(localizer.part, estimate, result.frame_s)
                record = EstimateRecord(result.arrived_s, localizer.name, estimate, outcome)
                self._counters[f"localizer.{localizer.name}.{outcome.status}"] += 1
                if isinstance(estimate, Lost):
                    self._counters[f"localizer.{localizer.name}.lost"] += 1
                self._sinks.tell(Sink.on_estimate_record, record)
                records.append(record)
        return records

    def finish(self) -> None:
        """Apply what is still in work; in teach, end the path and let the localizers finish."""
        for localizer in self._localizers:
            try:
                self._apply(localizer, localizer.drain())
                self._apply(localizer, localizer.poll(math.inf))
            except LocalizerFailedError as error:
                self._on_failure(localizer, error)
        taught = self._running.taught
        if taught is not None and self._teaching is not None:
            self._teaching.end(self._estimator.belief())
            self._close_loops(taught)
            for localizer in self._localizers:
                try:
                    taught.finish(localizer.part)
                except LocalizerFailedError as error:
                    self._on_failure(localizer, error)
            taught.keep_true_places(ground_truth_of(self._running.parts.sources))

    def _close_loops(self, taught: TaughtMap) -> None:
        """Straighten the path; without a localizer that fails at it, if its ``on_error`` lets the run go on."""
        try:
            n_loops = taught.close_loops([localizer.part for localizer in self._localizers], self._switched_off)
        except LocalizerFailedError as error:
            failed = next((one for one in self._localizers if f"localizer {one.name!r}" in str(error)), None)
            if failed is None:
                logger.warning("%s; what it remembers cannot move: loops stay open", error)
                return
            self._on_failure(failed, error)
            self._close_loops(taught)
            return
        if n_loops:
            self._counters["teach.loops"] += n_loops

    def _on_failure(self, localizer: LocalizerRunner, error: LocalizerFailedError) -> None:
        """End the run because a localizer has failed, or switch the localizer off, as its ``on_error`` says."""
        if localizer.part.options.on_error == "fail":
            raise error
        logger.warning("%s; it is switched off (on_error: disable)", error)
        self._counters[f"localizer.{localizer.name}.disabled"] += 1
        self._estimator.switch_off(localizer.name, str(error))
        self._set_localizers([other for other in self._localizers if other is not localizer])
        self._switched_off.append(localizer.part)
        localizer.close()

    def _set_localizers(self, localizers: Sequence[LocalizerRunner]) -> None:
        """Work with these localizers from the next sensor's turn on."""
        self._localizers = localizers
        self._async_localizers = [localizer for localizer in localizers if localizer.part.options.answers_later]
        self._subscribers = {
            sensor: [localizer for localizer in localizers if sensor in localizer.part.sensors]
            for sensor in self._running.sensors
        }
        self._beginning_early = {
            sensor: beginning_early(subscribers, self._is_realtime) for sensor, subscribers in self._subscribers.items()
        }
