"""A run at work: from started parts to what is left of it."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping
from time import perf_counter

from trailmark.commands import Stop
from trailmark.errors import RunError
from trailmark.frames import Frame, SensorInfo
from trailmark.geometry import Trajectory
from trailmark.interfaces import RunEnd
from trailmark.pipeline.checks import FrameChecks
from trailmark.pipeline.counters import Counters
from trailmark.pipeline.pacing import Event, RunClock
from trailmark.pipeline.plan import Plan
from trailmark.pipeline.recorder import Recorder
from trailmark.pipeline.result import RunResult, Status
from trailmark.pipeline.rig import Rig
from trailmark.pipeline.runner import Runner
from trailmark.pipeline.steps import Step
from trailmark.pipeline.telling import Telling
from trailmark.pipeline.timing import StageTimes, peak_rss_mb
from trailmark.pipeline.tracks import Tracks

__all__ = ["CTRL_C", "Run"]

logger = logging.getLogger(__name__)

#: Reason of a run that the user ended.
CTRL_C = "interrupted by the user"

_FOLD_EVERY = 4096  # frames


class Run:
    """A run whose parts have started.

    However it ends, the robot gets `Stop` first, then what is in work is finished, what is known written, and all
    parts closed, once.

    Parameters
    ----------
    plan : Plan
        The parts.
    clock : RunClock
        For real time.
    pushed : mapping of str to SensorInfo
        Sensors of frames that are pushed.
    recorder : Recorder or None
        Writes the run's folder.
    on_end : callable
        Called with the result, when everything is written and closed.

    Raises
    ------
    ConfigError, RunError, DataError
        If a part does not start or does not fit.
    """

    def __init__(
        self,
        plan: Plan,
        clock: RunClock,
        pushed: Mapping[str, SensorInfo],
        recorder: Recorder | None,
        on_end: Callable[[RunResult], None],
    ) -> None:
        self._counters, self._times = Counters(), StageTimes()
        self._clock = clock
        self._recorder = recorder
        self._on_end = on_end
        self._lock = threading.RLock()
        self._checks = FrameChecks("feed", pushed, False, self._counters, remedy="")
        self.rig = Rig(plan, self._counters, self._times, clock, pushed)
        self.result: RunResult | None = None
        try:
            self._tracks = Tracks((planned.name for planned in self.rig.localizers), self.rig.session())
            sinks = {**plan.sinks, "tracks": self._tracks}
            if recorder is not None:
                recorder.open(self.rig.document, self.rig.sensors)
                sinks["recorder"] = recorder
            self._telling = Telling(sinks, self._times)
            self._runner = Runner(self.rig, self._telling)
            self._events = self._runner.events()
        except BaseException:
            self.rig.close()
            raise
        self._began_s = perf_counter()

    def next_step(self) -> Step | None:
        """Take the next frame through all parts; None when the run is over."""
        if self.result is not None:
            return None
        try:
            event = next(self._events, None)
        except KeyboardInterrupt:
            self.end("interrupted", CTRL_C)
            return None
        except Exception as error:
            self.end("failed", str(error))
            raise
        if event is None:
            self.end("done")
            return None
        return self._worked(event)

    def push(self, frame: Frame) -> Step | None:
        """Take a frame from elsewhere through all parts; None if it repeats the stamp of its sensor."""
        with self._lock:
            if self.result is not None:
                raise RunError(f"the run has ended: {self.result.status} {self.result.reason}".rstrip())
            if not self._checks.accept(frame):
                return None
            if self._runner.n_frames == 0:
                self._clock.anchor(frame.stamp_s)
            return self._worked(frame)

    def counters(self) -> dict[str, int]:
        """Return what has been counted so far."""
        return self._counters.merged(self.rig.own_counters())

    def end(self, status: Status, reason: str = "") -> None:
        """End the run, if it has not ended.

        Raises
        ------
        TrailmarkError
            If what is in work cannot be finished, or the end cannot be written. The run is over nevertheless.
        """
        if self.result is not None:
            return
        self._stop_robot(reason or status)
        failure: BaseException | None = None
        if status != "failed":
            try:
                self._runner.finish()
            except KeyboardInterrupt:
                status, reason = "interrupted", "interrupted while finishing"
            except Exception as error:
                status, reason, failure = "failed", str(error), error
        self.result = self._conclude(status, reason.partition("\n")[0])
        try:
            self._telling.end(RunEnd(status, self.result.reason, self.result.counters))
            if self._recorder is not None:
                self._recorder.write(self.result)
        finally:
            self.rig.close()
            self._events.close()
            self._on_end(self.result)
        if failure is not None:
            raise failure

    def _worked(self, event: Event) -> Step | None:
        try:
            step = self._runner.work(event)
        except KeyboardInterrupt:
            self.end("interrupted", CTRL_C)
            return None
        except Exception as error:
            self.end("failed", str(error))
            raise
        if self._runner.n_frames % _FOLD_EVERY == 0:
            self._times.fold()
        if (end := self._runner.ends_with(step)) is not None:
            self.end(*end)
        return step

    def _stop_robot(self, reason: str) -> None:
        try:
            self.rig.control.drive(Stop(reason))
        except RunError as error:
            logger.warning("%s", error)

    def _conclude(self, status: Status, reason: str) -> RunResult:
        n_frames = self._runner.n_frames
        return RunResult(
            status=status,
            reason=reason,
            counters=self.counters(),
            trajectories=self._tracks.trajectories(),
            ground_truth=_ground_truth(self.rig),
            timing={
                "stages": self._times.table(),
                "peak_rss_mb": peak_rss_mb(),
                "frames": n_frames,
                "wall_s": round(perf_counter() - self._began_s, 6),
            },
            folder=None if self._recorder is None else self._recorder.folder,
        )


def _ground_truth(rig: Rig) -> Trajectory | None:
    """Return the truth of the first source that knows it."""
    for feed in rig.plan.feeds:
        try:
            truth = feed.ground_truth()
        except Exception as error:
            logger.warning("source %r gives no ground truth: %s: %s", feed.name, type(error).__name__, error)
            continue
        if truth is not None:
            return truth
    return None
