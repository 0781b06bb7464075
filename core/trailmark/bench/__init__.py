"""The old name of the bench, which is the plugin ``bench`` (package ``trailmark_bench``) now.

Whatever was imported from here still comes, with a warning that says its new name; importing this alone does nothing.
"""

from __future__ import annotations

import warnings
from importlib import import_module
from typing import Any

from trailmark.deprecation import MovedModules

_NEW = "trailmark_bench"
_ISOLATION = ("call", "calls", "executor", "fingerprint", "plain")

MovedModules(__name__, _NEW, {name: f"trailmark.isolation.{name}" for name in _ISOLATION}).install()


def __getattr__(name: str) -> Any:
    if name.startswith("__"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_NEW), name)
    warnings.warn(f"{__name__}.{name} is called {_NEW}.{name} now", DeprecationWarning, stacklevel=2)
    return value
