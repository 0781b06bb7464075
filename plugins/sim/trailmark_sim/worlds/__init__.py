"""The worlds of the simulator, by name; a world is imported when it is asked for."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

from trailmark.config import PluginConfig
from trailmark.errors import ConfigError
from trailmark_sim.names import unknown_name

if TYPE_CHECKING:
    from trailmark_sim.worlds.base import World, WorldOptions

__all__ = ["OPTIONS", "WORLDS", "build_world", "options_model", "world_module"]

#: Name to ``"module:function"``; the function takes `WorldOptions` and returns a `World`.
WORLDS: dict[str, str] = {
    "corridor": "trailmark_sim.worlds.corridor:build",
    "hallway": "trailmark_sim.worlds.hallway:build",
    "lab": "trailmark_sim.worlds.lab:build",
    "ground_course": "trailmark_sim.worlds.ground_course:build",
    "street": "trailmark_sim.worlds.street:build",
    "supermarket": "trailmark_sim.worlds.supermarket:build",
    "target": "trailmark_sim.worlds.target:build",
}

#: Name to ``"module:Model"`` of the world's own options; the module imports nothing heavy. Without: no options.
OPTIONS: dict[str, str] = {
    "corridor": "trailmark_sim.worlds.scene_options:CorridorOptions",
    "hallway": "trailmark_sim.worlds.scene_options:HallwayOptions",
    "lab": "trailmark_sim.worlds.scene_options:LabOptions",
    "ground_course": "trailmark_sim.worlds.ground_options:GroundCourseOptions",
    "street": "trailmark_sim.worlds.scene_options:StreetOptions",
    "supermarket": "trailmark_sim.worlds.scene_options:SupermarketOptions",
    "target": "trailmark_sim.worlds.scene_options:LabOptions",
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


def options_model(name: str) -> type[PluginConfig]:
    """Import the model of a world's own options: one without fields where it has none."""
    module, _, attribute = OPTIONS.get(name, "trailmark.config:PluginConfig").partition(":")
    model: type[PluginConfig] = getattr(import_module(module), attribute)
    return model


def build_world(name: str, options: WorldOptions) -> World:
    """Build a world.

    Raises
    ------
    ConfigError
        If there is no world of that name, or an option of it is wrong.
    """
    world: World = getattr(world_module(name), WORLDS[name].partition(":")[2])(options)
    return world
