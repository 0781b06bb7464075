"""A one-file plugin: frames that were rendered once, played from memory, forth and back as often as wanted.

Driving the same frames backwards is driving the way backwards, so a recording of any way becomes a loop without a jump,
and playing it costs nothing: neither rendering nor decoding.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from pydantic import Field

from trailmark import Pipeline, hookimpl
from trailmark.config import SourceConfig, load_run_config
from trailmark.frames import Frame, SensorInfo
from trailmark.interfaces import FrameSource
from trailmark.plugins import Plugins, load_plugins

MARKET = {"plugin": "sim", "world": "supermarket", "route": "round", "driver": "route", "threads": 1}


@dataclass(frozen=True)
class Kept:
    """Frames of all sensors in the order of their stamps."""

    frames: Sequence[Frame]
    sensors: Mapping[str, SensorInfo]


#: Set by the program that plays them; the plugin is a module of its own.
KEPT: list[Kept] = []


class RememberedConfig(SourceConfig):
    """Plays what is kept."""

    duration_s: float = Field(gt=0)
    """Simulated time; longer than the frames: forth, back, forth ... [s]"""


class Remembered(FrameSource):
    """Plays frames from memory."""

    config: RememberedConfig

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """Those of the frames."""
        return KEPT[-1].sensors

    def frames(self) -> Iterator[Frame]:
        """Yield the frames forth and back, with stamps that go on."""
        kept = KEPT[-1].frames
        first_s, last_s = kept[0].stamp_s, kept[-1].stamp_s
        lap_s = last_s - first_s
        lap = 0
        while True:
            for frame in kept if lap % 2 == 0 else reversed(kept):
                into_s = frame.stamp_s - first_s if lap % 2 == 0 else last_s - frame.stamp_s
                # a thousandth between laps: the last frame is played twice
                stamp_s = lap * (lap_s + 1e-3) + into_s
                if stamp_s > self.config.duration_s:
                    return
                yield Frame(frame.sensor, first_s + stamp_s, frame.payload)
            lap += 1


@hookimpl
def trailmark_register(registry: Any) -> None:
    """Register the source."""
    registry.source("remembered", ":Remembered", config=":RememberedConfig", summary="Frames from memory")


def keep(config: Mapping[str, Any]) -> tuple[Kept, Plugins]:
    """Render the sources of a config; return the frames, and plugins of which one plays them."""
    plugins = load_plugins(files=[__file__])
    loaded = load_run_config(config, plugins=plugins)
    settings = loaded.settings.model_copy(update={"mode": "track", "start": "unknown"})
    alone = replace(loaded, settings=settings, localizers={}, controller=None, sinks=(), path_store=None)
    with Pipeline(alone) as pipeline:
        frames = [step.frame for step in pipeline if step.frame is not None]
        kept = Kept(frames, dict(pipeline.sensors))
    from sys import modules

    modules["trailmark_file_remembered"].KEPT.append(kept)
    return kept, plugins
