"""A run at work: the loop over frames, and what is left when it ends."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING

from trailmark.arrays import Floats
from trailmark.commands import Stop
from trailmark.errors import RunError, TrailmarkError
from trailmark.estimates import Applied, Belief, EstimateRecord, Lost
from trailmark.frames import Frame, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import RunEnd, Sink
from trailmark.interruption import FINISH_S, KEEP_S, STEP_S, STOP_S, asked, reason_of, shielded
from trailmark.pipeline.ending import Ending, HangError, HangWatch, RunLifeline
from trailmark.pipeline.instruments import Instruments, peak_rss_mb
from trailmark.pipeline.localizers import LocalizerFailedError, LocalizerRunner, ObserveResult
from trailmark.pipeline.outputs.fanout import SinkFanout
from trailmark.pipeline.outputs.result import RunResult, Status, Step
from trailmark.pipeline.outputs.tracks import Tracks
from trailmark.pipeline.parts import Parts
from trailmark.pipeline.sources.checks import FrameChecks
from trailmark.pipeline.sources.merging import merged
from trailmark.pipeline.sources.stream import ground_truth_of, outlines_of
from trailmark.pipeline.startup import start_parts

if TYPE_CHECKING:
    from trailmark.pipeline.outputs.recorder import Recorder
    from trailmark.pipeline.sources.realtime import Event

__all__ = ["Run"]

logger = logging.getLogger(__name__)

_FOLD_EVERY = 4096  # frames


class Run:
    """A run whose parts have started.

    At each frame: results that are due are applied; the localizers that subscribe are asked in the order of the
    config, each with the belief at the frame's stamp, and its estimates are applied before the next is asked; in
    teach a waypoint is laid; the controller is asked, if it is time.

    However the run ends, the robot gets `Stop` first, then what is in work is finished, what is known written, and all
    parts closed, once.

    Parameters
    ----------
    parts : Parts
        The parts, constructed.
    pushed : mapping of str to SensorInfo
        Sensors of frames that are pushed.
    instruments : Instruments
        Clock, counters and times.
    recorder : Recorder or None
        Writes the run's folder.
    on_end : callable
        Called with the result, when everything is written and closed.

    Attributes
    ----------
    running : RunningParts
        The parts, started.
    result : RunResult or None
        How the run ended, once it has.

    Raises
    ------
    ConfigError, RunError, DataError
        If a part does not start or does not fit.
    """

    def __init__(
        self,
        parts: Parts,
        pushed: Mapping[str, SensorInfo],
        instruments: Instruments,
        *,
        recorder: Recorder | None,
        on_end: Callable[[RunResult], None],
    ) -> None:
        self.result: RunResult | None = None
        with shielded(0.0):  # devices that do not answer are not waited for
            self.running = running = start_parts(parts, pushed, instruments)
        self._parts = running.parts
        self._taught = running.taught
        self._teaching = None if running.taught is None else running.taught.teaching
        self._estimator = running.estimator
        self._control = running.control
        self._set_localizers(running.localizers)
        self._clock, self._counters, self._times = instruments.clock, instruments.counters, instruments.times
        self._recorder, self._on_end = recorder, on_end
        self._lock = threading.RLock()
        self._push_checks = FrameChecks("feed", pushed, False, instruments.counters, remedy="")
        self._events = self._paced_events()
        self._hangs = HangWatch(parts.settings.patience_s)
        self._source_watch = (
            nullcontext() if self._parts.is_realtime else self._hangs
        )  # in real time frames are awaited
        self._n_frames = 0
        self._began_s = perf_counter()
        self._lifeline = RunLifeline(
            self._control, recorder, self._conclude_as_it_stands, is_realtime=parts.is_realtime
        )
        try:
            self._tracks = Tracks((localizer.name for localizer in running.localizers), running.session)
            sinks: dict[str, Sink] = {**self._parts.sinks, "tracks": self._tracks}
            self._lifeline.__enter__()
            if recorder is not None:
                recorder.open(self._parts.document, running.sensors)
                sinks["recorder"] = recorder
            self._sinks = SinkFanout(sinks, instruments.times)
            self._watch()
        except BaseException:
            self._lifeline.__exit__(None, None, None)
            running.closing.close()
            raise
        self._began_s = perf_counter()

    # --- the loop --------------------------------------------------------------------------------------------------

    def next_step(self) -> Step | None:
        """Take the next frame through all parts; None when the run is over."""
        if self.result is not None:
            return None
        step: Step | None = None
        try:
            with shielded(STEP_S):
                with self._source_watch:
                    event = next(self._events, None)
                if event is None:
                    self.end("done")
                else:
                    with self._hangs:
                        step = self._process(event)
            if (interrupted := asked()) is not None:
                raise interrupted
        except BaseException as error:
            self._end_by(error)
            return None
        return step

    def push(self, frame: Frame) -> Step | None:
        """Take a frame from elsewhere through all parts; None if it repeats the stamp of its sensor."""
        with self._lock:
            if self.result is not None:
                raise RunError(f"the run has ended: {self.result.status} {self.result.reason}".rstrip())
            if not self._push_checks.accept(frame):
                return None
            if self._n_frames == 0:
                self._clock.anchor(frame.stamp_s)
            try:
                with self._hangs:
                    return self._process(frame)
            except BaseException as error:
                self._end_by(error)
            return None

    def set_pose(self, pose_map_base: Pose2, covariance: Floats | None, stamp_s: float | None) -> Applied:
        """Tell the estimator where a person says that the robot is, and return what became of that."""
        with self._lock:
            return self._estimator.set_pose(pose_map_base, covariance, stamp_s)

    def _process(self, event: Event) -> Step:
        """Take a frame through all parts; at a tick, ask only the controller."""
        now_s = event.stamp_s
        records: list[EstimateRecord] = []
        if self.running.told_poses:
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
            self._sinks.tell(Sink.on_belief, belief)
            if self._teaching is not None:
                self._teaching.on_belief(belief)
        command = self._control.step(belief)
        self._clock.beat()
        if command is not None:
            self._sinks.tell(Sink.on_command, now_s, command)
        if isinstance(command, Stop):
            self._end_after(command, now_s)
        return Step(now_s, frame, belief, tuple(records), command)

    def _tell_estimator_poses(self) -> None:
        """Tell the estimator where a person says that the robot is."""
        while self.running.told_poses:
            pose, covariance = self.running.told_poses.popleft()
            outcome = self._estimator.set_pose(pose, covariance)
            self._counters[f"told_poses.{outcome.status}"] += 1
            if outcome.status != "accepted":
                logger.warning("the pose that was told (%s) is %s: %s", pose, outcome.status, outcome.reason)

    def _observe(self, frame: Frame) -> list[EstimateRecord]:
        """Ask the localizers that subscribe to the frame's sensor, one after the other."""
        self._n_frames += 1
        self._counters["frames"] += 1
        if self._n_frames % _FOLD_EVERY == 0:
            self._times.fold()
        self._sinks.tell(Sink.on_frame, frame)
        records: list[EstimateRecord] = []
        for localizer in self._subscribers.get(frame.sensor, ()):
            belief = self._estimator.belief(frame.stamp_s) if localizer.uses_belief else Belief(frame.stamp_s)
            try:
                records += self._apply(localizer, localizer.submit(frame, belief))
            except LocalizerFailedError as error:
                self._on_failure(localizer, error)
        return records

    def _apply(self, localizer: LocalizerRunner, results: Sequence[ObserveResult]) -> list[EstimateRecord]:
        """Let the estimator take what a localizer said; count and tell what became of it."""
        records: list[EstimateRecord] = []
        for result in results:
            for record in self._estimator.apply(localizer.part, result):
                self._counters[f"localizer.{record.source}.{record.outcome.status}"] += 1
                if isinstance(record.estimate, Lost):
                    self._counters[f"localizer.{record.source}.lost"] += 1
                self._sinks.tell(Sink.on_estimate_record, record)
                records.append(record)
        return records

    def _paced_events(self) -> Generator[Event]:
        """Yield the frames of the sources and the controller's ticks, as the pace says."""
        parts, control = self._parts, self._control
        if not parts.is_realtime:
            yield from merged(parts.sources)
            return
        from trailmark.pipeline.sources.realtime import held_to_stamps, live

        if parts.is_live:
            yield from live(parts.sources, self._clock, lambda: control.due_s, self._counters)
        elif parts.robot is not None:  # simulated: when its frame is there, it has moved on already
            yield from held_to_stamps(self._watched(merged(parts.sources)), self._clock, lambda: math.inf)
        else:
            yield from held_to_stamps(self._watched(merged(parts.sources)), self._clock, lambda: control.due_s)

    def _watched(self, frames: Iterator[Frame]) -> Iterator[Frame]:
        """Yield recorded frames; who does not come back with one is interrupted, who waits for its time is not."""
        while True:
            with self._hangs:
                frame = next(frames, None)
            if frame is None:
                return
            yield frame

    def _watch(self) -> None:
        """Let the watchdog look after the loop, where it drives a robot in real time."""
        stall_s = self._parts.settings.stop_when.stall_s
        if self._parts.is_realtime and stall_s is not None:
            watchdog = self._control.new_watchdog(self._clock, stall_s)
            if watchdog is not None:
                self.running.closing.callback(watchdog.close)
                watchdog.start()

    # --- failures --------------------------------------------------------------------------------------------------

    def _on_failure(self, localizer: LocalizerRunner, error: LocalizerFailedError) -> None:
        """End the run because a localizer has failed, or switch the localizer off, as its ``on_error`` says."""
        if localizer.part.options.on_error == "fail":
            raise error
        logger.warning("%s; it is switched off (on_error: disable)", error)
        self._counters[f"localizer.{localizer.name}.disabled"] += 1
        self._estimator.health[localizer.name] = f"switched off: {error}"
        self._set_localizers([other for other in self._localizers if other is not localizer])
        localizer.close()

    def _set_localizers(self, localizers: Sequence[LocalizerRunner]) -> None:
        """Work with these localizers from the next sensor's turn on."""
        self._localizers = localizers
        self._async_localizers = [localizer for localizer in localizers if localizer.part.options.answers_later]
        self._subscribers = {
            sensor: [localizer for localizer in localizers if sensor in localizer.part.sensors]
            for sensor in self.running.sensors
        }

    def _end_by(self, error: BaseException) -> None:
        """End the run by what was raised in its loop, and raise that again unless the user interrupted the run."""
        if isinstance(error, KeyboardInterrupt):
            self.end("interrupted", reason_of(error))
            return
        if isinstance(error, HangError):  # between two parts: together they have taken too long
            error = RunError(f"the run has not come from one frame to the next: {error}")
        self.end("failed", str(error))
        raise error

    # --- the end ---------------------------------------------------------------------------------------------------

    @property
    def n_waypoints(self) -> int:
        """How many waypoints of the path store are committed, while teaching."""
        return 0 if self._teaching is None else self._teaching.n_waypoints

    def counters(self) -> dict[str, int]:
        """Return what has been counted so far; without what a part that fails at it has counted."""
        own: dict[str, Mapping[str, int]] = {}
        for prefix, ask in self.running.own_counters():
            with suppress(TrailmarkError):  # the end of the run says it
                own[prefix] = ask()
        return self._counters.merged(own)

    def end(self, status: Status, reason: str = "") -> None:
        """End the run, if it has not ended.

        Raises
        ------
        TrailmarkError
            If what is in work cannot be finished, or the end cannot be written. The run is over nevertheless.
        """
        if self.result is not None:
            return
        with shielded():
            try:
                self._hangs.close()  # to finish takes its time
                self._end(status, reason)
            finally:
                self._lifeline.__exit__(None, None, None)

    def _end(self, status: Status, reason: str) -> None:
        """Take the steps of the end; none that hangs is waited for when the program was told to end."""
        ending = Ending(status, reason, self._spared_parts())
        ending.attempt(lambda: self._control.stop_for_good(reason or status), STOP_S)
        if status != "failed":
            ending.attempt(self._finish, FINISH_S)
        own = {prefix: ending.attempt(ask) or {} for prefix, ask in self.running.own_counters()}
        truth = ending.attempt(lambda: ground_truth_of(self._parts.sources), KEEP_S)
        outlines = ending.attempt(lambda: outlines_of(self._parts.sources), KEEP_S)
        with shielded(KEEP_S):
            result = self._conclude(ending.status, ending.reason, self._counters.merged(own))
            self.result = replace(result, ground_truth=truth, outlines=outlines)
        for tell in self._sinks.on_end(RunEnd(ending.status, ending.reason, self.result.counters)):
            ending.attempt(tell)
        self._write(ending)
        ending.attempt(self.running.closing.close, math.inf)
        for error in self.running.not_closed:
            ending.fail(error)
        ending.attempt(self._events.close)
        if ending.status != self.result.status:  # what failed while the end was written, and at closing
            self.result = replace(self.result, status=ending.status, reason=ending.reason)
            self._write_status(ending)
        self._on_end(self.result)
        if ending.failure is not None:
            raise ending.failure

    def _end_after(self, stop: Stop, now_s: float) -> None:
        """End the run if its goal is reached, or the guard has held the robot for too long."""
        if stop.done:
            self.end("done", stop.reason)
        elif self._control.has_given_up(now_s):
            self.end("stopped", stop.reason)

    def _write(self, ending: Ending) -> None:
        """Write the run's folder, if there is one."""
        recorder, result = self._recorder, self.result
        if recorder is not None and result is not None:
            ending.attempt(lambda: recorder.write(result), KEEP_S)

    def _write_status(self, ending: Ending) -> None:
        recorder, result = self._recorder, self.result
        if recorder is not None and result is not None:
            ending.attempt(lambda: recorder.write_status(result), KEEP_S)

    def _spared_parts(self) -> frozenset[str]:
        """Return the localizers whose failure ends no run."""
        parts = self._parts.localizers
        return frozenset(f"localizer {part.name!r}" for part in parts if part.options.on_error == "disable")

    def _finish(self) -> None:
        """Apply what is still in work; in teach, end the path and let the localizers finish."""
        for localizer in self._async_localizers:
            try:
                self._apply(localizer, localizer.drain())
                self._apply(localizer, localizer.poll(math.inf))
            except LocalizerFailedError as error:
                self._on_failure(localizer, error)
        if self._taught is not None and self._teaching is not None:
            self._teaching.end(self._estimator.belief())
            for localizer in self._localizers:
                try:
                    self._taught.finish(localizer.part)
                except LocalizerFailedError as error:
                    self._on_failure(localizer, error)

    def _conclude_as_it_stands(self, reason: str) -> RunResult:
        """Return the result for a run that cannot end in order; its parts are not asked for counts, one may hang."""
        sources, result = self._parts.sources, self._conclude("interrupted", reason, self._counters.merged({}))
        return replace(result, ground_truth=ground_truth_of(sources))

    def _conclude(self, status: Status, reason: str, counters: Mapping[str, int]) -> RunResult:
        return RunResult(
            status=status,
            reason=reason,
            counters=counters,
            trajectories=self._tracks.trajectories(),
            timing={
                "stages": self._times.table(),
                "peak_rss_mb": peak_rss_mb(),
                "frames": self._n_frames,
                "wall_s": round(perf_counter() - self._began_s, 6),
            },
            folder=None if self._recorder is None else self._recorder.folder,
        )
