"""A frame source with the options that every source has: offset, names, window, calibration, checks, faults."""

from __future__ import annotations

import logging
import math
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from time import perf_counter_ns
from typing import TYPE_CHECKING

import numpy as np

import trailmark.frames
from trailmark.clock import live_stamp_s
from trailmark.config import LiveSourceConfig, Mounting, SensorOverride, SourceConfig
from trailmark.errors import ConfigError, SourceError, SourceFailedError
from trailmark.failures import call_guarded, is_from_user, raise_failure, words_of
from trailmark.frames import Frame, SensorInfo
from trailmark.geometry import Pose3, Trajectory, read_tum
from trailmark.geometry.trajectory import FARTHEST_M
from trailmark.interfaces import Drivable, FrameSource, Session
from trailmark.pipeline.instruments import SOURCE_COUNTS, Counters, counts_of
from trailmark.pipeline.sources.checks import FrameChecks

if TYPE_CHECKING:
    from trailmark.pipeline.sources.perturbing import Perturber

__all__ = ["SourceStream", "corrected", "corrected_sensors", "ground_truth_of", "outlines_of"]

logger = logging.getLogger(__name__)


class SourceStream:
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
        calibration: trailmark.frames.Calibration | None = None,
        perturber: Perturber | None = None,
    ) -> None:
        self.name = name
        self.source = source
        self.sensors: Mapping[str, SensorInfo] = {}
        self.n_frames = 0
        self.first_s = -math.inf
        self._options = options
        self._calibration = calibration
        self._counters = Counters()
        self._times: array[int] = array("q")
        self._is_closed = False
        self._truth: Trajectory | None = None
        self._perturber = perturber

    @property
    def is_live(self) -> bool:
        """Whether frames come when they come."""
        return self.source.is_live

    @property
    def reorder_s(self) -> float:
        """How long frames of others wait at most for an earlier one of a live source [s]."""
        return self._options.reorder_s if isinstance(self._options, LiveSourceConfig) else 0.0

    @property
    def drivable(self) -> Drivable | None:
        """The source as a robot, if it is one."""
        return self.source if isinstance(self.source, Drivable) else None

    # --- life ------------------------------------------------------------------------------------------------------

    def start(self, session: Session, counters: Counters | None = None, times: array[int] | None = None) -> None:
        """Start the source; afterwards `sensors` are known, renamed and corrected.

        Parameters
        ----------
        session : Session
            What the source is told.
        counters : Counters, optional
            Takes ``source.NAME.frames`` and what is left out.
        times : array of int, optional
            Takes how long each frame took to come [ns].

        Raises
        ------
        RunError
            If the source raises what is no error of Trailmark.
        """
        self._counters = Counters() if counters is None else counters
        self._times = array("q") if times is None else times
        self._is_closed = False
        self.n_frames, self.first_s = 0, -math.inf
        path = self._options.ground_truth
        self._truth = None if path is None else read_tum(path)  # a wrong file shows before the run, not after it
        call_guarded(f"source {self.name!r}", "start", lambda: self.source.start(session))
        self.sensors = self._named(call_guarded(f"source {self.name!r}", "sensors", self._own_sensors))
        if self._perturber is not None:
            self._perturber.start(session, self.sensors)

    def close(self) -> None:
        """Close the source; `frames` then ends. Any thread, twice."""
        self._is_closed = True
        try:
            call_guarded(f"source {self.name!r}", "close", self.source.close)
        finally:
            if self._perturber is not None:
                self._perturber.close()

    def counters(self) -> Mapping[str, int]:
        """Return what the source and its faults counted themselves."""
        own = counts_of(self.source.counters(), SOURCE_COUNTS)
        return own if self._perturber is None else {**own, **self._perturber.counters()}

    # --- frames ----------------------------------------------------------------------------------------------------

    def frames(self) -> Iterator[Frame]:
        """Yield the frames between ``start_s`` and ``stop_s``, none twice, with the faults that are asked for.

        Those of a live source come in the order of the stamps of each sensor alone.

        Raises
        ------
        SourceError
            If the source fails, gives what it must not, or gives nothing at all.
        """
        options = self._options
        frames = self._timed()
        if options.time_offset_s or options.rename:
            frames = _shifted(frames, options.time_offset_s, options.rename)
        skips = options.on_bad_frame == "skip"
        checks = FrameChecks(self.name, self.sensors, skips, self._counters)
        checks.are_in_order = not self.is_live
        if skips and not self.is_live and self.drivable is None:  # a robot is not asked for the frames to come
            frames = checks.without_future(frames)
        if self.is_live:
            frames = checks.timely(frames, live_stamp_s)
        window = _Window(options.start_s or 0.0, options.stop_s or math.inf)
        if window.is_bounded:
            frames = window.until_its_end(frames)
        frames = self._accepted(frames, checks, window)
        return frames if self._perturber is None else self._perturber.frames(frames)

    def ground_truth(self) -> Trajectory | None:
        """Return the true trajectory, from the file that the options name or from the source, in the run's clock."""
        truth = self.source.ground_truth() if self._truth is None else self._truth
        if truth is not None and not isinstance(truth, Trajectory):
            raise TypeError(f"it gave {type(truth).__name__}, not a Trajectory")
        if truth is not None and len(truth) and (farthest_m := float(np.abs(truth.poses[:, :2]).max())) > FARTHEST_M:
            raise ValueError(f"it reaches {farthest_m:.3g} m")
        offset_s = self._options.time_offset_s
        return Trajectory(truth.stamps_s + offset_s, truth.poses) if truth is not None and offset_s else truth

    def lasts_s(self) -> float | None:
        """Return about how long the frames between ``start_s`` and ``stop_s`` go on, where it is known [s]."""
        ends_s = min(self._told_to_last_s(), self._options.stop_s or math.inf)
        left_s = ends_s - (self._options.start_s or 0.0)
        return left_s if 0.0 < left_s < math.inf else None

    def _told_to_last_s(self) -> float:
        """Return what the source says of its end; infinity for nothing of use: it is for a bar, and ends no run."""
        try:
            told = self.source.lasts_s()
            if isinstance(told, Real) and 0.0 < (lasts_s := float(told)) < math.inf:
                return lasts_s
        except BaseException as error:
            if is_from_user(error):
                raise
            logger.debug("source %r does not say how long it lasts: %s", self.name, words_of(error))
        return math.inf

    def _timed(self) -> Iterator[Frame]:
        """Yield the source's frames and note how long each took to come; what it raises names the source."""
        frames: Iterator[Frame] | None = None
        while True:
            began_ns = perf_counter_ns()
            try:
                frames = iter(self.source.frames()) if frames is None else frames
                frame = next(frames, None)
                if frame is not None and not isinstance(frame, Frame):
                    raise TypeError(f"it gave {type(frame).__name__}, not a Frame")
            except BaseException as error:
                raise_failure(error, f"source {self.name!r}", "frames", kind=SourceFailedError)
            if frame is None:
                return
            self._times.append(perf_counter_ns() - began_ns)
            yield frame

    def _accepted(self, frames: Iterator[Frame], checks: FrameChecks, window: _Window) -> Iterator[Frame]:
        """Yield the frames that are good and not too early, and count them."""
        counter = f"source.{self.name}.frames"
        for frame in frames:
            if not checks.accept(frame) or frame.stamp_s < window.begins_s:
                continue
            if not self.n_frames:
                self.first_s = frame.stamp_s
            self.n_frames += 1
            self._counters[counter] += 1
            yield frame
        if not self.n_frames and not self._is_closed:
            where = " in its window (start_s, stop_s)" if self._times else ""
            raise SourceError(f"source {self.name!r} gave no frame{where}")

    # --- sensors ---------------------------------------------------------------------------------------------------

    def known_sensors(self, overrides: Mapping[str, SensorOverride]) -> dict[str, SensorInfo]:
        """Return the sensors as the run shall know them: corrected by the config, and wrong where that is asked for."""
        right = corrected_sensors(self.sensors, overrides)
        return {name: self.with_assumed_calibration(info) for name, info in right.items()}

    def with_assumed_calibration(self, info: SensorInfo) -> SensorInfo:
        """Return a sensor as the run shall believe it to be: as it is, unless its calibration is wrong on purpose."""
        return info if self._perturber is None else self._perturber.believed(info)

    def origins_in_words(self, overrides: Mapping[str, SensorOverride]) -> list[str]:
        """Return a line for each sensor of which the recording says mounting or calibration: which one is used."""
        lines = []
        for old, origin in call_guarded(
            f"source {self.name!r}", "origins", lambda: dict(self.source.origins())
        ).items():
            name = self._options.rename.get(old, old)
            override = overrides.get(name, SensorOverride())
            is_mounted = (override.mounting or self._options.mounting) is not None
            is_calibrated = (override.calibration or self._calibration) is not None
            told = (("mounting", origin.mounting, is_mounted), ("calibration", origin.calibration, is_calibrated))
            words = [f"{what} of {'the config, not of ' if wins else ''}{where}" for what, where, wins in told if where]
            if words:
                lines.append(f"{name}: {', '.join(words)}")
        return lines

    def _own_sensors(self) -> dict[str, SensorInfo]:
        sensors = dict(self.source.sensors)
        for info in sensors.values():
            if not isinstance(info, SensorInfo):
                raise TypeError(f"it gave {type(info).__name__} in its sensors, not a SensorInfo")
        return sensors

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


