"""Type hints of what plugins implement and receive resolve at run time, as those who build on annotations need."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any, get_type_hints

import pytest

PACKAGES = ("frames", "estimates", "commands", "paths", "geometry", "interfaces", "config", "pipeline")

#: Lists of plugins do without pydantic, and so do the interfaces: that of a config is known to type checkers alone.
WITHOUT = {"interfaces.PathStore.open"}
#: Nobody but the pipeline makes or starts these.
WITHOUT |= {"pipeline.SourceStream.__init__", "pipeline.SourceStream.start"}


def public_functions(cls: type) -> Iterator[tuple[str, Callable[..., Any]]]:
    """Yield what a class itself defines: methods, properties, and ``__init__``."""
    for name, member in vars(cls).items():
        function = member.fget if isinstance(member, property) else getattr(member, "__func__", member)
        if inspect.isfunction(function) and (name == "__init__" or not name.startswith("_")):
            yield name, function


def annotated() -> Iterator[tuple[str, Any]]:
    for package in PACKAGES:
        module = import_module(f"trailmark.{package}")
        for name in module.__all__:
            thing = getattr(module, name)
            if inspect.isclass(thing):
                yield f"{package}.{name}", thing
                yield from ((f"{package}.{name}.{method}", function) for method, function in public_functions(thing))
            elif inspect.isfunction(thing):
                yield f"{package}.{name}", thing


ANNOTATED = {name: thing for name, thing in annotated() if name not in WITHOUT}


@pytest.mark.parametrize("package", PACKAGES)
def test_hints_of_public_records_and_methods_resolve(package: str) -> None:
    unresolved = {}
    for name, thing in ANNOTATED.items():
        if name.startswith(f"{package}."):
            try:
                get_type_hints(thing)
            except (NameError, AttributeError, TypeError) as error:
                unresolved[name] = str(error)

    assert unresolved == {}


def test_what_is_looked_at_has_the_records_and_interfaces_of_plugins() -> None:
    known = {"frames.SensorInfo", "interfaces.Session", "pipeline.RunResult", "pipeline.Step", "pipeline.Pipeline.path"}

    assert known | {"interfaces.FrameSource.outlines", "interfaces.Localizer.moved"} <= ANNOTATED.keys()
