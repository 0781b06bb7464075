"""What the pages about axes and about localizers show is what the program says."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree as ET

import pytest

from trailmark.plugins import load_plugins

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize(("name", "function"), [("axes-robot", "robot_picture"), ("axes-map", "map_picture")])
def test_a_picture_is_what_its_command_draws(
    load_script: Callable[[str], ModuleType], name: str, function: str
) -> None:
    axes = load_script("docs/axes.py")
    text = (DOCS / "assets" / f"{name}.svg").read_text(encoding="utf-8")

    assert getattr(axes, function)() == text
    assert not {element.tag.partition("}")[2] for element in ET.fromstring(text).iter()} & {"script", "image"}
    assert "prefers-color-scheme: dark" in text


def test_every_localizer_that_is_proposed_is_there() -> None:
    page = (DOCS / "how-to/which-localizer.md").read_text(encoding="utf-8")
    rows = [line.split("|")[2] for line in page.splitlines() if line.startswith("| ") and "`" in line.split("|")[2]]
    proposed = {name for cell in rows for name in re.findall(r"`(\w+)`", cell)}

    assert len(proposed) > 10
    assert proposed <= {spec.name for spec in load_plugins().registry.specs() if spec.kind == "localizer"}
