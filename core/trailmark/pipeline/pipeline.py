"""The pipeline: a run, step by step."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from types import TracebackType
from typing import Any, Self

from trailmark.commands import Stop
from trailmark.config import RunConfig
from trailmark.errors import ConfigError, RunError, TrailmarkError
from trailmark.frames import Frame, SensorInfo
from trailmark.geometry import Trajectory
from trailmark.interfaces import Mode, RunEnd
from trailmark.paths import Path as TaughtPath
from trailmark.pipeline.assembly import plan_of, read_config
from trailmark.pipeline.checks import FrameChecks
from trailmark.pipeline.clock import Clock, SystemClock
from trailmark.pipeline.counters import Counters
from trailmark.pipeline.pacing import Event, RunClock
from trailmark.pipeline.plan import Access, Plan
from trailmark.pipeline.recorder import Recorder
from trailmark.pipeline.result import RunResult, Status
from trailmark.pipeline.rig import Rig
from trailmark.pipeline.run_folder import prepared
from trailmark.pipeline.runner import Runner
from trailmark.pipeline.steps import Step
from trailmark.pipeline.telling import Telling
from trailmark.pipeline.timing import StageTimes, peak_rss_mb
from trailmark.pipeline.tracks import Tracks
from trailmark.plugins import Plugins

__all__ = ["Pipeline"]

logger = logging.getLogger(__name__)

_CTRL_C = "interrupted by the user"


class Pipeline:
    """A run of a config: iterate over it, or push frames into it::

        with Pipeline("config.yaml") as pipeline:
            for step in pipeline:
                print(step.stamp_s, step.belief.pose_map_base)

        with Pipeline(config, sensors=[SensorInfo("front", "image")]) as pipeline:   # a config without sources
            step = pipeline.feed(frame)

    However a run ends (its frames do, a goal is reached, Ctrl-C, an error), a robot gets `Stop` first, what is known
    is written, and all parts are closed.

    Parameters
    ----------
    config : RunConfig, Plan, path or mapping
        What to run.
    out : path, optional
        Folder to record into; default: nothing is recorded.
    store : path, optional
        The path store, in place of the config's.
    mode : {"track", "teach", "replay"}, optional
        In place of the config's.
    overrides : sequence of str
        As ``--set``: ``"localizers.floor.search_px=8"``.
    sensors : iterable of SensorInfo
        Sensors of the frames that are pushed.
    plugins : Plugins, optional
        What a config may name; default: all that are installed.
    access : {"create", "append", "overwrite"}, optional
        How teaching opens the path store.
    overwrite : bool
        Whether `out` may hold an earlier run.
    clock : Clock, optional
        What a run in real time waits by.

    Raises
    ------
    ConfigError
        If the request is wrong.
    """

    def __init__(
        self,
        config: RunConfig | Plan | str | Path | Mapping[str, Any],
        *,
        out: str | Path | None = None,
        store: str | Path | None = None,
        mode: Mode | None = None,
        overrides: Sequence[Any] = (),
        sensors: Iterable[SensorInfo] = (),
        plugins: Plugins | None = None,
        access: Access | None = None,
        overwrite: bool = False,
        clock: Clock | None = None,
    ) -> None:
        self.config: RunConfig | None = None
        if isinstance(config, Plan):
            self.plan = config
        else:
            self.config = read_config(config, plugins=plugins, overrides=overrides, mode=mode, store=store)
            self.plan = plan_of(self.config, access)
        self.folder = None if out is None else prepared(out, overwrite)
        self._pushed = {info.name: info for info in sensors}
        self._clock = RunClock(clock or SystemClock())
        self._counters, self._times = Counters(), StageTimes()
        self._lock = threading.RLock()
        self._rig: Rig | None = None
        self._result: RunResult | None = None

    # --- life ------------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Start all parts, before the first frame; iterating, feeding and ``with`` do it too.

        Raises
        ------
        ConfigError
            If the parts do not fit together.
        RunError, DataError
            If a part does not start.
        """
        if self._rig is not None:
            return
        plan = self.plan
        rig = Rig(plan, self._counters, self._times, self._clock, self._pushed)
        self._tracks = Tracks((planned.name for planned in rig.localizers), rig.session())
        self._recorder = None if self.folder is None else Recorder(self.folder, self._facts(), self._config_dir())
        sinks = {**plan.sinks, "tracks": self._tracks}
        try:
            if self._recorder is not None:
                self._recorder.open(rig.document, rig.sensors)
                sinks["recorder"] = self._recorder
            self._telling = Telling(sinks, self._times)
            self._runner = Runner(rig, self._telling)
            self._events: Iterator[Event] = self._runner.events()
            self._checks = FrameChecks("feed", self._pushed, False, self._counters)
        except BaseException:
            rig.close()
            raise
        self._rig = rig
        self._began_s = perf_counter()
        plan.call_hook("trailmark_run_started", run=self)

    def close(self) -> None:
        """End the run, if it has not ended."""
        if self._rig is not None:
            pushed = not self.plan.feeds
            self._end("done" if pushed else "interrupted", "" if pushed else "left before the last frame")

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if isinstance(error, KeyboardInterrupt):
            self._end("interrupted", _CTRL_C)
        elif error is not None:
            self._end("interrupted", f"the caller raised {type(error).__name__}: {error}")
        else:
            self.close()

    # --- what goes through ------------------------------------------------------------------------------------------

    def __iter__(self) -> Iterator[Step]:
        return self

    def __next__(self) -> Step:
        """Take the next frame through all parts.

        Raises
        ------
        StopIteration
            When the run is over; Ctrl-C too ends it this way, with status ``interrupted``.
        TrailmarkError
            If the run fails; it is over then, and what is known is written.
        """
        self.start()
        step = self._next_step() if self._result is None else None
        if step is None:
            raise StopIteration
        return step

    def feed(self, frame: Frame) -> Step | None:
        """Take a frame from anywhere through all parts; from any thread, one at a time.

        Returns
        -------
        Step or None
            None for a frame that repeats the stamp of its sensor.

        Raises
        ------
        ConfigError
            If the run has sources of its own, or does not know the sensors of pushed frames.
        RunError
            If the run has ended, or fails.
        """
        self._refuse_feeding()
        with self._lock:
            self.start()
            if self._result is not None:
                raise RunError(f"the run has ended: {self._result.status} {self._result.reason}".rstrip())
            if not self._checks.accept(frame):
                return None
            if self._runner.n_frames == 0:
                self._clock.anchor(frame.stamp_s)
            return self._worked(frame)

    def _refuse_feeding(self) -> None:
        if self.plan.feeds:
            raise ConfigError("frames cannot be fed to a pipeline that has sources of its own: iterate over it")
        if not self._pushed:
            raise ConfigError("frames cannot be fed before their sensors are known: Pipeline(..., sensors=[...])")

    def _next_step(self) -> Step | None:
        try:
            event = next(self._events, None)
        except KeyboardInterrupt:
            self._end("interrupted", _CTRL_C)
            return None
        except Exception as error:
            self._end("failed", str(error))
            raise
        if event is None:
            self._end("done", "")
            return None
        return self._worked(event)

    def _worked(self, event: Event) -> Step | None:
        assert self._rig is not None
        try:
            step = self._runner.work(event)
        except KeyboardInterrupt:
            self._end("interrupted", _CTRL_C)
            return None
        except Exception as error:
            self._end("failed", str(error))
            raise
        if (end := self._runner.ends_with(step)) is not None:
            self._end(*end)
        return step

    # --- what is left -----------------------------------------------------------------------------------------------

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """The sensors of the run, by name; starts it."""
        self.start()
        assert self._rig is not None
        return self._rig.sensors

    @property
    def path(self) -> TaughtPath | None:
        """The taught path that the run knows of; starts it."""
        self.start()
        assert self._rig is not None
        return self._rig.place.path

    @property
    def counters(self) -> Mapping[str, int]:
        """What has been counted so far."""
        return self._counters.merged(self._rig.own_counters() if self._rig is not None else {})

    @property
    def n_waypoints(self) -> int:
        """How many waypoints of the path store are committed, while teaching."""
        teaching = self._rig.place.teaching if self._rig is not None else None
        return teaching.n_waypoints if teaching is not None else 0

    @property
    def result(self) -> RunResult:
        """How the run ended.

        Raises
        ------
        RunError
            If it has not.
        """
        if self._result is None:
            raise RunError("the run has not ended; iterate over the pipeline, or close it")
        return self._result

    def _end(self, status: Status, reason: str) -> None:
        """Stop the robot, finish what is in work, tell and write how it ended, close all parts."""
        if self._result is not None or self._rig is None:
            return
        rig, failure = self._rig, None
        self._stop_robot(rig, reason or status)
        if status != "failed":
            try:
                self._runner.finish()
            except KeyboardInterrupt:
                status, reason = "interrupted", "interrupted while finishing"
            except TrailmarkError as error:
                status, reason, failure = "failed", str(error), error
        self._result = self._conclude(rig, status, reason.partition("\n")[0])
        try:
            self._telling.end(RunEnd(status, self._result.reason, self._result.counters))
            if self._recorder is not None:
                self._recorder.write(self._result)
        except TrailmarkError as error:
            failure = failure or error
        rig.close()
        self.plan.call_hook("trailmark_run_finished", run=self, result=self._result)
        if failure is not None:
            raise failure

    def _stop_robot(self, rig: Rig, reason: str) -> None:
        try:
            rig.control.drive(Stop(reason))
        except RunError as error:
            logger.warning("%s", error)

    def _conclude(self, rig: Rig, status: Status, reason: str) -> RunResult:
        self._counters.add("frames", self._runner.n_frames)
        timing = {
            "stages": self._times.table(),
            "peak_rss_mb": peak_rss_mb(),
            "frames": self._runner.n_frames,
            "wall_s": round(perf_counter() - self._began_s, 6),
        }
        return RunResult(
            status, reason, self.counters, self._tracks.trajectories(), _ground_truth(rig), timing, self.folder
        )

    def _facts(self) -> dict[str, Any]:
        plan = self.plan
        records = self.config.plugins.records if self.config is not None else ()
        return {
            "mode": plan.mode,
            "pace": "realtime" if plan.is_realtime else "step",
            "seed": plan.seed,
            "plugins": {f"{r.distribution}:{r.name}": r.version for r in records if r.status == "ok"},
        }

    def _config_dir(self) -> Path | None:
        return None if self.config is None else self.config.base_dir


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
