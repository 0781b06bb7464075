"""The page about the architecture stays true: its paths exist, and its floors hold."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CORE = ROOT / "core" / "trailmark"
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
FLOORS = [re.findall(r"`(\w+)`", row) for row in re.findall(r"^\| \d [^|]*\|(.*)\|$", PAGE, re.MULTILINE)]
ROOMS = sorted(
    path.stem for path in CORE.iterdir() if (path.suffix == ".py" or any(path.glob("*.py"))) and path.stem != "__init__"
)


def loaded_rooms(room: str) -> set[str]:
    """Return the rooms that are imported when a room is: at the top of its modules, type checking apart."""
    files = [CORE / f"{room}.py"] if (CORE / f"{room}.py").exists() else sorted((CORE / room).rglob("*.py"))
    found = set()
    for file in files:
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("trailmark."):
                found.add(node.module.split(".")[1])
    return found - {room}


@pytest.mark.parametrize("path", sorted(set(re.findall(r"`((?:core|plugins|docs|tests|benchmarks)/[\w./]+)`", PAGE))))
def test_every_path_on_the_page_exists(path: str) -> None:
    assert (ROOT / path).exists()


def test_every_room_stands_on_one_floor() -> None:
    assert sorted(room for floor in FLOORS for room in floor) == ROOMS


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_imports_only_what_stands_below_it(room: str) -> None:
    below: set[str] = set()
    for floor in reversed(FLOORS):
        if room in floor:
            below |= set(floor[: floor.index(room)])
            break
        below |= set(floor)

    assert loaded_rooms(room) <= below


def test_a_run_is_understood_from_seven_files() -> None:
    reading = PAGE.partition("## `trailmark run`")[2].partition("\n## ")[0]

    assert len(re.findall(r"^\d+\. `core/", reading, re.MULTILINE)) <= 7
