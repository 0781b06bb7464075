"""What docs/security.md names is there: a promise that points nowhere is none."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/security.md").read_text(encoding="utf-8")
CODE = [path for folder in ("core", "plugins", "tests") for path in (ROOT / folder).rglob("*.py")]


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`([\w./]+\.py)`", PAGE))))
def test_every_module_that_the_page_names_is_there(name: str) -> None:
    assert any(path.as_posix().endswith(f"/{name}") for path in CODE)


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`(test_\w+)`", PAGE))))
def test_every_test_that_the_page_names_is_there(name: str) -> None:
    assert any(f"def {name}(" in path.read_text(encoding="utf-8") for path in CODE if "tests" in path.parts)
