"""Parts without a life of their own, so that configs can be tried without any plugin."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import pluggy
import pytest
from pydantic import Field

from trailmark.commands import Command, Stop
from trailmark.config import ConfigPath, ExistingPath, PluginConfig, Sensor, SourceConfig
from trailmark.estimates import Applied, Belief, Estimate
from trailmark.frames import Frame, SensorInfo
from trailmark.interfaces import Controller, Estimator, FrameSource, Localizer, LocalizerMap, PathStore, Sink
from trailmark.paths import Path as TaughtPath
from trailmark.paths import Waypoint
from trailmark.plugins import PluginRecord, Plugins, Registry
from trailmark.plugins.registry import Owner


class FolderConfig(SourceConfig):
    path: ExistingPath
    """Folder of the images."""
    rate_hz: float = Field(gt=0)
    """Images a second [Hz]."""


class GroundConfig(PluginConfig):
    camera: Sensor["image"]
    """The downward camera."""
    light: Sensor["scalar"] | None = None
    search_px: int = Field(8, gt=0, le=64)
    """Search range [px]."""
    method: str = "sad"


class KltConfig(PluginConfig):
    camera: Sensor["image", "rgbd"]
    window_px: int = Field(21, gt=0)
    gains: dict[str, float] = Field(default_factory=dict)


class StereoConfig(PluginConfig):
    left: Sensor["image"]
    right: Sensor["image"]


class AnyConfig(PluginConfig):
    sensor: Sensor[()]


class StoreConfig(PluginConfig):
    path: ConfigPath | None = None


class TrackConfig(PluginConfig):
    reverse: bool = False


class LinesConfig(PluginConfig):
    to: str = "stdout"


class Folder(FrameSource):
    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        return {}

    def frames(self) -> Iterator[Frame]:
        return iter(())


class Silent(Localizer):
    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        return ()


class Unmoved(Estimator):
    def apply(self, source: str, estimate: Estimate) -> Applied:
        return Applied("unused")

    def belief(self, stamp_s: float | None = None) -> Belief:
        return Belief(stamp_s or 0.0)


class Nowhere(PathStore):
    def append(self, waypoint: Waypoint) -> None: ...

    def path(self) -> TaughtPath | None:
        return None

    def localizer_map(self, owner: str) -> LocalizerMap:
        raise NotImplementedError

    def commit(self) -> None: ...


class Standing(Controller):
    @property
    def gives(self) -> frozenset[type[Command]]:
        return frozenset({Stop})

    def step(self, belief: Belief) -> Command:
        return Stop("always")


def small_registry() -> Registry:
    registry = Registry(Owner("small", "tm-small", "1.0", __name__))
    registry.source("image_folder", Folder, FolderConfig, summary="A folder of images")
    registry.localizer("ground_vo", Silent, GroundConfig, summary="Downward camera", gives=["motion"])
    registry.localizer("ground_map", Silent, GroundConfig, gives=["fix"])
    registry.localizer("klt", Silent, KltConfig, gives=["motion"])
    registry.localizer("stereo", Silent, StereoConfig)
    registry.localizer("any", Silent, AnyConfig)
    registry.localizer("broken", "not_there_at_all:Localizer", KltConfig)
    registry.localizer("wrong_kind", Unmoved)
    registry.localizer("twin", Silent, KltConfig)
    registry.estimator("kalman", Unmoved)
    registry.controller("track", Standing, TrackConfig)
    registry.controller("stand", Standing)
    registry.sink("jsonl", Sink, LinesConfig)
    return registry


@pytest.fixture(scope="session")
def plugins() -> Plugins:
    """Plugins as a process would have them: core, two that loaded, one that did not."""
    core = Registry(Owner("core", "trailmark", "1.0", __name__))
    core.estimator("dead_reckoning", Unmoved)
    core.path_store("sqlite", Nowhere, StoreConfig)
    other = Registry(Owner("other", "tm-other", "2.0", __name__))
    other.localizer("twin", Silent, GroundConfig)
    small = PluginRecord("small", "tm-small", "1.0", __name__, "ok", specs=small_registry().specs())
    spoilt = PluginRecord("spoilt", "tm-spoilt", "0.3", "spoilt", "failed", "ImportError: no", "Traceback")
    first = PluginRecord("core", "trailmark", "1.0", __name__, "ok", specs=core.specs())
    second = PluginRecord("other", "tm-other", "2.0", __name__, "ok", specs=other.specs())
    manager = pluggy.PluginManager("trailmark")
    manager.register(small_registry, "tm-small:small")
    manager.register(other, "tm-other:other")
    manager.register(core, "trailmark:core")
    return Plugins(manager, [first, small, second, spoilt])


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """Write a config into an empty working folder that holds ``frames/``; return its name."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "frames").mkdir()

    def write_text(text: str, name: str = "config.yaml") -> str:
        (tmp_path / name).write_text(text)
        return name

    return write_text
