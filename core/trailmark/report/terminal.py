"""Consoles of rich that end quietly when who reads them has gone away, as `| head` does."""

from __future__ import annotations

import os
import sys

from rich.console import Console

__all__ = ["TerminalConsole"]


class TerminalConsole(Console):
    """Raises `BrokenPipeError`, of which the command line makes a quiet end; on standard error it falls silent."""

    def on_broken_pipe(self) -> None:
        """Answer that the pipe is broken; rich itself would exit with code 1, in the midst of a run."""
        self.quiet = True
        if not self.stderr:
            raise BrokenPipeError
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stderr.fileno())
        os.close(nowhere)
