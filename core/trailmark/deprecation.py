"""Old public names: importable for one minor version, with a warning that says the new one."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

__all__ = ["deprecated_name"]


def deprecated_name(module: str, name: str, renamed: Mapping[str, Any]) -> Any:
    """Return what an old name of a module stands for; called by the module's ``__getattr__``.

    Parameters
    ----------
    module : str
        Full name of the module.
    name : str
        The attribute that somebody asked for.
    renamed : mapping of str to object
        The objects by their old names.

    Raises
    ------
    AttributeError
        If the name was never there.
    """
    if name not in renamed:
        raise AttributeError(f"module {module!r} has no attribute {name!r}")
    new = getattr(renamed[name], "__name__", "something else")
    warnings.warn(f"{module}.{name} is called {new} now", DeprecationWarning, stacklevel=3)
    return renamed[name]
