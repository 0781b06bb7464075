"""What the commands that compare trajectories share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from trailmark.evaluation import ALIGNMENTS

__all__ = ["align_option", "short_names"]

_Command = TypeVar("_Command", bound=Callable[..., Any])


def align_option(command: _Command) -> _Command:
    """Add ``--align``: how positions are laid on the truth before they are compared."""
    option = click.option(
        "--align",
        type=click.Choice(ALIGNMENTS),
        default="se2",
        show_default=True,
        help="Lay all positions on the truth, the first pose only, or nothing.",
    )
    return option(command)


def short_names(paths: Sequence[Path]) -> list[str]:
    """Return the last part of each path, without what ends a file's name; the paths where two are called the same."""
    names = [path.stem if path.is_file() else path.resolve().name for path in paths]
    return names if len(set(names)) == len(names) else [str(path) for path in paths]
