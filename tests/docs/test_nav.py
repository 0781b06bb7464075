"""The manual's table of contents has every page, and no two decisions share a number."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[2]
NAV = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]


def test_every_page_stands_in_the_contents() -> None:
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}

    assert pages - set(re.findall(r"[\w./-]+\.md", NAV)) == set()


def test_every_card_stands_in_the_contents() -> None:
    cards = {f"methods/{path.parent.name}.md" for path in ROOT.glob("plugins/*/README.md")}

    assert cards - set(re.findall(r"[\w./-]+\.md", NAV)) == set()


def test_every_decision_has_a_number_of_its_own() -> None:
    numbers = Counter(path.name[:4] for path in (ROOT / "docs/decisions").glob("*.md"))

    assert numbers == Counter(f"{i:04}" for i in range(1, len(numbers) + 1))


def test_pages_link_to_the_cards_in_the_repository() -> None:
    wrong = [
        f"{path.relative_to(ROOT)}: {target}"
        for path in (ROOT / "docs").rglob("*.md")
        for target in re.findall(r"\]\(((?:\.\./)*methods/\w+\.md)", path.read_text(encoding="utf-8"))
    ]

    assert wrong == [], "write ../../plugins/NAME/README.md: the manual leads it to its page"
