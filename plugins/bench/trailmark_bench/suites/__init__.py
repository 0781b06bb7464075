"""Benches that are shipped, by name: ``trailmark bench grand``."""

from __future__ import annotations

from pathlib import Path

__all__ = ["find_config", "suite_names"]

_FOLDER = Path(__file__).parent


def suite_names() -> list[str]:
    """Return the names of the benches that are shipped."""
    return sorted(path.stem for path in _FOLDER.glob("*.yaml"))


def find_config(named: Path) -> Path:
    """Return a file as it was named, or the shipped bench of this name where there is no such file."""
    is_name = named.parent == Path() and str(named) in suite_names()
    return _FOLDER / f"{named}.yaml" if is_name and not named.exists() else named
