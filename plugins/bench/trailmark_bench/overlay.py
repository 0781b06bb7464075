"""Laying pieces of a config over another."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

from trailmark.config.document import expand_shorthand

__all__ = ["overlaid"]


def overlaid(base: Mapping[str, Any], piece: Mapping[str, Any]) -> dict[str, Any]:
    """Return a config with a piece of one laid over it: mappings key by key, all else replaced.

    A part that names another plugin replaces the part below it, and takes nothing over from it.
    """
    below, above = deepcopy(dict(base)), deepcopy(dict(piece))
    expand_shorthand(below)
    expand_shorthand(above)
    return _overlay(below, above)


def _overlay(below: dict[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    if "plugin" in above and below.get("plugin", above["plugin"]) != above["plugin"]:
        return dict(above)
    result = dict(below)
    for key, value in above.items():
        under = below.get(key)
        both = isinstance(under, dict) and isinstance(value, Mapping)
        result[key] = _overlay(under, value) if both and isinstance(under, dict) else value
    return result
