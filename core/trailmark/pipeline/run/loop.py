"""The loop of a run: a frame through all parts, failures of parts, and how the run comes to its end."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import ExitStack
from typing import TYPE_CHECKING

from trailmark.arrays import Floats
from trailmark.errors import RunError
from trailmark.estimates import Applied
from trailmark.frames import Frame, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interruption import CLOSE_S, STEP_S, ending_signal, reason_of, settle, shielded
from trailmark.pipeline.ending import HangError, HangWatch
from trailmark.pipeline.instruments import Instruments
from trailmark.pipeline.outputs.result import RunResult, Status, Step
from trailmark.pipeline.parts import Parts
from trailmark.pipeline.run.conclusion import Conclusion
from trailmark.pipeline.run.frame import FrameProcessor
from trailmark.pipeline.run.garbage import SELDOM, SPARED
from trailmark.pipeline.sources.checks import FrameChecks
from trailmark.pipeline.sources.merging import merge_sources
from trailmark.pipeline.startup import start_parts

if TYPE_CHECKING:
    from trailmark.pipeline.outputs.recorder import Recorder
    from trailmark.pipeline.sources.realtime import Event

__all__ = ["Run"]


class Run:
    """A run whose parts have started.

    It takes one frame after the other through them (`FrameProcessor`). However it ends, the robot gets `Stop` first,
    then what is in work is finished, what is known written, and all parts closed, once (`Conclusion`).

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
        with shielded(CLOSE_S):  # but for what parts do themselves: what has started is handed over, and can be closed
            self.running = running = start_parts(parts, pushed, instruments)
        self._instruments = instruments
        self._lock = threading.RLock()
        self._push_checks = FrameChecks("feed", pushed, False, instruments.counters, remedy="")
        self._is_realtime = running.parts.is_realtime
        self._step_shield, self._hangs = shielded(STEP_S), HangWatch(parts.settings.patience_s)
        self._events = self._new_events()
        self._conclusion, self._on_end = Conclusion(running, instruments, recorder), on_end
        self._lifeline = ExitStack()
        try:
            running.closing.enter_context(SELDOM)
            if self._is_realtime:
                running.closing.enter_context(SPARED)
            if running.control is not None or recorder is not None:
                self._enter_lifeline(recorder)
            self._frames = FrameProcessor(running, self._conclusion.open_sinks(), instruments)
            self._watch()
        except BaseException:
            self._lifeline.close()
            running.closing.close()
            raise

    # --- the loop --------------------------------------------------------------------------------------------------

    def next_step(self) -> Step | None:
        """Take the next frame through all parts; None when the run is over."""
        if self._conclusion.result is not None:
            return None
        step: Step | None = None
        try:
            with self._step_shield, self._hangs:
                if self._is_realtime:
                    self._hangs.pause()  # frames are awaited
                event = next(self._events, None)
                if event is not None:
                    self._hangs.restart()
                    step = self._process(event)
            if event is None:
                self.end("done")
            if (interrupted := ending_signal()) is not None:
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
            if self._instruments.counters["frames"] == 0:
                self._instruments.clock.anchor(frame.stamp_s)
            try:
                with self._hangs:
                    return self._process(frame)
            except BaseException as error:
                self._end_by(error)
            return None

    def set_pose(self, pose_map_base: Pose2, covariance: Floats | None, stamp_s: float | None) -> Applied:
        """Tell the estimator where a person says that the robot is, and return what became of that."""
        with self._lock:
            return self.running.estimator.set_pose(pose_map_base, covariance, stamp_s)

    def _process(self, event: Event) -> Step:
        """Take a frame through all parts; end the run if its goal is reached, or the guard has stopped it for good."""
        step = self._frames.process(event)
        if step.command is not None and self.running.control is not None:
            ending = self.running.control.end_by(step.command, step.stamp_s)
            if ending is not None:
                self.end(*ending)
        return step

    def _new_events(self) -> Iterator[Event]:
        """Return what the run goes on with: frames, and in real time the controller's ticks."""
        if not self._is_realtime:
            return merge_sources(self.running.parts.sources)
        from trailmark.pipeline.run.pacing import realtime_events  # threads and waiting: most runs need neither

        return realtime_events(self.running, self._instruments, self._hangs)

    def _enter_lifeline(self, recorder: Recorder | None) -> None:
        """Let the program stop the robot and write the folder from another thread, if the run cannot."""
        from trailmark.pipeline.ending.lifeline import RunLifeline  # of no use where there is neither

        conclude = self._conclusion.result_as_it_stands
        lifeline = RunLifeline(self.running.control, recorder, conclude, is_realtime=self._is_realtime)
        self._lifeline.enter_context(lifeline)

    def _watch(self) -> None:
        """Let the watchdog look after the loop, where it drives a robot in real time."""
        stall_s, control = self.running.parts.settings.stop_when.stall_s, self.running.control
        if self._is_realtime and stall_s is not None and control is not None:
            watchdog = control.new_watchdog(self._instruments.clock, stall_s)
            if watchdog is not None:
                self.running.closing.callback(watchdog.close)
                watchdog.start()

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
    def result(self) -> RunResult | None:
        """How the run ended, once it has."""
        return self._conclusion.result

    @property
    def n_waypoints(self) -> int:
        """How many waypoints of the path store are committed, while teaching."""
        teaching = None if self.running.taught is None else self.running.taught.teaching
        return 0 if teaching is None else teaching.n_waypoints

    def counters(self) -> dict[str, int]:
        """Return what has been counted so far."""
        return self._conclusion.counters()

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
                self._conclusion.take_steps(
                    status, reason, finish=self._frames.finish, close_events=self._close_events, on_end=self._on_end
                )
            finally:
                self._lifeline.close()
                if self.result is not None and self.result.status == "interrupted":
                    settle()

    def _close_events(self) -> None:
        if isinstance(self._events, Generator):
            self._events.close()
