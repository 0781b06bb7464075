"""Pairs of a colour and a depth picture, from one sensor that gives both or from two recordings."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.errors import ConfigError
from trailmark.frames import RGBD, Frame, Image, SensorInfo
from trailmark.interfaces import Session
from trailmark.pipeline import SourceStream

__all__ = ["PictureSensors", "choose_sensors", "pairs", "start_sources"]

Pair = tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32]]

_MOST_APART_S = 0.04


@dataclass(frozen=True, slots=True)
class PictureSensors:
    """Which sensors give the pictures.

    Attributes
    ----------
    colour : str
        The colour and depth camera, or the colour camera alone.
    depth : str or None
        The depth camera, where it is a sensor of its own with 16-bit pictures.
    """

    colour: str
    depth: str | None = None


def choose_sensors(sensors: Mapping[str, SensorInfo], colour: str | None, depth: str | None) -> PictureSensors:
    """Return the sensors that are named, or the only one that gives colour and depth.

    Raises
    ------
    ConfigError
        If there is no such sensor, or it is not clear which.
    """
    for name in (colour, depth):
        if name is not None and name not in sensors:
            raise ConfigError(f"no sensor named {name!r}; there are {', '.join(sorted(sensors))}")
    if depth is not None:
        if colour is None:
            raise ConfigError(f"--depth {depth} needs --sensor with the colour camera beside it")
        return PictureSensors(colour, depth)
    both = [name for name, info in sensors.items() if info.kind == "rgbd" and colour in (None, name)]
    if len(both) != 1:
        what = f"gives no depth; name the depth camera with --depth: {', '.join(sorted(sensors))}"
        several = f"several give colour and depth: {', '.join(both)}; choose with --sensor"
        raise ConfigError(several if both else f"sensor {colour or next(iter(sensors), 'none')!r} {what}")
    return PictureSensors(both[0])


def pairs(sources: Sequence[SourceStream], chosen: PictureSensors, depth_factor: float, every: int) -> Iterator[Pair]:
    """Yield every n-th pair; colour and depth of two recordings belong together within 40 ms.

    Parameters
    ----------
    depth_factor : float
        Values of 16-bit depth pictures in a metre, 0 meaning unknown.
    """
    newest: dict[str, Frame] = {}
    n = 0
    for frame in heapq.merge(*(source.frames() for source in sources), key=lambda frame: frame.stamp_s):
        if frame.sensor not in (chosen.colour, chosen.depth):
            continue
        newest[frame.sensor] = frame
        found = _pair(newest, chosen, depth_factor)
        if found is None:
            continue
        newest.clear()
        if n % every == 0:
            yield found
        n += 1


def _pair(newest: Mapping[str, Frame], chosen: PictureSensors, depth_factor: float) -> Pair | None:
    colour = newest.get(chosen.colour)
    if colour is None:
        return None
    if chosen.depth is None:
        assert isinstance(colour.payload, RGBD)
        return colour.payload.bgr, colour.payload.depth_m
    depth = newest.get(chosen.depth)
    if depth is None or abs(depth.stamp_s - colour.stamp_s) > _MOST_APART_S:
        return None
    return _colour_of(colour), _depth_of(depth, depth_factor)


def _colour_of(frame: Frame) -> npt.NDArray[np.uint8]:
    pixels = frame.payload.pixels if isinstance(frame.payload, Image) else None
    if pixels is None or pixels.dtype != np.uint8:
        raise ConfigError(f"sensor {frame.sensor!r} gives no 8-bit pictures")
    return np.asarray(pixels if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, axis=2), np.uint8)


def _depth_of(frame: Frame, depth_factor: float) -> npt.NDArray[np.float32]:
    pixels = frame.payload.pixels if isinstance(frame.payload, Image) else None
    if pixels is None or pixels.dtype != np.uint16:
        raise ConfigError(f"sensor {frame.sensor!r} gives no 16-bit pictures: depth needs them")
    return np.where(pixels > 0, pixels / np.float32(depth_factor), np.float32(np.nan)).astype(np.float32)


def start_sources(sources: Sequence[SourceStream]) -> Mapping[str, SensorInfo]:
    """Start sources and return their sensors."""
    sensors: dict[str, SensorInfo] = {}
    for source in sources:
        source.start(Session(name=source.name))
        sensors |= source.sensors
    return sensors
