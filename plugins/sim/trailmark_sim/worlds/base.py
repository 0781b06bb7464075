"""What a simulated world is made of: the contract between worlds, sensors, vehicles and the source.

A world is a module under ``trailmark_sim.worlds`` with

- ``build(options: WorldOptions) -> World``, named in `trailmark_sim.worlds.WORLDS`;
- ``ROUTES``, a tuple of the names it knows, and ``SENSORS``, those of `trailmark_sim.sensors.catalogue` that it has
  beside those of every world, so that they can be listed without building it;
- if it has options, a light module with their model, named in `trailmark_sim.worlds.OPTIONS`: they are then
  checked, and their files found, when the config is read;
- a docstring whose first line says what it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, TypeVar

from pydantic import ValidationError

from trailmark.arrays import Floats
from trailmark.config import PluginConfig
from trailmark.errors import ConfigError
from trailmark.geometry import Pose2
from trailmark.interfaces import Mode
from trailmark.plugins.hints import did_you_mean
from trailmark_sim.names import unknown_name
from trailmark_sim.routes import Route
from trailmark_sim.sensors.site import SensorModel
from trailmark_sim.vehicles import Vehicle

__all__ = ["SensorModel", "World", "WorldOptions", "choose_route", "parse_options"]


@dataclass(frozen=True, slots=True, eq=False)
class WorldOptions:
    """What the config says of the world that is to be built.

    Attributes
    ----------
    seed : int
        Of everything that differs from run to run: sensor noise, slip, people.
    world_seed : int
        Of everything that stays: textures, floors, where things stand.
    mode : {"track", "teach", "replay"}
        Some worlds change between teaching and coming back.
    sensors : tuple of str or None
        Sensors to build; None: the world's default set.
    rates_hz : mapping of str to float
        Rates that differ from the world's, by sensor [Hz].
    route : str or None
        The route that will be driven; None: the world's first.
    threads : int
        Threads that may render; no byte depends on it.
    vehicle : Vehicle or None
        A vehicle other than the world's own.
    extra : mapping
        The world's own options, to be read with `parse_options`.
    """

    seed: int = 0
    world_seed: int = 1
    mode: Mode = "track"
    sensors: tuple[str, ...] | None = None
    rates_hz: Mapping[str, float] = field(default_factory=dict)
    route: str | None = None
    threads: int = 1
    vehicle: Vehicle | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)

    def rate_of(self, sensor: str, default_hz: float) -> float:
        """Return the rate of a sensor: the config's, or the default [Hz]."""
        return float(self.rates_hz.get(sensor, default_hz))


def _nowhere(pose: Pose2) -> str | None:
    return None


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """A simulated world, ready to be driven in.

    Attributes
    ----------
    name : str
        As in `trailmark_sim.worlds.WORLDS`.
    vehicle : Vehicle
        What drives in it.
    sensors : tuple of SensorModel
        Of the chosen sensors; at equal stamps their frames come in this order.
    routes : mapping of str to Route
        Ways to drive, by name; the first is the default.
    start : Pose2
        Where the vehicle stands when nothing else is said.
    collides : callable
        Takes the pose of the vehicle and returns what it touches there, or None.
    truth : mapping of str to array
        What else is known exactly: poles, landmarks. For evaluation and drawing.
    around : tuple of (N, 2) float64
        Lines of what stands there, for drawing [m].
    area : (float, float, float, float) or None
        West, east, south and north end of where a vehicle may be put down; None: beside the route [m].
    slow_kernel : callable or None
        The kernel whose sensors compile for seconds, if there is one: where it is not kept on disk yet, they are
        compiled in a process beside this one.
    """

    name: str
    vehicle: Vehicle
    sensors: tuple[SensorModel, ...]
    routes: Mapping[str, Route]
    start: Pose2
    collides: Callable[[Pose2], str | None] = _nowhere
    truth: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    around: tuple[Floats, ...] = ()
    area: tuple[float, float, float, float] | None = None
    slow_kernel: Callable[..., None] | None = None


def choose_route(world: str, options: WorldOptions, routes: Sequence[str]) -> str:
    """Return the name of the route that will be driven: the config's, or the first.

    Raises
    ------
    ConfigError
        If the world has no such route.
    """
    name = options.route or routes[0]
    if name not in routes:
        raise ConfigError(f"sim: world {world!r} has {unknown_name('route', name, routes)}")
    return name


Options = TypeVar("Options", bound=PluginConfig)


def parse_options(model: type[Options], world: str, extra: Mapping[str, Any]) -> Options:
    """Return a world's own options as its model.

    Raises
    ------
    ConfigError
        With one line per wrong key or value.
    """
    try:
        return model.model_validate(dict(extra))
    except ValidationError as error:
        raise ConfigError("\n".join(_lines(model, world, error))) from None


def _lines(model: type[PluginConfig], world: str, error: ValidationError) -> list[str]:
    lines = []
    for item in error.errors():
        where = ".".join(str(part) for part in item["loc"])
        if item["type"] == "extra_forbidden":
            known = model.model_fields if len(item["loc"]) == 1 else ()
            lines.append(f"sim: world {world!r} has no option {where!r}{did_you_mean(str(item['loc'][-1]), known)}")
        else:
            lines.append(f"sim: option {where!r} of world {world!r}: {item['msg']}, not {item['input']!r}")
    return lines
