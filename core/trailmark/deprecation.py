"""Old public names and modules: importable for one minor version, with a warning that says the new one."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

__all__ = ["MovedModules", "deprecated_name"]


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
    if new == name:  # it has moved
        new = f"{renamed[name].__module__}.{new}"
    warnings.warn(f"{module}.{name} is called {new} now", DeprecationWarning, stacklevel=3)
    return renamed[name]


class MovedModules(MetaPathFinder, Loader):
    """Gives the modules of a package that has moved by their old names too: the same modules, not copies.

    The new names are strings, resolved when an old one is imported: so core can forward to a plugin without knowing it.

    Parameters
    ----------
    old, new : str
        Full names of the package, then and now.
    elsewhere : mapping of str to str
        Modules that went to another package: full new name by the old name in the old package.
    """

    def __init__(self, old: str, new: str, elsewhere: Mapping[str, str]) -> None:
        self._prefix = f"{old}."
        self._new = new
        self._elsewhere = elsewhere
        self._specs: dict[str, ModuleSpec | None] = {}

    def install(self) -> None:
        """Add this finder to Python's, so that imports of the old names find the modules."""
        sys.meta_path.insert(0, self)  # before the finder that would load a second copy from a package's folder

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return a spec for a module of the old package; None for all others."""
        return ModuleSpec(fullname, self) if fullname.startswith(self._prefix) else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Return the module under its new name."""
        name = spec.name.removeprefix(self._prefix)
        new = self._elsewhere.get(name, f"{self._new}.{name}")
        warnings.warn(f"{spec.name} is called {new} now", DeprecationWarning, stacklevel=2)
        module = import_module(new)
        self._specs[spec.name] = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Give the module its own spec back, which the import has replaced by that of the old name."""
        assert module.__spec__ is not None
        module.__spec__ = self._specs.pop(module.__spec__.name)
