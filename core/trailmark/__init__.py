"""Trailmark: localization of mobile robots with whatever sensors they have.

Importing this package is cheap: what stands behind the names below is loaded on first use.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

import pluggy

if TYPE_CHECKING:
    from trailmark.api import create, run
    from trailmark.interfaces import Session
    from trailmark.pipeline import Pipeline

__version__ = "0.2.0"

#: Version of the interfaces that plugins are written against; another major version is refused.
PLUGIN_API = "1.0"

# Read by OpenCV when it is loaded: a picture whose header announces more pixels is refused before it is decoded.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(1 << 27))

#: Marks hook implementations in plugin modules.
hookimpl = pluggy.HookimplMarker("trailmark")

__all__ = ["PLUGIN_API", "Pipeline", "Session", "__version__", "create", "hookimpl", "run"]

_LAZY = {
    "Pipeline": "trailmark.pipeline",
    "Session": "trailmark.interfaces",
    "create": "trailmark.api",
    "run": "trailmark.api",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'trailmark' has no attribute {name!r}")
    return getattr(import_module(_LAZY[name]), name)
