"""The generated pages hold every part and every command; every hook and every public name says what it is."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import pkgutil
import posixpath
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

import trailmark
from trailmark.plugins import load_plugins
from trailmark.plugins.hookspecs import HookSpecs

REPOSITORY = Path(__file__).parents[2]
PACKAGES = ("trailmark", *sorted(path.name for path in REPOSITORY.glob("plugins/*/trailmark_*")))

#: Modules that are run or generated, not imported.
_LEFT_OUT = ("trailmark.cli.__main__", "trailmark_bench.child")
#: Rooms of core that no program of a user's calls: commands, doors to other rooms, and what others are made of.
_NOT_FOR_USERS = {
    *(f"trailmark.{room}" for room in ("api", "bench", "builtin", "cli", "lazy", "scaffold")),
    "trailmark.watching",
}
#: Packages of extras that are too large for everybody's test environment.
_EXTRAS = ("rerun", "cyclonedds")


@pytest.fixture(scope="module")
def hooks(load_script: Callable[[str], ModuleType]) -> ModuleType:
    return load_script("docs/hooks.py")


def test_the_config_reference_has_every_part_and_key(hooks: ModuleType) -> None:
    page = hooks.config_reference()

    for spec in load_plugins().registry.specs():
        if spec.distribution == "trailmark" and spec.kind not in ("metric", "experiment", "dataset"):
            assert f"\n### {spec.name}\n" in page
            for key in spec.load_config().model_fields:
                assert f"| `{key}` |" in page


def test_the_command_reference_has_every_command(hooks: ModuleType) -> None:
    page = hooks.cli_reference()

    for command in ("demo", "run", "teach", "replay", "bench run", "plugins new", "store info", "sim render"):
        assert f" trailmark {command}\n" in page
    assert "Traceback" not in page


def test_the_python_reference_has_every_public_name(hooks: ModuleType) -> None:
    pages = {path: text for path, text in hooks.pages() if path.startswith("reference/python/")}
    contents = (REPOSITORY / "mkdocs.yml").read_text(encoding="utf-8")
    listed = set("\n".join(pages.values()).split("\n"))
    folder = REPOSITORY / "core/trailmark"
    rooms = [f"trailmark.{path.stem}" for path in folder.iterdir() if path.suffix == ".py" or any(path.glob("*.py"))]

    for module in [*rooms, *PACKAGES]:
        if module in _NOT_FOR_USERS or module.endswith("__"):
            continue
        for name in getattr(importlib.import_module(module), "__all__", ()):
            assert f"::: {module}.{name}" in listed
    assert [path for path in pages if path not in contents] == []


def test_links_of_a_card_lead_somewhere_or_are_words(hooks: ModuleType) -> None:
    for path, text in hooks.pages():
        for _, _, target in hooks._LINK.findall(text):
            file = target.partition("#")[0]
            if file and not file.startswith(("../methods", "../reference")):
                leads_to = posixpath.normpath(f"docs/{posixpath.dirname(path)}/{file}")
                assert (REPOSITORY / leads_to).exists(), f"{path}: {target}"


def modules() -> list[str]:
    found = []
    for package in PACKAGES:
        root = importlib.import_module(package)
        found += [package, *(one.name for one in pkgutil.walk_packages(root.__path__, f"{package}."))]
    return [name for name in found if name not in _LEFT_OUT]


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_says_what_it_is(package: str) -> None:
    bare = []
    for name in (one for one in modules() if one.split(".")[0] == package):
        try:
            module = importlib.import_module(name)
        except ModuleNotFoundError as error:
            if error.name not in _EXTRAS:
                raise
            continue
        if not (module.__doc__ or "").strip() and Path(module.__file__ or "").stat().st_size:
            bare.append(name)
        for public in getattr(module, "__all__", ()):
            try:
                value = getattr(module, public)  # of a package, imported now
            except ModuleNotFoundError as error:
                if error.name not in _EXTRAS:
                    raise
                continue
            if (inspect.isclass(value) or inspect.isfunction(value)) and not (inspect.getdoc(value) or "").strip():
                bare.append(f"{name}.{public}")
    assert not bare, f"no docstring: {', '.join(bare)}"


def test_every_hook_is_described() -> None:
    described = (REPOSITORY / "docs").rglob("*.md")
    text = "\n".join(path.read_text(encoding="utf-8") for path in described)
    hooks = [name for name in vars(HookSpecs) if name.startswith("trailmark_")]

    assert len(hooks) >= 4
    for name in hooks:
        assert (inspect.getdoc(getattr(HookSpecs, name)) or "").strip(), f"{name} has no docstring"
        assert name in text, f"{name} stands nowhere in the manual"


@pytest.mark.slow
def test_the_manual_builds_without_warnings(tmp_path: Path) -> None:
    pytest.importorskip("material", reason="needs mkdocs-material")
    pytest.importorskip("mkdocstrings_handlers.python", reason="needs mkdocstrings-python")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "-q", "--strict", "-d", str(tmp_path / "site")],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site" / "reference" / "config" / "index.html").stat().st_size > 10_000
    assert trailmark.__version__


def test_the_manual_leads_links_to_cards_to_its_own_pages(hooks: ModuleType) -> None:
    text = "[the card](../../plugins/sim/README.md#worlds) and [another](../plugins/divs/README.md)"

    led = hooks.on_page_markdown(text, None, None, None)

    assert led == "[the card](../methods/sim.md#worlds) and [another](methods/divs.md)"
