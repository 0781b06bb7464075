"""A run in the archetypes of Rerun: into a recording, and to a viewer."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb

from trailmark.commands import Command
from trailmark.errors import ConfigError
from trailmark.estimates import Applied, Belief, Estimate, Fix, Lost
from trailmark.frames import RGBD, Frame, Image, Imu, Odometry, Record, Scan, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import RunEnd, Session, Sink
from trailmark_viewers import rerun_archetypes as shown
from trailmark_viewers.common import belief_numbers
from trailmark_viewers.config import RerunConfig
from trailmark_viewers.rerun_viewer import find_viewer

__all__ = ["RerunSink"]

_BASE = "map/odom/base"
_TIMELINE = "time"
# Stamps beyond are seconds of the epoch and shown as dates; the others are seconds of the run.
_EPOCH_S = 1e8
# A viewer that does not answer any more must not hold the run up for longer [s].
_PATIENCE_S = 5.0
_LEVELS = {"accepted": "INFO", "late": "INFO", "unused": "DEBUG"}
_COLOURS = {"accepted": (44, 160, 44), "gated": (214, 39, 40), "refused": (214, 39, 40)}
_GREY = (127, 127, 127)
_BLUE = (31, 119, 180)


class RerunSink(Sink):
    """Logs what happens as entities.

    ``map/odom/base`` the robot, ``map/odom/base/NAME`` its sensors with their pictures, spots and sightings,
    ``map/way`` where it believes to have been, ``map/fixes/NAME`` fixes, coloured by what became of them, ``map/path``
    the taught path, ``map/landmarks/NAME`` landmarks that are known; ``belief/...``, ``sensors/...``, ``commands/...``
    and ``estimates/NAME/...`` numbers to plot, ``estimates/NAME`` and ``log`` text. Times are the run's stamps.
    """

    def __init__(self, config: RerunConfig) -> None:
        super().__init__(config)
        self._config = config
        self._stream: Any = None
        self._sensors: Mapping[str, SensorInfo] = {}
        self._has_lens: set[str] = set()
        self._last: tuple[str, Pose2] | None = None
        self._last_s = 0.0
        self._is_dated: bool | None = None

    def start(self, session: Session) -> None:
        """Open the recording, and find or open the viewer.

        Raises
        ------
        ConfigError
            If the file cannot be written, or no viewer answers.
        """
        self.close()
        self._sensors, self._has_lens, self._last, self._is_dated = session.sensors, set(), None, None
        stream = rr.RecordingStream("trailmark", send_properties=False)
        stream.set_log_time_enabled(False)
        stream.set_log_tick_enabled(False)
        stream.set_sinks(*self._targets(), default_blueprint=_blueprint(session.sensors))
        self._stream = stream
        self._stand_still(session)

    def close(self) -> None:
        """Complete the recording, and let the viewer go."""
        stream, self._stream = self._stream, None
        if stream is None:
            return
        with suppress(RuntimeError, ValueError):  # the viewer is gone; the file is completed all the same
            stream.flush(timeout_sec=_PATIENCE_S)
        stream.disconnect()

    def on_frame(self, frame: Frame) -> None:
        """Log a frame."""
        self._at(frame.stamp_s)
        entity, numbers = f"{_BASE}/{frame.sensor}", f"sensors/{frame.sensor}"
        match frame.payload:
            case Image(pixels=pixels):
                self._picture(frame.sensor, pixels)
            case RGBD(bgr=bgr, depth_m=depth_m):
                self._picture(frame.sensor, bgr)
                self._depth(frame.sensor, depth_m)
            case Scan() as sweep:
                self._stream.log(f"{entity}/scan", shown.scan(sweep))
            case Odometry(pose_start_base=pose, distance_m=distance_m):
                self._numbers(f"{numbers}/pose", [] if pose is None else [pose.x, pose.y, pose.theta])
                self._numbers(f"{numbers}/distance_m", [distance_m])
            case Imu() as imu:
                self._numbers(f"{numbers}/angular_velocity_radps", imu.angular_velocity_radps.tolist())
                if imu.linear_acceleration_mps2 is not None:
                    self._numbers(f"{numbers}/linear_acceleration_mps2", imu.linear_acceleration_mps2.tolist())
            case Record() as record if (seen := shown.sightings(record)) is not None:
                self._stream.log(f"{entity}/sightings", seen)
            case other:
                for name, number in other.numbers().items():
                    self._numbers(f"{numbers}/{name}", [number])

    def on_estimate(self, source: str, estimate: Estimate, applied: Applied) -> None:
        """Log an estimate and what became of it."""
        self._at(estimate.stamp_s)
        said, level = type(estimate).__name__, _LEVELS.get(applied.status, "WARN")
        if isinstance(estimate, Lost):
            said, level = f"Lost, {estimate.reason}", "WARN"
        became = f"{applied.status} {applied.reason}".strip()
        self._stream.log(f"estimates/{source}", rr.TextLog(f"{said}: {became}", level=level))
        self._numbers(f"estimates/{source}/nis", [applied.nis])
        for name, value in estimate.details.items():
            self._numbers(f"estimates/{source}/{name}", [value])
        if isinstance(estimate, Fix):
            pose, colour = estimate.pose_map_base, _COLOURS.get(applied.status, _GREY)
            self._stream.log(f"map/fixes/{source}", rr.Points3D([[pose.x, pose.y, 0.0]], colors=[colour], radii=0.02))

    def on_belief(self, belief: Belief) -> None:
        """Log what is believed, as frames, as the way so far and as numbers to plot."""
        self._at(belief.stamp_s)
        pose, frame = belief.pose_map_base, "map"
        if pose is None:
            pose, frame = belief.pose_odom_base, "map/odom"
        else:
            self._stream.log("map/odom", shown.transform(pose @ belief.pose_odom_base.inverse()))
        self._stream.log(_BASE, shown.transform(belief.pose_odom_base))
        if self._last is not None and self._last[0] == frame:
            self._stream.log(f"{frame}/way", shown.line([self._last[1], pose], _BLUE))
        self._last = (frame, pose)
        numbers = belief_numbers(belief)
        for name in ("forward_mps", "yaw_radps", "travelled_m", "fix_age_m", "motion_age_s"):
            self._numbers(f"belief/{name}", [numbers[name]])
        if numbers["on_path"] is not None:
            for name, value in zip(("station_m", "lateral_m", "heading_rad"), numbers["on_path"], strict=True):
                self._numbers(f"belief/on_path/{name}", [value])

    def on_command(self, stamp_s: float, command: Command) -> None:
        """Log a command."""
        self._at(stamp_s)
        for field in fields(command):
            value = getattr(command, field.name)
            if isinstance(value, float):
                self._numbers(f"commands/{field.name}", [value])
            elif value:
                self._stream.log("commands", rr.TextLog(f"{type(command).__name__} {field.name} {value}"))

    def on_end(self, end: RunEnd) -> None:
        """Log how the run ended."""
        self._at(self._last_s)
        level = "ERROR" if end.status == "failed" else "INFO"
        self._stream.log("log", rr.TextLog(f"{end.status} {end.reason}".strip(), level=level))

    # --- where it goes ---------------------------------------------------------------------------------------------

    def _targets(self) -> list[Any]:
        config = self._config
        targets: list[Any] = []
        if config.path is not None:
            try:
                config.path.open("wb").close()  # Rerun opens it later, and says less
            except OSError as error:
                raise ConfigError(f"rerun cannot write to {config.path}: {error.strerror or error}") from error
            targets.append(rr.FileSink(config.path))
        if config.live or config.spawn:
            find_viewer(config.host, config.port, spawn=config.spawn)
            targets.append(rr.GrpcSink(f"rerun+http://{config.host}:{config.port}/proxy"))
        return targets

    # --- entities --------------------------------------------------------------------------------------------------

    def _at(self, stamp_s: float) -> None:
        """Set the time of what is logged next."""
        self._last_s = max(self._last_s, stamp_s)
        if self._is_dated is None:
            self._is_dated, self._last_s = stamp_s > _EPOCH_S, stamp_s
        if self._is_dated:
            self._stream.set_time(_TIMELINE, timestamp=stamp_s)
        else:
            self._stream.set_time(_TIMELINE, duration=stamp_s)

    def _stand_still(self, session: Session) -> None:
        """Log what is the same all the time."""
        log = self._stream.log
        log("map", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        log(f"{_BASE}/robot", rr.Arrows3D(vectors=[[0.3, 0.0, 0.0]], colors=[_BLUE], radii=0.02), static=True)
        for name, info in session.sensors.items():
            log(f"{_BASE}/{name}", shown.transform(info.pose_base_sensor), static=True)
            landmarks = shown.known_landmarks(info.calibration)
            if landmarks is not None:
                log(f"map/landmarks/{name}", landmarks, static=True)
        if session.path is not None:
            poses = [waypoint.pose_map_base for waypoint in session.path.waypoints]
            log("map/path", shown.line(poses, _GREY), static=True)

    def _picture(self, sensor: str, pixels: npt.NDArray[Any]) -> None:
        if self._config.pictures == "none":
            return
        entity = _picture_of(sensor)
        info = self._sensors.get(sensor)
        lens = None if info is None else shown.lens(info.calibration)
        if lens is not None and entity not in self._has_lens:
            self._has_lens.add(entity)
            self._stream.log(entity, shown.pinhole(lens, pixels), static=True)
        self._stream.log(entity, shown.picture(pixels, self._config.pictures, self._config.jpeg_quality))

    def _depth(self, sensor: str, depth_m: npt.NDArray[np.float32]) -> None:
        if self._config.pictures == "none":
            return
        entity = _depth_of(sensor)
        info = self._sensors.get(sensor)
        found = None if info is None else shown.depth_lens(info.calibration)
        if found is not None and entity not in self._has_lens:
            self._has_lens.add(entity)
            lens, pose_colour_depth = found
            self._stream.log(entity, shown.transform(pose_colour_depth), shown.pinhole(lens, depth_m), static=True)
        self._stream.log(entity, shown.depth_picture(depth_m))

    def _numbers(self, entity: str, values: list[Any]) -> None:
        scalars = shown.scalars(values)
        if scalars is not None:
            self._stream.log(entity, scalars)


def _picture_of(sensor: str) -> str:
    return f"{_BASE}/{sensor}/picture"


def _depth_of(sensor: str) -> str:
    return f"{_BASE}/{sensor}/depth"


def _blueprint(sensors: Mapping[str, SensorInfo]) -> Any:
    """Return what the viewer shows first: the scene with the whole way, pictures, numbers, lines of text."""
    so_far = rrb.VisibleTimeRange(
        _TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
    )
    ways = ["map/way", "map/odom/way", "map/fixes/**"]
    scene = rrb.Spatial3DView(
        origin="map",
        contents=["$origin/**", *_flat_pictures(sensors)],
        name="scene",
        overrides={entity: [rrb.VisibleTimeRanges([so_far])] for entity in ways},
    )
    pictures = [
        rrb.Spatial2DView(origin=_picture_of(name), name=name)
        for name, info in sensors.items()
        if info.kind in ("image", "rgbd")
    ]
    plots = [rrb.TimeSeriesView(origin=name, name=name) for name in ("belief", "estimates", "commands")]
    text = rrb.TextLogView(contents=["estimates/**", "commands", "log"], name="what was said")
    right = rrb.Vertical(*([rrb.Tabs(*pictures)] if pictures else []), rrb.Tabs(*plots), text)
    return rrb.Blueprint(rrb.Horizontal(scene, right, column_shares=[3, 2]), collapse_panels=True)


def _flat_pictures(sensors: Mapping[str, SensorInfo]) -> list[str]:
    """Return what leaves pictures without a lens out of the scene, where the viewer calls them errors."""
    colour = [_picture_of(name) for name, info in sensors.items() if shown.lens(info.calibration) is None]
    depth = [_depth_of(name) for name, info in sensors.items() if shown.depth_lens(info.calibration) is None]
    return [f"- {entity}" for entity in (*colour, *depth)]
