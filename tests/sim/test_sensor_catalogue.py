"""The catalogue of simulated sensors, and a sensor that comes from outside."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from importlib import import_module

import pytest

from trailmark.errors import ConfigError
from trailmark.frames import Scalar, SensorInfo
from trailmark.geometry import Pose2
from trailmark_sim.describe import world_rows
from trailmark_sim.sensors import catalogue
from trailmark_sim.sensors.site import SensorSite
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds import WORLDS, build_world, world_module
from trailmark_sim.worlds.base import WorldOptions


@dataclass(frozen=True)
class Beacon:
    """A range to a beacon at the origin: all that a sensor from outside needs."""

    name: str
    rate_hz: float
    info: SensorInfo = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "info", SensorInfo(self.name, "scalar", None, self.rate_hz))

    def render(self, k: int, stamp_s: float, state: VehicleState) -> Scalar:
        return Scalar(math.hypot(state.pose_map_base.x, state.pose_map_base.y))


def build_beacon(name: str, site: SensorSite) -> Beacon:
    return Beacon(name, site.rate_hz(name, 5.0))


@pytest.fixture
def beacon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalogue, "SENSORS", dict(catalogue.SENSORS))
    monkeypatch.setattr(catalogue, "_EVERYWHERE", list(catalogue._EVERYWHERE))
    catalogue.add_sensor("beacon", build_beacon)


@pytest.mark.usefixtures("beacon")
class TestFromOutside:
    @pytest.mark.parametrize("world", sorted(WORLDS))
    def test_every_world_has_it(self, world: str) -> None:
        options = WorldOptions(sensors=("beacon", "wheels"), rates_hz={"beacon": 8.0})

        sensors = build_world(world, options).sensors

        assert [sensor.info.name for sensor in sensors] == ["wheels", "beacon"]
        assert sensors[1].rate_hz == 8.0
        assert sensors[1].render(0, 0.0, VehicleState(Pose2(3.0, 4.0))).value == 5.0

    def test_it_is_listed(self) -> None:
        assert all("beacon" in row["sensors"] for row in world_rows())

    def test_a_second_one_of_the_name_is_refused_and_the_same_one_is_not(self) -> None:
        catalogue.add_sensor("beacon", build_beacon)

        with pytest.raises(ConfigError, match="a sensor named 'beacon' already"):
            catalogue.add_sensor("beacon", lambda name, site: Beacon(name, 1.0))

    def test_one_that_needs_walls_is_refused_where_there_are_none(self) -> None:
        catalogue.add_sensor("sonar", lambda name, site: site.stage_for(name))

        with pytest.raises(ConfigError, match=r"'sonar' needs walls .* world 'ground_course' has only a floor"):
            build_world("ground_course", WorldOptions(sensors=("sonar",)))


def test_every_entry_can_be_imported_and_every_world_lists_sensors_of_the_catalogue() -> None:
    for entry in catalogue.SENSORS.values():
        module, _, function = str(entry).partition(":")
        assert callable(getattr(import_module(module), function))
    listed = {name for world in WORLDS for name in catalogue.names_in(world_module(world).SENSORS)}
    assert listed == set(catalogue.SENSORS)


def test_the_usual_sensors_of_every_world_come_first() -> None:
    assert {row["sensors"][:3] == ["wheels", "imu", "light"] for row in world_rows()} == {True}


def test_a_sensor_that_the_world_does_not_have_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match="world 'lab' has no sensor named 'front'"):
        build_world("lab", WorldOptions(sensors=("front",)))
