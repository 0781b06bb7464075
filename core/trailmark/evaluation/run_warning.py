"""One thing that a run should not be taken for a success without."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

__all__ = ["RunWarning"]


@dataclass(frozen=True, slots=True)
class RunWarning:
    """A reason why the figures of a run are invalid, or less reliable than they look.

    Attributes
    ----------
    about : str
        The localizer or sensor; empty: the whole run.
    fact, remedy : str
        What is wrong, with its number; what to do about it.
    is_worthless : bool
        The figures say nothing at all; a bench takes the cell for failed.
    """

    about: str
    fact: str
    remedy: str
    is_worthless: bool = True

    def __str__(self) -> str:
        return f"{self.about}: {self.fact}; {self.remedy}" if self.about else f"{self.fact}; {self.remedy}"

    def document(self) -> dict[str, Any]:
        """Return it as plain data, for ``metrics.json``."""
        return asdict(self)
