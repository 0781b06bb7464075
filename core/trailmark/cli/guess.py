"""Which source plays a file, a folder or a camera that is named without a config."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trailmark.errors import ConfigError
from trailmark.plugins import Plugins, Registry, Spec

if TYPE_CHECKING:
    from trailmark.config import RunConfig

__all__ = ["guess_config", "is_config", "read_target", "with_remedy"]

_CONFIG_SUFFIXES = (".yaml", ".yml", ".toml")


def is_config(target: str) -> bool:
    """Whether a command's argument is a config file, by its suffix."""
    return Path(target).suffix.lower() in _CONFIG_SUFFIXES


def read_target(target: str, plugins: Plugins, overrides: Sequence[Any] = ()) -> RunConfig:
    """Read the config file that a command names, or the config of a recording that it names alone.

    Raises
    ------
    ConfigError
        If there is no such file, no source knows what to do with it, or the config is wrong.
    """
    from trailmark.pipeline import read_config

    if is_config(target):
        return read_config(target, plugins=plugins, overrides=overrides)
    config = guess_config(target, plugins.registry)
    with with_remedy(config):
        return read_config(config, plugins=plugins, overrides=overrides)


@contextmanager
def with_remedy(config: Any) -> Iterator[None]:
    """Say in an error about the source of a guessed config how to give its keys: there is no file to write in."""
    try:
        yield
    except ConfigError as error:
        source = next(iter(config["sources"])) if isinstance(config, Mapping) else None
        if source is None or f"sources.{source}" not in str(error):
            raise
        remedy = f"Without a config, give a key of the source by --set sources.{source}.KEY=VALUE"
        raise ConfigError(f"{error}\n{remedy}") from error


def guess_config(target: str, registry: Registry) -> dict[str, Any]:
    """Return the config of one source for a recording, or for ``camera`` (``camera:1`` for the second).

    Raises
    ------
    ConfigError
        If there is no such file, or no source knows what to do with it.
    """
    if target == "camera" or target.startswith("camera:"):
        device = target.partition(":")[2] or "0"
        return {"sources": {"camera": {"plugin": "camera", "device": int(device) if device.isdigit() else device}}}
    path = Path(target)
    if not path.exists():
        nearby = [entry.name for entry in path.parent.iterdir()] if path.parent.is_dir() else []
        close = get_close_matches(path.name, nearby, n=1)
        hint = f"; did you mean {path.parent / close[0]}?" if close else ""
        raise ConfigError(f"no file or folder {target}{hint}")
    fitting = [spec for spec in registry.specs("source") if _opens(spec, path)]
    if not fitting:
        known = ", ".join(sorted({pattern for spec in registry.specs("source") for pattern in spec.opens}))
        opens = f"they open {known}" if known else "there is none that opens files"
        advice = registry.kept_out() or "Write a config that names the source's plugin"
        raise ConfigError(f"no source opens {target}; {opens}. {advice}")
    best = max(fitting, key=lambda spec: _how_specific(spec, path))
    return {"sources": {_sensor_name(path, best.name): {"plugin": best.name, "path": str(path.resolve())}}}


def _opens(spec: Spec, path: Path) -> bool:
    return any(_matches(pattern, path) for pattern in spec.opens)


def _matches(pattern: str, path: Path) -> bool:
    inside = pattern.removeprefix("*/")
    if inside != pattern:
        return path.is_dir() and any(path.glob(inside))
    return path.is_file() and fnmatch(path.name.lower(), pattern)


def _how_specific(spec: Spec, path: Path) -> int:
    """Count the letters of the longest pattern that fits: ``*/rgb.txt`` says more than ``*/*.png``."""
    return max(len(pattern.replace("*", "")) for pattern in spec.opens if _matches(pattern, path))


def _sensor_name(path: Path, otherwise: str) -> str:
    name = "".join(letter if letter.isalnum() else "_" for letter in path.name.split(".")[0].lower()).strip("_")
    return name if name.isascii() and name[:1].isalpha() else otherwise
