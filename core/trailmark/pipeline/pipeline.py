"""The pipeline: a run, step by step."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, Unpack

import numpy as np
import numpy.typing as npt

from trailmark.clock import Clock, RunClock, SystemClock
from trailmark.config import RunConfig
from trailmark.errors import ConfigError, RunError
from trailmark.estimates import Applied
from trailmark.frames import Frame, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interruption import reason_of, shielded
from trailmark.paths import Path as TaughtPath
from trailmark.paths import TaughtPlaces
from trailmark.pipeline.instruments import Instruments
from trailmark.pipeline.outputs.result import RunResult, Step
from trailmark.pipeline.parts import Parts, build_parts
from trailmark.pipeline.request import RunKeywords, RunRequest
from trailmark.pipeline.run import Run

if TYPE_CHECKING:
    from trailmark.pipeline.outputs.recorder import Recorder
    from trailmark.sources.reorder import ReorderWindow

__all__ = ["Pipeline"]


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
    config : RunConfig, Parts, RunRequest, path or mapping
        What to run.
    out : path, optional
        Folder to record into; default: nothing is recorded.
    sensors : iterable of SensorInfo
        Sensors of the frames that are pushed.
    reorder_s : float
        How far the frames of one pushed sensor may lag behind those of others: they are held back until every sensor
        has one waiting, or they lie so far behind the newest. What is later still is counted as ``source.feed.late``.
        0: frames are pushed in the order of their stamps, and one that is not is an error [s].
    clock : Clock, optional
        What a run in real time waits by.
    **options
        `store`, `mode`, `overrides`, `plugins`, `access`, `overwrite`: as of `RunRequest`.

    Attributes
    ----------
    config : RunConfig or None
        As loaded; None for a run of parts.
    parts : Parts
        Constructed.
    folder : Path or None
        Where the run is recorded.

    Raises
    ------
    ConfigError
        If the request is wrong.
    """

    def __init__(
        self,
        config: RunConfig | Parts | RunRequest | str | Path | Mapping[str, Any],
        *,
        out: str | Path | None = None,
        sensors: Iterable[SensorInfo] = (),
        reorder_s: float = 0.0,
        clock: Clock | None = None,
        **options: Unpack[RunKeywords],
    ) -> None:
        self.config: RunConfig | None = None
        if isinstance(config, Parts):
            self.parts, overwrite = config, options.get("overwrite", False)
        else:
            request = config if isinstance(config, RunRequest) else RunRequest(config=config, out=out, **options)
            self.config = request.read()
            self.parts, out, overwrite = build_parts(self.config, request.access), request.out, request.overwrite
        self.folder = None if out is None else _prepare_out(out, overwrite)
        self._pushed = {info.name: info for info in sensors}
        self._window = self._new_window(reorder_s) if reorder_s else None
        self._fed_s = -math.inf
        self._instruments = Instruments(RunClock(clock or SystemClock()), patience_s=self.parts.settings.patience_s)
        self._lock = threading.RLock()
        self._run: Run | None = None

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
        self._start_run()

    def close(self) -> None:
        """End the run, if it has not ended."""
        if self._run is None:
            return
        if self.parts.sources:
            self._run.end("interrupted", "left before the last frame")
            return
        if self._window is not None and self._run.result is None:
            self._feed_all(self._window.flush())
        self._run.end("done")

    def __enter__(self) -> Self:
        with shielded():
            self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
        elif isinstance(error, KeyboardInterrupt):
            self._start_run().end("interrupted", reason_of(error))
        else:
            self._start_run().end("interrupted", f"the caller raised {type(error).__name__}: {error}")

    # --- what goes through -----------------------------------------------------------------------------------------

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
        step = (self._run or self._start_run()).next_step()
        if step is None:
            raise StopIteration
        return step

    def feed(self, frame: Frame) -> Step | None:
        """Take a frame from anywhere through all parts; from any thread, one at a time.

        Returns
        -------
        Step or None
            None for a frame that repeats the stamp of its sensor. With `reorder_s`, the last step of the frames that
            need not wait any longer; None: all wait. `close` takes through what still waits.

        Raises
        ------
        ConfigError
            If the run has sources of its own, or does not know the sensors of pushed frames.
        RunError
            If the run has ended, or fails.
        """
        if self.parts.sources:
            raise ConfigError("frames cannot be fed to a pipeline that has sources of its own: iterate over it")
        if not self._pushed:
            raise ConfigError("frames cannot be fed before their sensors are known: Pipeline(..., sensors=[...])")
        if self._window is None:
            return self._start_run().push(frame)
        with self._lock:
            if frame.stamp_s < self._fed_s:
                self._instruments.counters.add("source.feed.late")
                return None
            return self._feed_all(self._window.push(frame))

    def _feed_all(self, frames: Iterable[Frame]) -> Step | None:
        last: Step | None = None
        for frame in frames:
            self._fed_s = frame.stamp_s
            last = self._start_run().push(frame) or last
        return last

    def set_pose(
        self,
        pose_map_base: Pose2,
        covariance: npt.NDArray[np.float64] | None = None,
        stamp_s: float | None = None,
    ) -> Applied:
        """Tell the estimator where base is, between two steps: a person has put the robot somewhere, or sees it there.

        It takes and returns what `trailmark.interfaces.Estimator.set_pose` does; what is no pose is ``refused``.

        Raises
        ------
        RunError
            If the estimator fails at it.
        """
        return self._start_run().set_pose(pose_map_base, covariance, stamp_s)

    # --- what is known of it ---------------------------------------------------------------------------------------

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """The sensors of the run, by name; asking starts it."""
        return self._start_run().running.sensors

    @property
    def sensor_origins(self) -> list[str]:
        """Which mountings and calibrations of a recording are used, a line for a sensor; asking starts the run."""
        running = self._start_run().running
        return [line for source in running.parts.sources for line in source.origins_in_words(running.parts.sensors)]

    @property
    def lasts_s(self) -> float | None:
        """About how long the frames go on, where a source knows it beforehand [s]; asking starts the run."""
        known = [source.lasts_s() for source in self._start_run().running.parts.sources]
        return max((lasts_s for lasts_s in known if lasts_s is not None), default=None)

    @property
    def path(self) -> TaughtPath | None:
        """The taught path as it was before the run; asking starts it."""
        return self._start_run().running.path

    @property
    def true_places(self) -> TaughtPlaces | None:
        """Where the places of the taught path really were, where somebody knows; asking starts the run."""
        taught = self._start_run().running.taught
        return None if taught is None else taught.true_places

    @property
    def counters(self) -> Mapping[str, int]:
        """What has been counted so far."""
        return self._run.counters() if self._run is not None else {}

    @property
    def n_waypoints(self) -> int:
        """How many waypoints of the path store are committed, while teaching."""
        return 0 if self._run is None else self._run.n_waypoints

    @property
    def has_ended(self) -> bool:
        """Whether there is a result."""
        return self._run is not None and self._run.result is not None

    @property
    def result(self) -> RunResult:
        """How the run ended.

        Raises
        ------
        RunError
            If it has not.
        """
        result = self._run.result if self._run is not None else None
        if result is None:
            raise RunError("the run has not ended; iterate over the pipeline, or close it")
        return result

    def _start_run(self) -> Run:
        with self._lock, shielded():  # a run that has begun is one that can be ended
            if self._run is None:
                self._run = self._new_run()
                self.parts.call_hook("trailmark_run_started", run=self)
            return self._run

    def _new_run(self) -> Run:
        try:
            recorder = self._new_recorder()
            return Run(self.parts, self._pushed, self._instruments, recorder=recorder, on_end=self._call_end_hook)
        except BaseException:
            if self.folder is not None:
                with suppress(OSError):
                    self.folder.rmdir()  # it is empty: nothing has run
            raise

    def _new_window(self, reorder_s: float) -> ReorderWindow[Frame]:
        from trailmark.sources.reorder import ReorderWindow  # most frames that are pushed come in order

        return ReorderWindow(self._pushed, reorder_s)

    def _new_recorder(self) -> Recorder | None:
        if self.folder is None:
            return None
        from trailmark.pipeline.outputs.recorder import Recorder  # not every run is recorded

        parts, config = self.parts, self.config
        loaded = [] if config is None else [record for record in config.plugins.records if record.status == "ok"]
        facts = {
            "mode": parts.settings.mode,
            "pace": "realtime" if parts.is_realtime else "step",
            "seed": parts.settings.seed,
            "plugins": {f"{record.distribution}:{record.name}": record.version for record in loaded},
        }
        return Recorder(self.folder, facts, parts.base_dir)

    def _call_end_hook(self, result: RunResult) -> None:
        self.parts.call_hook("trailmark_run_finished", run=self, result=result)


def _prepare_out(out: str | Path, overwrite: bool) -> Path:
    from trailmark.pipeline.outputs.run_folder import prepare_folder

    return prepare_folder(out, overwrite)
