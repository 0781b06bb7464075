"""What the manual tells to type is typed here: every page's blocks run in order, in a folder of its own.

The line "File `NAME`:" before a block, which a reader sees, writes it to a file. Comments say what else a block is:
``<!-- not run: REASON -->`` leaves one out; ``<!-- exit code: 2 -->`` expects a command to fail. Nothing else is done
than what a reader does: nothing is made behind a page's back, but for a clone of the repository, ``../trailmark``.

Blocks of plain ``trailmark`` commands are called in this process, which is faster and nearly the same: the console
script, and warnings on standard error, are tried where blocks go to a shell, as all of `TYPED` do.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
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
#: The page of which every block has a process of its own, as with a reader.
TYPED = REPOSITORY / "README.md"
#: A command of which a shell makes the same words as `shlex`. A plugin's file is read once in a process, so not here.
_PLAIN = re.compile(r"""trailmark(?= |$)(?!.* --plugin)([\w./:=,@%+ -]|'[^']*'|"[^"$`\\!]*")*""")


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
    """Return the words of a block of plain ``trailmark`` commands alone, line by line; of another one, nothing."""
    lines = block.text.splitlines()
    is_plain = block.language == "sh" and all(_PLAIN.fullmatch(line) for line in lines)
    return [shlex.split(line) for line in lines] if is_plain else []


def called(commands: list[list[str]]) -> tuple[int, str]:
    """Return exit code and words of commands, called in this process: many would end before another has started."""
    with redirect_stdout(StringIO()) as told, redirect_stderr(told), pytest.MonkeyPatch.context() as patch:
        for words in commands:
            patch.setattr(sys, "argv", words)
            with pytest.raises(SystemExit) as left, _interrupted_after(_PATIENCE_S):
                main(words[1:])
            if left.value.code:
                return int(left.value.code), told.getvalue()
    return 0, told.getvalue()


@contextmanager
def _interrupted_after(seconds: float) -> Iterator[None]:
    """Press Ctrl-C when the time is over: of a command it is the exit code 130."""
    before = signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


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
        commands = [] if page == TYPED else commands_of(block)
        code, told = called(commands) if commands else typed(block)
        expected = int(block.value) if block.mark == "exit code" else 0
        assert code == expected, f"{block.where}: {told[-4000:]}"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (
            "trailmark run a.yaml --set 'x=[1, 2]' --set y=-1.5",
            ["run", "a.yaml", "--set", "x=[1, 2]", "--set", "y=-1.5"],
        ),
        *((f"trailmark {sign}", None) for sign in ("(1)", "{a,b}", "[ab]", "a?", "!a", "$a", "a*", "a | b", "it's")),
        ("trailmark --plugin ./mine.py run a.yaml", None),
        ("trailmark-other run", None),
    ],
)
def test_only_what_a_shell_takes_word_by_word_is_called(line: str, words: list[str] | None) -> None:
    assert commands_of(Block("page.md:1", "sh", line)) == ([] if words is None else [["trailmark", *words]])


def test_what_is_not_for_a_shell_is_not_taken_apart() -> None:
    assert commands_of(Block("page.md:1", "python", "# it's a comment")) == []


def test_a_command_that_is_called_is_known_by_its_words_and_not_waited_for_without_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen = []

    def hangs(words: list[str]) -> None:
        seen.append((words, sys.argv))
        time.sleep(30.0)

    monkeypatch.setattr(sys.modules[__name__], "main", hangs)
    monkeypatch.setattr(sys.modules[__name__], "_PATIENCE_S", 0.05)

    with pytest.raises(KeyboardInterrupt):
        called([["trailmark", "run"]])
    assert seen == [(["run"], ["trailmark", "run"])]