class _Window:
    """The part of a recording that is played, counted from its first frame."""

    def __init__(self, start_s: float, stop_s: float) -> None:
        self._start_s, self._stop_s = start_s, stop_s
        #: Frames before this are too early; known once the first one is there [s].
        self.begins_s = -math.inf

    @property
    def is_bounded(self) -> bool:
        """Whether anything is left out."""
        return self._start_s > 0.0 or self._stop_s < math.inf

    def until_its_end(self, frames: Iterator[Frame]) -> Iterator[Frame]:
        """Yield frames until the window closes; the first opens it."""
        ends_s = math.inf
        for index, frame in enumerate(frames):
            if index == 0:
                self.begins_s, ends_s = frame.stamp_s + self._start_s, frame.stamp_s + self._stop_s
            if frame.stamp_s > ends_s:
                return
            yield frame


def _shifted(frames: Iterator[Frame], offset_s: float, rename: Mapping[str, str]) -> Iterator[Frame]:
    for frame in frames:
        yield Frame(rename.get(frame.sensor, frame.sensor), frame.stamp_s + offset_s, frame.payload)


def corrected(
    info: SensorInfo, mounting: Mounting | None, calibration: trailmark.frames.Calibration | None
) -> SensorInfo:
    """Return a sensor with what the config says about it; None: as the source says."""
    if mounting is not None:
        roll, pitch, yaw = (math.radians(a) for a in (mounting.roll_deg, mounting.pitch_deg, mounting.yaw_deg))
        info = replace(info, pose_base_sensor=Pose3(mounting.x, mounting.y, mounting.z, roll, pitch, yaw))
    return info if calibration is None else replace(info, calibration=calibration)


