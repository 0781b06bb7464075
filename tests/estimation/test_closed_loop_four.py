"""All four methods lead one robot, put down 30 mm off, back to a short way that it was taught."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import trailmark
from trailmark.evaluation import collisions_of
from trailmark.geometry import Trajectory

RATES_HZ = {"floor": 15, "omni": 4, "rgbd": 2, "front": 4, "wheels": 20}


@pytest.fixture(scope="module")
def closed_loop(load_script: Callable[[str], ModuleType]) -> ModuleType:
    return load_script("benchmarks/closed_loop_four.py")


@pytest.fixture(scope="module")
def configured(closed_loop: ModuleType) -> Callable[..., dict[str, Any]]:
    def config_of(methods: Sequence[str], place: str, duration_s: float) -> dict[str, Any]:
        config: dict[str, Any] = closed_loop.config_of(methods, place)
        robot = config["sources"]["robot"]
        rates_hz = {sensor: rate_hz for sensor, rate_hz in RATES_HZ.items() if sensor in robot["sensors"]}
        config["sources"]["robot"] = robot | {"rates_hz": rates_hz, "duration_s": duration_s, "threads": 1}
        return config

    return config_of


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "taught_s"), [("supermarket:1", 3.0), pytest.param("street:1", 6.0, marks=pytest.mark.long)]
)
def test_all_four_lead_the_robot_back_to_its_way(
    place: str, taught_s: float, closed_loop: ModuleType, configured: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    store = tmp_path / "place.trail"
    teaching = configured(closed_loop.FOUR, place, taught_s) | {"start": [0.0, 0.0, 0.0], "seed": 100}
    way = trailmark.run(teaching, mode="teach", store=store, report=False).ground_truth

    led = trailmark.run(configured(closed_loop.FOUR, place, 12.0), mode="replay", store=store, report=False)
    blind = trailmark.run(configured((), place, 12.0), mode="replay", store=store, report=False)

    spoke = {name.split(".")[1] for name, n in led.counters.items() if name.endswith(".accepted") and n > 0}
    assert spoke == {"wheels", "floor", "floor_map", "omni", "kinect", "streams"}
    assert led.reason == closed_loop.ARRIVED
    assert collisions_of(led.counters) == 0
    assert way is not None
    ends_mm = [_last_off_mm(closed_loop, way, drive.ground_truth) for drive in (led, blind)]
    assert ends_mm[0] < 8.0
    assert ends_mm[1] > 20.0  # by its wheels alone it goes on where it was put down


def _last_off_mm(closed_loop: ModuleType, way: Trajectory, driven: Trajectory | None) -> float:
    """Return how far off the way the last fifth of a drive was, on average."""
    assert driven is not None
    off: np.ndarray = closed_loop.off_mm(way, driven)
    return float(off[-len(off) // 5 :].mean())
