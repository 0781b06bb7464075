"""What the manual tells to type is typed here: every page's blocks run in order, in a folder of its own.

The line "File `NAME`:" before a block, which a reader sees, writes it to a file. Comments say what else a block is:
``<!-- not run: REASON -->`` leaves one out; ``<!-- exit code: 2 -->`` expects a command to fail. Nothing else is done
than what a reader does: nothing is made behind a page's back, but for a clone of the repository, ``../trailmark``.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from subprocess import PIPE, STDOUT

import pytest

from trailmark.cli import main

REPOSITORY = Path(__file__).parents[2]
PAGES = [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").rglob("*.md"))]
PAGES = [page for page in PAGES if not {"decisions", "results"} & set(page.relative_to(REPOSITORY).parts)]

_PART = re.compile(
    r"(?:<!--\s*(?P<mark>[a-z ]+):\s*(?P<value>.*?)\s*-->\s*\n|^File `(?P<file>[^`\n]+)`:\n\n)?"
    r"```(?P<language>\w*)[^\n]*\n(?P<text>.*?)```",
    re.DOTALL | re.MULTILINE,
)
_RUN = {"sh": ["bash", "-euo", "pipefail", "-c"], "python": [sys.executable, "-c"]}
_PATIENCE_S = 300


@dataclass(frozen=True)
class Block:
    """A block of a page: what it is called, what stands in it, and what is to be done with it."""

    where: str
    language: str
    text: str
    mark: str = ""
    value: str = ""


def blocks(page: Path) -> Iterator[Block]:
    """Yield the blocks of a page in order."""
    source = page.read_text(encoding="utf-8")
    for found in _PART.finditer(source):
        where = f"{page.relative_to(REPOSITORY)}:{source.count(chr(10), 0, found.start()) + 1}"
        mark, value = ("file", found["file"]) if found["file"] else (found["mark"] or "", found["value"] or "")
        yield Block(where, found["language"], found["text"], mark, value)


def is_run(block: Block) -> bool:
    return block.mark != "not run" and (block.mark == "file" or block.language in _RUN)


def commands_of(block: Block) -> list[list[str]]:
    """Return the words of a block of nothing but ``trailmark`` commands, line by line; of another one, nothing."""
    lines = [shlex.split(line) for line in block.text.splitlines()]
    plain = block.language == "sh" and not set(block.text) & set("|&;<>$`*~#\\")
    return lines if plain and all(line[:1] == ["trailmark"] for line in lines) else []


def called(commands: list[list[str]]) -> tuple[int, str]:
    """Return exit code and words of commands, called in this process: many would end before another has started."""
    with redirect_stdout(StringIO()) as told, redirect_stderr(told):
        for words in commands:
            with pytest.raises(SystemExit) as left:
                main(words[1:])
            if left.value.code:
                return int(left.value.code), told.getvalue()
    return 0, told.getvalue()


def typed(block: Block) -> tuple[int, str]:
    """Return exit code and words of a block that was given to its interpreter."""
    line = [*_RUN[block.language], block.text]
    done = subprocess.run(line, stdout=PIPE, stderr=STDOUT, text=True, timeout=_PATIENCE_S, check=False)
    return done.returncode, done.stdout


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_every_block_is_run_or_says_why_not(page: Path) -> None:
    for block in blocks(page):
        assert block.mark in ("", "file", "not run", "exit code"), f"{block.where}: no comment {block.mark!r} is known"
        if block.mark == "not run":
            assert block.value, f"{block.where}: say why"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_no_comment_does_what_a_reader_cannot_see(page: Path) -> None:
    for comment in re.findall(r"<!--(.*?)-->", page.read_text(encoding="utf-8"), re.DOTALL):
        assert re.fullmatch(r"\s*(not run|exit code): [^\n]+", comment), f"{page.name}: {comment.strip()[:60]!r}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_a_file_that_is_named_is_a_block(page: Path) -> None:
    named = re.findall(r"^File `(.+?)`:", page.read_text(encoding="utf-8"), re.MULTILINE)

    assert named == [block.value for block in blocks(page) if block.mark == "file"]


@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if any(is_run(block) for block in blocks(page))],
    ids=lambda page: str(page.relative_to(REPOSITORY)),
)
def test_what_the_page_tells_to_type_works(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    folder = tmp_path / "mine"
    folder.mkdir()
    (tmp_path / "trailmark").symlink_to(REPOSITORY)
    monkeypatch.chdir(folder)
    for block in blocks(page):
        if not is_run(block):
            continue
        if block.mark == "file":
            (folder / block.value).write_text(block.text, encoding="utf-8")
            continue
        code, told = called(commands) if (commands := commands_of(block)) else typed(block)
        expected = int(block.value) if block.mark == "exit code" else 0
        assert code == expected, f"{block.where}: {told[-4000:]}"
