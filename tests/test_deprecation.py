"""Old public names stay importable, and say what they are called now."""

from __future__ import annotations

import importlib

import pytest

from trailmark.interfaces import LocalizerMap, Session
from trailmark.testing import MemoryMap


@pytest.mark.parametrize(("module", "old", "new"), [("trailmark.interfaces", "Drawer", LocalizerMap)])
def test_an_old_name_is_the_new_class_and_warns(module: str, old: str, new: type) -> None:
    with pytest.warns(DeprecationWarning, match=f"{old} is called {new.__name__} now"):
        assert getattr(importlib.import_module(module), old) is new


def test_a_name_that_never_was_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'Draver'"):
        importlib.import_module("trailmark.interfaces").Draver


def test_the_sessions_map_is_found_by_its_old_name() -> None:
    session = Session(map=MemoryMap())

    with pytest.warns(DeprecationWarning, match="Session.map"):
        assert session.drawer is session.map
