"""One cell of a bench: where it stands in the matrix, and everything that another process needs to run it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

__all__ = ["FINISHED", "STATES", "UNSUCCESSFUL", "Cell", "State"]

State = Literal["pending", "running", "ok", "failed", "timeout", "crashed", "skipped"]

#: What can become of a cell.
STATES: tuple[State, ...] = get_args(State)

#: States of a cell that ran and gave no result.
UNSUCCESSFUL: tuple[State, ...] = ("failed", "timeout", "crashed")

#: States of a cell that has ended.
FINISHED: tuple[State, ...] = ("ok", *UNSUCCESSFUL, "skipped")


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """A cell.

    Attributes
    ----------
    id : str
        Its address: digest of config, teaching, code, data and protocol, 20 hex digits. Whatever has the same
        address gives the same figures.
    matrix : str
        Name of its matrix; empty where there is one.
    coordinates : mapping of str to str or int
        Value of each axis by the axis' name (``source``, ``localizer``, ..., ``seed``).
    request : mapping
        For `trailmark_bench.child`: plain data.
    alone : bool
        Runs when nothing else does.
    missing : str
        Why it cannot run here; empty: it can.
    is_installed : bool
        Nobody named its localizer: it is skipped where there is no sensor for it.
    """

    id: str
    matrix: str
    coordinates: Mapping[str, Any]
    request: Mapping[str, Any] = field(repr=False)
    alone: bool = False
    missing: str = ""
    is_installed: bool = False

    @property
    def label(self) -> str:
        """The coordinates in words: ``straight, klt, seed 3``."""
        words = [f"seed {value}" if axis == "seed" else str(value) for axis, value in self.coordinates.items()]
        return ", ".join([*([self.matrix] if self.matrix else []), *words])
