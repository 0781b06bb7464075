"""All simulated sensors by name. A new one is a file with a builder, and an entry here or a call of `add_sensor`.

A builder takes the name of the sensor and the `SensorSite` of a world, and returns a `SensorModel`. Worlds list the
names of those that only they have; imports nothing heavy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

from trailmark.errors import ConfigError
from trailmark_sim.names import unknown_name

if TYPE_CHECKING:
    from trailmark_sim.sensors.site import SensorModel, SensorSite

__all__ = ["SENSORS", "SensorBuilder", "add_sensor", "build_sensors", "names_in"]

SensorBuilder = Callable[[str, Any], Any]

#: Name to builder, or to ``"module:function"`` of one that is imported when it is asked for.
SENSORS: dict[str, str | SensorBuilder] = {
    "wheels": "trailmark_sim.sensors.odometry:build",
    "imu": "trailmark_sim.sensors.imu:build",
    "light": "trailmark_sim.sensors.light:build",
    "floor": "trailmark_sim.sensors.floor:build",
    "laser": "trailmark_sim.sensors.laser:build",
    "front": "trailmark_sim.sensors.camera:build",
    "front_depth": "trailmark_sim.sensors.true_depth:build",
    "omni": "trailmark_sim.sensors.camera:build",
    "rgbd": "trailmark_sim.sensors.rgbd:build",
}
#: What every vehicle carries, whatever the world; the others are listed by the worlds that have them.
_EVERYWHERE = ["wheels", "imu", "light"]


def add_sensor(name: str, builder: SensorBuilder) -> None:
    """Add a sensor from outside; every world then has it. The builder refuses a world that lacks what it needs.

    Raises
    ------
    ConfigError
        If there is another sensor of that name.
    """
    if SENSORS.setdefault(name, builder) is not builder:
        raise ConfigError(f"sim: there is a sensor named {name!r} already")
    if name not in _EVERYWHERE:
        _EVERYWHERE.append(name)


def names_in(own: Iterable[str]) -> tuple[str, ...]:
    """Return the sensors of a world that has some of its own, in the order in which their frames come."""
    return tuple(dict.fromkeys((*_EVERYWHERE, *own)))


def build_sensors(site: SensorSite, own: Sequence[str], default: Sequence[str]) -> tuple[SensorModel, ...]:
    """Build the sensors that the config asks for, or the default ones, and no other.

    Raises
    ------
    ConfigError
        If the config names a sensor that the world does not have.
    """
    known, options = names_in(own), site.options
    wanted = default if options.sensors is None else options.sensors
    for name in (*wanted, *options.rates_hz):
        if name not in known:
            raise ConfigError(f"sim: world {site.world!r} has {unknown_name('sensor', name, known)}")
    return tuple(_builder(SENSORS[name])(name, site) for name in known if name in wanted)


def _builder(entry: str | SensorBuilder) -> SensorBuilder:
    if not isinstance(entry, str):
        return entry
    module, _, function = entry.partition(":")
    builder: SensorBuilder = getattr(import_module(module), function)
    return builder
