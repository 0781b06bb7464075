"""How a place in a config is called: by keys, or by line and column of its text."""

from __future__ import annotations

__all__ = ["Key", "Keys", "TextError"]

Key = str | int
Keys = tuple[Key, ...]


class TextError(Exception):
    """A text that cannot be read: what is wrong, on which line and in which column (from 1).

    Parameters
    ----------
    message : str
        What is wrong.
    line, column : int or None
        Where, from 1; None: nowhere in particular.
    """

    def __init__(self, message: str, line: int | None = None, column: int | None = None) -> None:
        super().__init__(message)
        self.line, self.column = line, column

    def place(self, name: str) -> str:
        """Return ``name line 3, column 5``, as far as it is known."""
        line = "" if self.line is None else f" line {self.line}"
        return name + line + ("" if self.column is None else f", column {self.column}")
