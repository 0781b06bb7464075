"""Fake distributions: folders of metadata and modules that look installed."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib import invalidate_caches, metadata
from pathlib import Path

import pytest

from trailmark.plugins import Plugins, Selection, discover_plugins

REGISTER = """
from trailmark import hookimpl

@hookimpl
def trailmark_register(registry):
    registry.localizer("{name}", ":Thing", summary="A thing", gives=["motion"])

class Thing:
    pass
"""


@dataclass
class FakeSite:
    """A folder of fake distributions that stands on the import path."""

    folder: Path
    names: list[str] = field(default_factory=list)

    def install(
        self, distribution: str, modules: dict[str, str], version: str = "0.1", requires: tuple[str, ...] = ()
    ) -> None:
        """Install a distribution with one entry point for every module, named like it."""
        info = self.folder / f"{distribution.replace('-', '_')}-{version}.dist-info"
        info.mkdir()
        lines = "".join(f"Requires-Dist: {line}\n" for line in requires)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: {version}\n{lines}\n")
        points = "".join(f"{name} = {name}\n" for name in modules)
        (info / "entry_points.txt").write_text(f"[trailmark]\n{points}")
        for name, source in modules.items():
            (self.folder / f"{name}.py").write_text(source)
        self.names += modules
        invalidate_caches()

    def entry_points(self) -> list[metadata.EntryPoint]:
        found = metadata.distributions(path=[str(self.folder)])
        return [point for distribution in found for point in distribution.entry_points.select(group="trailmark")]

    def discover(self, selection: Selection | None = None) -> Plugins:
        """Load what is installed here, and nothing else."""
        return discover_plugins(selection or Selection(), self.entry_points())


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeSite]:
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    fake = FakeSite(folder)
    before = set(sys.modules)  # plugins of one file that other tests hold
    yield fake
    for name in set(sys.modules) - before:
        if name in fake.names or name.startswith("trailmark_file_"):
            del sys.modules[name]


@pytest.fixture
def register() -> str:
    """Source of a plugin module that registers one localizer; fill in ``{name}``."""
    return REGISTER
