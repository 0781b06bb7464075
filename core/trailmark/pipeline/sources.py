"""Frame sources with the options that every source has: offset, window, names, calibration, checks, counts."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import replace
from time import perf_counter_ns

from trailmark.config import Mounting, SourceConfig
from trailmark.errors import ConfigError, SourceError, TrailmarkError
from trailmark.frames import Calibration, Frame, SensorInfo
from trailmark.geometry import Pose3, Trajectory, read_tum
from trailmark.interfaces import Drivable, FrameSource, Session
from trailmark.pipeline.checks import FrameChecks
from trailmark.pipeline.counters import Counters
from trailmark.pipeline.perturbing import Perturber

__all__ = ["Feed", "corrected"]


class Feed:
    """One source of a run: started, checked, counted, and with the options of its config.

    Stamps of one sensor strictly increase: a repeated frame is dropped and counted; one that goes back, changes its
    size or carries another kind of payload is an error, or with ``on_bad_frame: skip`` a counted skip.

    Parameters
    ----------
    name : str
        Of the source, in the config.
    source : FrameSource
        What gives the frames.
    options : SourceConfig
        The options; plugin keys in it are the source's own.
    calibration : Calibration, optional
        Of the source's only sensor.
    perturber : Perturber, optional
        Applies the faults that are asked for.
    """

    def __init__(
        self,
        name: str,
        source: FrameSource,
        options: SourceConfig,
        calibration: Calibration | None = None,
        perturber: Perturber | None = None,
    ) -> None:
        self.name = name
        self.source = source
        self._options = options
        self._calibration = calibration
        self._counters = Counters()
        self._times: array[int] = array("q")
        self._is_closed = False
        self._truth: Trajectory | None = None
        self._perturber = perturber
        self.sensors: Mapping[str, SensorInfo] = {}
        self.n_frames = 0
        self.first_s = -math.inf

    @property
    def is_live(self) -> bool:
        """Whether frames come when they come."""
        return self.source.is_live

    @property
    def drivable(self) -> Drivable | None:
        """The source as a robot, if it is one."""
        return self.source if isinstance(self.source, Drivable) else None

    def prepare(self, counters: Counters, times: array[int]) -> None:
        """Take the run's counters, and where to note how long each frame took to come [ns]."""
        self._counters, self._times = counters, times

    def start(self, session: Session) -> None:
        """Start the source; afterwards `sensors` are known, renamed and corrected."""
        self._is_closed = False
        self.n_frames = 0
        self.first_s = -math.inf
        path = self._options.ground_truth
        self._truth = None if path is None else read_tum(path)  # a wrong file shows before the run, not after it
        self.source.start(session)
        self.sensors = self._named(self.source.sensors)
        if self._perturber is not None:
            self._perturber.start(session, self.sensors)

    def close(self) -> None:
        """Close the source; `frames` then ends. Any thread, twice."""
        self._is_closed = True
        self.source.close()
        if self._perturber is not None:
            self._perturber.close()

    def counters(self) -> Mapping[str, int]:
        """Return what the source and its faults counted themselves."""
        own = self.source.counters()
        return own if self._perturber is None else {**own, **self._perturber.counters()}

    def frames(self) -> Iterator[Frame]:
        """Yield the frames between ``start_s`` and ``stop_s``, none twice, with the faults that are asked for.

        Raises
        ------
        SourceError
            If the source fails, gives what it must not, or gives nothing at all.
        """
        return self._good() if self._perturber is None else self._perturber.frames(self._good())

    def believed(self, info: SensorInfo) -> SensorInfo:
        """Return a sensor as the run shall believe it to be: as it is, unless its calibration is wrong on purpose."""
        return info if self._perturber is None else self._perturber.believed(info)

    def _good(self) -> Iterator[Frame]:
        start_s, stop_s = self._options.start_s or 0.0, self._options.stop_s or math.inf
        checks = FrameChecks(self.name, self.sensors, self._options.on_bad_frame == "skip", self._counters)
        opened_s: float | None = None
        for frame in self._timed():
            opened_s = frame.stamp_s if opened_s is None else opened_s
            if frame.stamp_s > opened_s + stop_s:
                break
            if checks.accept(frame) and frame.stamp_s >= opened_s + start_s:
                self.n_frames += 1
                self.first_s = frame.stamp_s if self.n_frames == 1 else self.first_s
                self._counters.add(f"source.{self.name}.frames")
                yield frame
        if not self.n_frames and not self._is_closed:
            window = " in its window (start_s, stop_s)" if opened_s is not None else ""
            raise SourceError(f"source {self.name!r} gave no frame{window}")

    def ground_truth(self) -> Trajectory | None:
        """Return the true trajectory, from the file that the options name or from the source, in the run's clock."""
        truth = self.source.ground_truth() if self._truth is None else self._truth
        offset_s = self._options.time_offset_s
        return Trajectory(truth.stamps_s + offset_s, truth.poses) if truth is not None and offset_s else truth

    def _timed(self) -> Iterator[Frame]:
        """Yield the source's frames with offset and names, and time how long each took to come."""
        offset_s, rename = self._options.time_offset_s, self._options.rename
        frames = self.source.frames()
        while True:
            began_ns = perf_counter_ns()
            try:
                frame = next(frames, None)
            except (TrailmarkError, KeyboardInterrupt):
                raise
            except Exception as error:
                raise SourceError(f"source {self.name!r} raised {type(error).__name__}: {error}") from error
            if frame is None:
                return
            self._times.append(perf_counter_ns() - began_ns)
            if offset_s or rename:
                frame = Frame(rename.get(frame.sensor, frame.sensor), frame.stamp_s + offset_s, frame.payload)
            yield frame

    def _named(self, sensors: Mapping[str, SensorInfo]) -> dict[str, SensorInfo]:
        options, names = self._options, ", ".join(sensors)
        for old in options.rename:
            if old not in sensors:
                raise ConfigError(f"sources.{self.name}.rename: the source has no sensor {old!r}; it has {names}")
        if (options.mounting or self._calibration) and len(sensors) != 1:
            raise ConfigError(
                f"sources.{self.name}: calibration and mounting are for a source of one sensor, and this one has"
                f" {names or 'none'}; write them under sensors:"
            )
        named = {}
        for old, info in sensors.items():
            new = options.rename.get(old, old)
            if new in named:
                raise ConfigError(f"sources.{self.name}.rename: two sensors would be called {new!r}")
            named[new] = corrected(replace(info, name=new), options.mounting, self._calibration)
        return named


def corrected(info: SensorInfo, mounting: Mounting | None, calibration: Calibration | None) -> SensorInfo:
    """Return a sensor with what the config says about it; None: as the source says."""
    if mounting is not None:
        roll, pitch, yaw = (math.radians(a) for a in (mounting.roll_deg, mounting.pitch_deg, mounting.yaw_deg))
        info = replace(info, pose_base_sensor=Pose3(mounting.x, mounting.y, mounting.z, roll, pitch, yaw))
    return info if calibration is None else replace(info, calibration=calibration)