def corrected_sensors(
    sensors: Mapping[str, SensorInfo], overrides: Mapping[str, SensorOverride]
) -> dict[str, SensorInfo]:
    """Return sensors with what the section ``sensors`` of the config says about them."""
    as_it_is = SensorOverride()
    return {
        name: corrected(info, overrides.get(name, as_it_is).mounting, overrides.get(name, as_it_is).calibration)
        for name, info in sensors.items()
    }


def ground_truth_of(sources: Sequence[SourceStream]) -> Trajectory | None:
    """Return the truth of the first source that knows it; one that fails to say is a warning."""
    for source in sources:
        try:
            truth = source.ground_truth()
        except BaseException as error:
            if is_from_user(error):
                raise
            logger.warning("source %r gives no ground truth: %s", source.name, words_of(error))
            continue
        if truth is not None:
            return truth
    return None


def outlines_of(sources: Sequence[SourceStream]) -> trailmark.frames.Outlines | None:
    """Return the outlines of the first source that knows some; one that fails to say is a warning."""
    for stream in sources:
        try:
            outlines = _checked_outlines(stream.source)
        except BaseException as error:
            if is_from_user(error):
                raise
            logger.warning("source %r gives no outlines: %s", stream.name, words_of(error))
            continue
        if outlines is not None:
            return outlines
    return None


def _checked_outlines(source: FrameSource) -> trailmark.frames.Outlines | None:
    outlines = source.outlines()
    if outlines is None:
        return None
    if not isinstance(outlines, trailmark.frames.Outlines):
        raise TypeError(f"it gave {type(outlines).__name__}, not Outlines")
    return outlines
