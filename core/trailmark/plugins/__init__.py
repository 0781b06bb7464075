"""Plugins: how parts are found, registered and, when something is wrong with one, explained."""

from trailmark.plugins.candidates import PluginRecord, Selection
from trailmark.plugins.hookspecs import HookSpecs
from trailmark.plugins.loader import ENTRY_POINT_GROUP, Plugins, discover_plugins, load_plugins
from trailmark.plugins.registry import Registry
from trailmark.plugins.spec import KINDS, Kind, Spec

__all__ = [
    "ENTRY_POINT_GROUP",
    "KINDS",
    "HookSpecs",
    "Kind",
    "PluginRecord",
    "Plugins",
    "Registry",
    "Selection",
    "Spec",
    "discover_plugins",
    "load_plugins",
]
