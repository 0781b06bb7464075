"""Frames to worsen, and the chain of faults that a config names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trailmark.frames import Frame, Image, SensorInfo, payload_kind
from trailmark.interfaces import Session
from trailmark.pipeline.lifecycle import part_rng
from trailmark.pipeline.sources.perturbing import Perturber
from trailmark.plugins import load_plugins

REGISTRY = load_plugins().registry
GREY = np.full((60, 80), 100, np.uint8)


def pictures(n: int, pixels: Any = GREY, sensor: str = "floor", rate_hz: float = 10.0) -> list[Frame]:
    return [Frame(sensor, i / rate_hz, Image(pixels)) for i in range(n)]


def chain(faults: Mapping[str, Mapping[str, Any]], sensors: Sequence[str] | None = None) -> Perturber:
    """Return faults by name, with their keys, as ``perturb`` of a source called robot makes them."""
    makers = {}
    for name, keys in faults.items():
        spec = REGISTRY.find("fault", name)
        makers[name] = partial(spec.load(), spec.load_config().model_validate(dict(keys)))
    return Perturber("robot", makers, sensors)


def start(perturber: Perturber, sensors: Mapping[str, SensorInfo], seed: int = 0) -> None:
    perturber.start(Session(rng=part_rng(seed, "source", "robot")), sensors)


def worsened(
    frames: Sequence[Frame],
    faults: Mapping[str, Mapping[str, Any]],
    sensors: Sequence[str] | None = None,
    seed: int = 0,
) -> list[Frame]:
    """Return the frames as the faults leave them."""
    perturber = chain(faults, sensors)
    start(perturber, {f.sensor: SensorInfo(f.sensor, payload_kind(f.payload)) for f in frames}, seed)
    return list(perturber.frames(iter(frames)))


@pytest.fixture(scope="session")
def faulty() -> SimpleNamespace:
    """The helpers of this room."""
    return SimpleNamespace(GREY=GREY, pictures=pictures, chain=chain, start=start, worsened=worsened)


@pytest.fixture(scope="session")
def floor() -> Any:
    """A textured floor, (240, 320) uint8, of mean 110 and standard deviation 25."""
    import cv2

    rough = np.random.default_rng(7).standard_normal((240, 320)).astype(np.float32)
    smooth = cv2.GaussianBlur(rough, (0, 0), 2.0)
    return np.clip(110.0 + 25.0 * smooth / smooth.std(), 0, 255).astype(np.uint8)
