"""Faults of sensors on purpose: frames of any source, worse than they came.

Every frame draws its numbers from (seed, source, sensor, index) alone: adding a fault to one sensor changes no other,
and twice the noise is the same noise, twice as strong.
"""

from __future__ import annotations

import heapq
import math
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.config.perturbation import Occluders, Perturbation, WrongCalibration
from trailmark.errors import ConfigError
from trailmark.frames import RGBD, DepthCamera, Frame, GroundPlane, Image, Payload, Pinhole, Scan, SensorInfo
from trailmark.geometry import Pose3
from trailmark.pipeline.counters import Counters

__all__ = ["Perturber", "misjudged"]

# Marks the branch of a source's seed from which its faults are drawn, so that its own draws stay as they are.
_BRANCH = zlib.crc32(b"perturb")

Pixels = npt.NDArray[Any]


class Perturber:
    """Applies the faults of one source.

    Parameters
    ----------
    source : str
        Its name.
    faults : Perturbation
        What is wrong.
    sensors : mapping of str to SensorInfo
        Its sensors, as they are called in the run.
    rng : numpy.random.Generator
        The source's; nothing is drawn from it.
    counters : Counters
        Takes ``source.NAME.perturb.dropped``, ``.missing`` and ``.late``.

    Raises
    ------
    ConfigError
        If the faults name a sensor that the source does not have.
    """

    def __init__(
        self,
        source: str,
        faults: Perturbation,
        sensors: Mapping[str, SensorInfo],
        rng: np.random.Generator,
        counters: Counters,
    ) -> None:
        for name in faults.sensors or ():
            if name not in sensors:
                raise ConfigError(
                    f"sources.{source}.perturb.sensors: the source has no sensor {name!r}; it has {', '.join(sensors)}"
                )
        self._source = source
        self._faults = faults
        self._sensors = frozenset(sensors if faults.sensors is None else faults.sensors)
        self._seeds: Any = rng.bit_generator.seed_seq
        self._counters = counters
        self._index: dict[str, int] = {}
        self._is_dropping: dict[str, bool] = {}
        self._first_s: float | None = None
        self._occluding: dict[str, list[_Occluder]] = {}

    def frames(self, frames: Iterator[Frame]) -> Iterator[Frame]:
        """Yield the frames that are left, in the order of their stamps."""
        waiting: list[tuple[float, int, Frame]] = []
        order = count()
        for frame in frames:
            while waiting and waiting[0][0] <= frame.stamp_s:
                yield heapq.heappop(waiting)[2]
            if frame.sensor not in self._sensors:
                yield frame
                continue
            kept = self._one(frame)
            if kept is None:
                continue
            if self._faults.late_s:
                self._count("late")
                late = Frame(kept.sensor, kept.stamp_s + self._faults.late_s, kept.payload)
                heapq.heappush(waiting, (late.stamp_s, next(order), late))
            else:
                yield kept
        while waiting:
            yield heapq.heappop(waiting)[2]

    def _one(self, frame: Frame) -> Frame | None:
        """Return a frame with its faults; None where it is lost."""
        self._first_s = frame.stamp_s if self._first_s is None else self._first_s
        since_s = frame.stamp_s - self._first_s
        index = self._index.get(frame.sensor, 0)
        self._index[frame.sensor] = index + 1
        rng = self._rng(frame.sensor, index)
        if self._drops(frame.sensor, rng):
            self._count("dropped")
            return None
        missing = self._faults.missing_s
        if missing is not None and missing[0] <= since_s < missing[1]:
            self._count("missing")
            return None
        payload = self._payload(frame.sensor, frame.payload, rng, since_s)
        return frame if payload is frame.payload else Frame(frame.sensor, frame.stamp_s, payload)

    def _rng(self, sensor: str, index: int) -> np.random.Generator:
        key = (*self._seeds.spawn_key, _BRANCH, zlib.crc32(sensor.encode()), index)
        return np.random.default_rng(np.random.SeedSequence(self._seeds.entropy, spawn_key=key))

    def _drops(self, sensor: str, rng: np.random.Generator) -> bool:
        """Each frame by itself, or in runs: then two states, left with the chances that give share and length."""
        share, run = self._faults.dropped, self._faults.dropped_in_a_row
        chance = rng.random()  # drawn in any case: the noise of a frame does not depend on what is dropped
        if run is None or not share:
            return bool(chance < share)
        was = self._is_dropping.get(sensor, False)
        self._is_dropping[sensor] = bool(chance >= 1.0 / run if was else chance < share / (run * (1.0 - share)))
        return self._is_dropping[sensor]

    def _payload(self, sensor: str, payload: Payload, rng: np.random.Generator, since_s: float) -> Payload:
        match payload:
            case Image(pixels=pixels):
                worse = self._picture(sensor, pixels, rng, since_s)
                return payload if worse is pixels else Image(worse)
            case RGBD(bgr=bgr, depth_m=depth_m):
                return self._rgbd(sensor, payload, bgr, depth_m, rng, since_s)
            case Scan():
                return self._scan(payload, rng)
        return payload

    # --- pictures ------------------------------------------------------------------------------------------------

    def _picture(self, sensor: str, pixels: Pixels, rng: np.random.Generator, since_s: float) -> Pixels:
        faults = self._faults
        white = 65535.0 if pixels.dtype == np.uint16 else 255.0
        worse = pixels
        if faults.blur_px:
            import cv2

            worse = cv2.GaussianBlur(worse, (0, 0), faults.blur_px)
        if faults.occluders is not None:
            worse = worse.copy()
            for occluder in self._occluders(sensor, faults.occluders):
                worse[occluder.window(worse.shape, since_s)] = round(occluder.grey * white)
        gain = faults.exposure * math.exp(faults.flicker * rng.standard_normal())
        if gain != 1.0 or faults.noise:
            level = worse.astype(np.float32) * np.float32(gain)
            if faults.noise:
                level += rng.standard_normal(worse.shape, dtype=np.float32) * np.float32(faults.noise * white / 255.0)
            worse = np.clip(np.rint(level), 0.0, white).astype(pixels.dtype)
        if faults.speckle:
            worse = worse.copy() if worse is pixels else worse
            chance = rng.random(worse.shape[:2], dtype=np.float32)
            worse[chance < faults.speckle / 2] = 0
            worse[chance > 1.0 - faults.speckle / 2] = round(white)
        return worse

    def _occluders(self, sensor: str, asked: Occluders) -> list[_Occluder]:
        if sensor not in self._occluding:
            key = (*self._seeds.spawn_key, _BRANCH, zlib.crc32(sensor.encode()))
            rng = np.random.default_rng(np.random.SeedSequence(self._seeds.entropy, spawn_key=key))
            self._occluding[sensor] = [_Occluder(rng, asked) for _ in range(asked.n)]
        return self._occluding[sensor]

    def _rgbd(
        self,
        sensor: str,
        payload: RGBD,
        bgr: npt.NDArray[np.uint8],
        depth_m: npt.NDArray[np.float32],
        rng: np.random.Generator,
        since_s: float,
    ) -> RGBD:
        colour = self._picture(sensor, bgr, rng, since_s)
        depth = depth_m
        if self._faults.range_noise_m:
            noise = rng.standard_normal(depth.shape, dtype=np.float32) * np.float32(self._faults.range_noise_m)
            depth = np.where(depth + noise > 0, depth + noise, np.float32(np.nan))
        if self._faults.occluders is not None:
            depth = depth.copy()
            for occluder in self._occluders(sensor, self._faults.occluders):
                depth[occluder.window(depth.shape, since_s)] = np.nan  # too near to be measured
        return payload if colour is bgr and depth is depth_m else RGBD(colour, depth)

    # --- lasers --------------------------------------------------------------------------------------------------

    def _scan(self, scan: Scan, rng: np.random.Generator) -> Scan:
        faults = self._faults
        if not (faults.range_noise_m or faults.speckle):
            return scan
        ranges = np.array(scan.ranges_m)
        ranges += (faults.range_noise_m * rng.standard_normal(len(ranges))).astype(ranges.dtype)
        if faults.speckle:
            known = ranges[np.isfinite(ranges)]
            far_m = scan.range_max_m if math.isfinite(scan.range_max_m) else float(known.max(initial=1.0))
            stray = rng.random(len(ranges)) < faults.speckle
            ranges[stray] = rng.uniform(scan.range_min_m, far_m, int(stray.sum()))
        return replace(scan, ranges_m=np.where(ranges < scan.range_min_m, np.nan, ranges).astype(ranges.dtype))

    def _count(self, what: str) -> None:
        self._counters.add(f"source.{self._source}.perturb.{what}")


