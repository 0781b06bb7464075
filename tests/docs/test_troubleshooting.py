"""The messages of the troubleshooting page are those of the program."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/how-to/troubleshooting.md").read_text(encoding="utf-8").partition("## Without a message")[0]
MESSAGES = re.findall(r"^\| `([^`]+)` \|", PAGE, re.MULTILINE)
#: Strings of the program; a string that goes on in the next line is one.
SOURCE = re.sub(
    r'"\s+f?"',
    "",
    "\n".join(path.read_text(encoding="utf-8") for part in ("core", "plugins") for path in (ROOT / part).rglob("*.py")),
)


@pytest.mark.parametrize("message", MESSAGES)
def test_a_message_is_one_of_the_programs(message: str) -> None:
    for piece in filter(None, (piece.strip(" ,:;") for piece in message.split("…"))):
        if len(piece) > 2:
            assert piece in SOURCE, piece


def test_there_are_messages() -> None:
    assert len(MESSAGES) > 20
