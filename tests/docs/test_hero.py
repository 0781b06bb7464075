"""The moving picture at the head of the README."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

PICTURE = Path(__file__).parents[2] / "docs/assets/demo.svg"
REPOSITORY = PICTURE.parents[2]


def test_it_is_small_and_fetches_and_runs_nothing() -> None:
    text = PICTURE.read_text(encoding="utf-8")
    tags = {element.tag.partition("}")[2] for element in ET.fromstring(text).iter()}

    assert len(text) < 1_500_000
    assert {"animate", "animateMotion", "image"} <= tags
    assert not {"script", "foreignObject"} & tags
    assert "prefers-color-scheme: dark" in text
    assert text.count("href=") == text.count('href="data:image/jpeg;base64,')


@pytest.mark.parametrize("name", ["demo.svg", "report-light.png", "report-dark.png"])
def test_the_readme_shows_it(name: str) -> None:
    assert f"docs/assets/{name}" in (REPOSITORY / "README.md").read_text(encoding="utf-8")
    assert (REPOSITORY / "docs/assets" / name).stat().st_size < 1_500_000