class _Occluder:
    """A square of one grey that crosses the picture again and again, straight on."""

    def __init__(self, rng: np.random.Generator, asked: Occluders) -> None:
        self.grey = float(rng.random())
        self._at = rng.random(2)
        direction = rng.uniform(0.0, 2.0 * math.pi)
        self._speed = asked.speed * np.array([math.cos(direction), math.sin(direction)])
        self._size = asked.size

    def window(self, shape: tuple[int, ...], since_s: float) -> tuple[slice, slice]:
        """Return the rows and columns that it covers now."""
        height, width = shape[:2]
        side = max(1, round(self._size * min(height, width)))
        reach = np.array([width + side, height + side])
        u, v = ((self._at + self._speed * since_s) % 1.0 * reach - side).astype(int).tolist()
        return slice(max(v, 0), max(v + side, 0)), slice(max(u, 0), max(u + side, 0))


def misjudged(info: SensorInfo, wrong: WrongCalibration) -> SensorInfo:
    """Return a sensor as it is wrongly believed to be."""
    offset = Pose3(wrong.x_m, wrong.y_m, 0.0, 0.0, math.radians(wrong.pitch_deg), math.radians(wrong.yaw_deg))
    mounted = info.pose_base_sensor
    turned = Pose3(0.0, 0.0, 0.0, mounted.roll, mounted.pitch, mounted.yaw) @ replace(offset, x=0.0, y=0.0)
    pose = Pose3(mounted.x + offset.x, mounted.y + offset.y, mounted.z, turned.roll, turned.pitch, turned.yaw)
    return replace(info, pose_base_sensor=pose, calibration=_scaled(info.calibration, wrong.scale))


def _scaled(calibration: Any, scale: float) -> Any:
    if scale == 1.0:
        return calibration
    match calibration:
        case GroundPlane(metres_per_pixel=(along_u, along_v)):
            return replace(calibration, metres_per_pixel=(scale * along_u, scale * along_v))
        case Pinhole():
            return replace(calibration, fx=scale * calibration.fx, fy=scale * calibration.fy)
        case DepthCamera():
            depth = None if calibration.depth is None else _scaled(calibration.depth, scale)
            return replace(calibration, colour=_scaled(calibration.colour, scale), depth=depth)
    return calibration
