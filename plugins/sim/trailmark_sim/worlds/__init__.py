"""The worlds of the simulator, by name; a world is imported when it is asked for."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

from trailmark.errors import ConfigError
from trailmark_sim.names import unknown_name

if TYPE_CHECKING:
    from trailmark_sim.worlds.base import World, WorldOptions

__all__ = ["WORLDS", "build_world", "world_module"]

#: Name to ``"module:function"``; the function takes `WorldOptions` and returns a `World`.
WORLDS: dict[str, str] = {
    "ground_course": "trailmark_sim.worlds.ground_course:build",
}


def world_module(name: str) -> ModuleType:
    """Import the module of a world.

    Raises
    ------
    ConfigError
        If there is no world of that name.
    """
    if name not in WORLDS:
        raise ConfigError(f"sim: {unknown_name('world', name, WORLDS)}")
    return import_module(WORLDS[name].partition(":")[0])


def build_world(name: str, options: WorldOptions) -> World:
    """Build a world.

    Raises
    ------
    ConfigError
        If there is no world of that name, or an option of it is wrong.
    """
    world: World = getattr(world_module(name), WORLDS[name].partition(":")[2])(options)
    return world
