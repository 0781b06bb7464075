"""A run in the message schemas of Foxglove: into an MCAP file, and to who is connected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import foxglove
import numpy as np
import numpy.typing as npt
from foxglove import channels, messages

from trailmark.commands import Command
from trailmark.errors import ConfigError
from trailmark.estimates import Applied, Belief, Estimate, Fix
from trailmark.frames import RGBD, Frame, Image, Imu, Odometry, Record, Scan
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import RunEnd, Session, Sink
from trailmark_viewers.common import belief_numbers, estimate_numbers, jpeg, plain, quaternion_xyzw, to_space
from trailmark_viewers.config import FoxgloveConfig

__all__ = ["FoxgloveSink"]

_NS = 1_000_000_000
_ENCODINGS = {("uint8", 2): "mono8", ("uint8", 3): "bgr8", ("uint16", 2): "mono16", ("float32", 2): "32FC1"}
_ANY = {"type": "object"}


class FoxgloveSink(Sink):
    """Writes what happens as topics.

    ``/sensors/NAME`` the frames, ``/belief`` the pose, ``/tf`` the transforms, ``/belief/numbers``, ``/path`` the
    taught path, ``/estimates/NAME`` every estimate and what became of it, ``/fixes/NAME`` the poses of fixes,
    ``/commands``, ``/log``. Frames: ``map``, ``odom``, ``base``, and one of each sensor. Times are the run's stamps.
    """

    def __init__(self, config: FoxgloveConfig) -> None:
        super().__init__(config)
        self._config = config
        self._context: Any = None
        self._writer: Any = None
        self._server: Any = None
        self._channels: dict[str, Any] = {}
        self._last_s = 0.0

    def start(self, session: Session) -> None:
        """Open the file and listen.

        Raises
        ------
        ConfigError
            If the file cannot be written, or the port is taken.
        """
        self.close()
        self._context = foxglove.Context()
        config = self._config
        try:
            if config.path is not None:
                self._writer = foxglove.open_mcap(config.path, allow_overwrite=True, context=self._context)
            if config.live:
                self._server = foxglove.start_server(
                    name=session.name, host=config.host, port=config.port, context=self._context
                )
        except (OSError, RuntimeError) as error:
            place = config.path if self._writer is None and config.path is not None else f"{config.host}:{config.port}"
            raise ConfigError(f"foxglove cannot write to {place}: {error}") from error
        self._mountings = {name: info.pose_base_sensor for name, info in session.sensors.items()}
        self._path = [] if session.path is None else [w.pose_map_base for w in session.path.waypoints]
        self._told_still = False

    def close(self) -> None:
        """Complete the file, and stop listening."""
        writer, self._writer = self._writer, None
        server, self._server = self._server, None
        if writer is not None:
            writer.close()
        if server is not None:
            server.stop()
        self._channels.clear()
        self._context = None

    @property
    def port(self) -> int | None:
        """Where it listens; None while it does not."""
        return None if self._server is None else int(self._server.port)

    def on_frame(self, frame: Frame) -> None:
        """Write a frame."""
        self._stand_still(frame.stamp_s)
        topic, stamp_s, name = f"/sensors/{frame.sensor}", frame.stamp_s, frame.sensor
        match frame.payload:
            case Image(pixels=pixels):
                self._picture(topic, stamp_s, name, pixels)
            case RGBD(bgr=bgr, depth_m=depth_m):
                self._picture(topic, stamp_s, name, bgr)
                self._picture(f"{topic}/depth", stamp_s, name, depth_m)
            case Scan() as scan:
                self._log(topic, channels.LaserScanChannel, stamp_s, _scan(scan, name, _timestamp(stamp_s)))
            case Odometry(pose_start_base=pose, distance_m=distance_m):
                self._json(topic, stamp_s, {"pose_start_base": plain(pose), "distance_m": distance_m})
            case Imu() as imu:
                names = ("angular_velocity_radps", "linear_acceleration_mps2", "quat_xyzw")
                self._json(topic, stamp_s, {name: plain(getattr(imu, name)) for name in names})
            case Record(arrays=arrays):
                self._json(topic, stamp_s, {name: plain(array) for name, array in arrays.items()})
            case other:
                self._json(topic, stamp_s, {name: plain(number) for name, number in other.numbers().items()})

    def on_estimate(self, source: str, estimate: Estimate, applied: Applied) -> None:
        """Write an estimate and what became of it."""
        told = {"kind": type(estimate).__name__, **estimate_numbers(estimate)}
        told |= {"status": applied.status, "reason": applied.reason, "nis": plain(applied.nis)}
        self._json(f"/estimates/{source}", estimate.stamp_s, told)
        if isinstance(estimate, Fix):
            self._pose(f"/fixes/{source}", estimate.stamp_s, "map", estimate.pose_map_base)

    def on_belief(self, belief: Belief) -> None:
        """Write what is believed, as a pose and as numbers to plot."""
        stamp_s, pose = belief.stamp_s, belief.pose_map_base
        if pose is not None:
            self._pose("/belief", stamp_s, "map", pose)
            self._transform(stamp_s, "map", "odom", to_space(pose @ belief.pose_odom_base.inverse()))
        self._transform(stamp_s, "odom", "base", to_space(belief.pose_odom_base))
        self._json("/belief/numbers", stamp_s, belief_numbers(belief))

    def on_command(self, stamp_s: float, command: Command) -> None:
        """Write a command."""
        self._json("/commands", stamp_s, {"kind": type(command).__name__, **asdict(command)})

    def on_end(self, end: RunEnd) -> None:
        """Write how the run ended."""
        level = messages.LogLevel.Error if end.status == "failed" else messages.LogLevel.Info
        message = messages.Log(
            timestamp=_timestamp(self._last_s), level=level, message=f"{end.status} {end.reason}".strip(), name="run"
        )
        self._log("/log", channels.LogChannel, self._last_s, message)

    # --- what is the same all the time -----------------------------------------------------------------------------

    def _stand_still(self, stamp_s: float) -> None:
        """Write mountings and taught path, with the first frame: before it there is no time."""
        if self._told_still:
            return
        self._told_still = True
        for name, mounting in self._mountings.items():
            self._transform(stamp_s, "base", name, mounting)
        if self._path:
            poses = [_message(to_space(pose)) for pose in self._path]
            path = messages.PosesInFrame(timestamp=_timestamp(stamp_s), frame_id="map", poses=poses)
            self._log("/path", channels.PosesInFrameChannel, stamp_s, path)

    # --- messages --------------------------------------------------------------------------------------------------

    def _picture(self, topic: str, stamp_s: float, frame_id: str, pixels: npt.NDArray[Any]) -> None:
        if self._config.pictures == "none":
            return
        timestamp = _timestamp(stamp_s)
        if self._config.pictures == "jpeg" and pixels.dtype == np.uint8:
            data = jpeg(pixels, self._config.jpeg_quality)
            picture = messages.CompressedImage(timestamp=timestamp, frame_id=frame_id, data=data, format="jpeg")
            self._log(topic, channels.CompressedImageChannel, stamp_s, picture)
            return
        height, width = pixels.shape[:2]
        raw = messages.RawImage(
            timestamp=timestamp,
            frame_id=frame_id,
            width=width,
            height=height,
            encoding=_ENCODINGS[pixels.dtype.name, pixels.ndim],
            step=pixels.nbytes // height,
            data=np.ascontiguousarray(pixels).tobytes(),
        )
        self._log(topic, channels.RawImageChannel, stamp_s, raw)

    def _pose(self, topic: str, stamp_s: float, frame_id: str, pose: Pose2) -> None:
        message = messages.PoseInFrame(timestamp=_timestamp(stamp_s), frame_id=frame_id, pose=_message(to_space(pose)))
        self._log(topic, channels.PoseInFrameChannel, stamp_s, message)

    def _transform(self, stamp_s: float, parent: str, child: str, pose: Pose3) -> None:
        """Write ``pose_parent_child``: Foxglove's transform moves the child's origin within the parent."""
        message = messages.FrameTransform(
            timestamp=_timestamp(stamp_s),
            parent_frame_id=parent,
            child_frame_id=child,
            translation=messages.Vector3(x=pose.x, y=pose.y, z=pose.z),
            rotation=_quaternion(pose),
        )
        self._log("/tf", channels.FrameTransformChannel, stamp_s, message)

    def _json(self, topic: str, stamp_s: float, content: Mapping[str, Any]) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            channel = foxglove.Channel(topic, schema=_ANY, context=self._context)
            self._channels[topic] = channel
        self._last_s = max(self._last_s, stamp_s)
        channel.log({"stamp_s": stamp_s, **content}, log_time=_nanoseconds(stamp_s))

    def _log(self, topic: str, kind: Any, stamp_s: float, message: Any) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = kind(topic, context=self._context)
        self._last_s = max(self._last_s, stamp_s)
        channel.log(message, log_time=_nanoseconds(stamp_s))


def _nanoseconds(stamp_s: float) -> int:
    return max(0, round(stamp_s * _NS))  # MCAP knows no time before 1970


def _timestamp(stamp_s: float) -> Any:
    seconds, nanoseconds = divmod(_nanoseconds(stamp_s), _NS)
    return messages.Timestamp(seconds, nanoseconds)


def _quaternion(pose: Pose3) -> Any:
    x, y, z, w = quaternion_xyzw(pose)
    return messages.Quaternion(x=x, y=y, z=z, w=w)


def _message(pose: Pose3) -> Any:
    return messages.Pose(position=messages.Vector3(x=pose.x, y=pose.y, z=pose.z), orientation=_quaternion(pose))


def _scan(scan: Scan, frame_id: str, timestamp: Any) -> Any:
    last_rad = scan.angle_min_rad + scan.angle_step_rad * (len(scan.ranges_m) - 1)
    ranges = np.asarray(scan.ranges_m, dtype=np.float64).tolist()
    return messages.LaserScan(
        timestamp=timestamp,
        frame_id=frame_id,
        pose=_message(Pose3()),
        start_angle=scan.angle_min_rad,
        end_angle=last_rad,
        ranges=ranges,
    )
