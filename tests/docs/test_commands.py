"""Every `trailmark` command of the manual is one that can be typed, also where the page does not run it."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from trailmark.cli.root import root, split_plugin_options

TOP = Path(__file__).parents[2]
PAGES = sorted([TOP / "README.md", *TOP.glob("docs/**/*.md"), *TOP.glob("plugins/*/README.md")])
_BLOCK = re.compile(r"^```sh\n(.*?)^```", re.DOTALL | re.MULTILINE)


def commands_in(page: Path) -> Iterator[list[str]]:
    """Yield the words of each command behind `trailmark`."""
    for block in _BLOCK.findall(page.read_text(encoding="utf-8")):
        for line in block.replace("\\\n", " ").splitlines():
            for part in re.split(r"&&|\|\||[|;>]", line.partition(" #")[0]):
                words = shlex.split(part) if part.count("'") % 2 == 0 and part.count('"') % 2 == 0 else []
                if words[:1] == ["trailmark"] and not any(letter in part for letter in "<$*…"):
                    yield words[1:]


@pytest.mark.parametrize("page", [page for page in PAGES if any(commands_in(page))], ids=lambda page: page.stem)
def test_commands_have_the_options_that_they_are_written_with(page: Path) -> None:
    for words in commands_in(page):
        try:
            parse(words)
        except click.UsageError as error:
            if isinstance(error, click.BadParameter):
                continue  # a file that only the reader has
            pytest.fail(f"trailmark {' '.join(words)}: {error.format_message()}")


def parse(words: list[str]) -> None:
    """Parse words as `trailmark` does, and do nothing."""
    chosen, _ = split_plugin_options([])  # files of plugins are the reader's
    _, words = split_plugin_options(words)
    context = root.make_context("trailmark", list(words), obj=chosen)
    while isinstance(context.command, click.Group) and (rest := [*context._protected_args, *context.args]):
        name, command, rest = context.command.resolve_command(context, rest)
        assert command is not None
        context = command.make_context(name, rest, parent=context)


def test_an_option_that_is_not_there_is_found() -> None:
    with pytest.raises(click.NoSuchOption, match="--mode"):
        parse(["run", "robot.yaml", "--mode", "teach"])
