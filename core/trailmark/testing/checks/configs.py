"""What every config must be, and what naming a part may import."""

from __future__ import annotations

import builtins
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import Any

from pydantic import ValidationError

from trailmark.config import PluginConfig
from trailmark.interfaces import Part
from trailmark.testing.checks.parametrize import Check, skip

__all__ = ["HEAVY", "common_checks"]

#: Packages that take long to import: never at registration, nor with a config.
HEAVY = ("cv2", "numba", "scipy", "sklearn", "filterpy", "matplotlib", "rosbags", "cyclonedds", "pandas", "torch")


def common_checks(make: Callable[[], Part], config: Callable[[], PluginConfig]) -> dict[str, Check]:
    """Return the checks of every kind of part: its config, its constructor, `close`, and what listing it imports."""
    return {
        "config_forbids_unknown_keys": lambda: _forbids_unknown_keys(config()),
        "config_is_frozen": lambda: _is_frozen(config()),
        "config_describes_every_key": lambda: _describes_every_key(type(config())),
        "constructor_is_cheap": lambda: _is_cheap(make),
        "close_at_any_time": lambda: _closes(make),
        "listing_imports_nothing_heavy": lambda: _is_light(type(make()), type(config())),
    }


def _forbids_unknown_keys(config: PluginConfig) -> None:
    try:
        type(config).model_validate({"no_such_key_of_yours": 1})
    except ValidationError as error:
        kinds = {found["loc"]: found["type"] for found in error.errors()}
        assert kinds.get(("no_such_key_of_yours",)) == "extra_forbidden", f"an unknown key gave {kinds}"
    else:
        raise AssertionError(f"{type(config).__name__} takes an unknown key: derive it from PluginConfig")


def _is_frozen(config: PluginConfig) -> None:
    for key in type(config).model_fields:
        try:
            setattr(config, key, getattr(config, key))
        except ValidationError:
            continue
        raise AssertionError(f"{type(config).__name__}.{key} can be assigned: derive it from PluginConfig")


def _describes_every_key(model: type[PluginConfig]) -> None:
    bare = [key for key, field in model.model_fields.items() if not (field.description or "").strip()]
    assert not bare, f"{model.__name__}: write a docstring below {', '.join(bare)}; it is what `plugins show` prints"


def _is_cheap(make: Callable[[], Part]) -> None:
    make()  # what it imports, it has imported now
    with _outside_forbidden():
        make()


@contextmanager
def _outside_forbidden() -> Iterator[None]:
    def refuse(*arguments: Any, **_: Any) -> Any:
        raise AssertionError(f"the constructor opens {arguments[:1]}: leave that to start()")

    kept = builtins.open, socket.socket, subprocess.Popen
    builtins.open, socket.socket, subprocess.Popen = refuse, refuse, refuse  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        builtins.open, socket.socket, subprocess.Popen = kept  # type: ignore[misc]


def _closes(make: Callable[[], Part]) -> None:
    part = make()
    part.close()
    part.close()


def _is_light(part: type[Part], model: type[PluginConfig]) -> None:
    module = _registering_module(part)
    if module is None:
        skip(f"{part.__name__} is not registered by an installed plugin")
    names = [name for name in (module, model.__module__) if name not in (part.__module__, "__main__")]
    code, said = _imported_by(tuple(names))
    assert code == 0, f"importing {', '.join(names)} fails alone: {said}"
    assert not said, f"importing {', '.join(names)} imports {said}: import it on first use"


@cache
def _imported_by(names: tuple[str, ...]) -> tuple[int, str]:
    """Return the exit code of a process that imports modules, and the heavy ones that came along, or its last line."""
    program = f"import sys, {', '.join((*names, 'sys'))}; print(*(set({HEAVY!r}) & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    return done.returncode, (done.stdout if done.returncode == 0 else done.stderr).strip().rpartition("\n")[2]


def _registering_module(part: type[Part]) -> str | None:
    """Return the module of the entry point that registers a class."""
    from importlib.metadata import entry_points

    from trailmark.plugins import load_plugins

    modules: Mapping[str, str] = {point.name: point.module for point in entry_points(group="trailmark")}
    target = f"{part.__module__}:{part.__qualname__}"
    found = [spec for spec in load_plugins().registry.specs() if spec.target == target]
    return modules.get(found[0].entry_point) if found else None
