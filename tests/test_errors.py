"""The tree of errors is as it is drawn, and every module offers what it says."""

from __future__ import annotations

import importlib
import pkgutil

import pytest

import trailmark
from trailmark import errors
from trailmark.errors import RunError, TrailmarkError, UnknownPluginError


def drawn_tree() -> dict[str, set[str]]:
    """Return the bases of every class as the module's docstring draws them."""
    bases: dict[str, set[str]] = {}
    above: dict[int, str] = {}
    for line in errors.__doc__.splitlines():
        text = line.lstrip(" │├└─")
        name, _, rest = text.partition(" ")
        if not name.endswith("Error") or (line == text and name != "TrailmarkError"):
            continue
        depth = len(line) - len(text)
        parents = [above[other] for other in sorted(above) if other < depth]
        above = {other: parent for other, parent in above.items() if other < depth} | {depth: name}
        bases[name] = {parents[-1]} if parents else {"Exception"}
        if rest.startswith("(also "):
            bases[name].add(rest.removeprefix("(also ").partition(")")[0])
    return bases


def test_the_drawn_tree_is_the_tree_of_classes() -> None:
    classes = {name: getattr(errors, name) for name in errors.__all__}

    assert drawn_tree() == {name: {base.__name__ for base in cls.__bases__} for name, cls in classes.items()}


def test_every_error_of_the_module_is_offered() -> None:
    defined = {
        name for name, value in vars(errors).items() if isinstance(value, type) and value.__module__ == errors.__name__
    }

    assert defined == set(errors.__all__)


@pytest.mark.parametrize("name", errors.__all__)
def test_every_error_is_caught_as_ours_and_prints_its_message(name: str) -> None:
    error = getattr(errors, name)("no such thing")

    assert isinstance(error, TrailmarkError)
    assert str(error) == "no such thing"


def test_errors_carry_what_a_program_needs() -> None:
    assert UnknownPluginError("no", ["a", "b"]).available == ("a", "b")
    assert RunError("no", part="localizer 'floor'").part == "localizer 'floor'"


MODULES = sorted(
    module.name
    for module in pkgutil.walk_packages(trailmark.__path__, "trailmark.")
    if not module.name.endswith("__main__")
)


@pytest.mark.parametrize("name", ["trailmark", *MODULES])
def test_all_that_a_module_lists_is_there(name: str) -> None:
    module = importlib.import_module(name)

    listed = getattr(module, "__all__", [])

    assert len(set(listed)) == len(listed)
    missing = [item for item in listed if not hasattr(module, item)]
    assert missing == []
