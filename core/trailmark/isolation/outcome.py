"""What became of a process."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Outcome"]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of the process of a cell.

    Attributes
    ----------
    state : str
        ``ok``, ``failed``, ``timeout``, ``crashed`` or ``skipped``.
    reason : str
        One line; empty for ``ok``.
    stderr : str
        The end of what it wrote to standard error.
    wall_s, cpu_s : float
        From its start to its end, and processor time of it and its children [s].
    peak_rss_mb : float
        Largest memory [MB].
    load : float
        Load average of the machine when it started.
    host : str
        Name of the machine.
    """

    state: str
    reason: str = ""
    stderr: str = ""
    wall_s: float = 0.0
    cpu_s: float = 0.0
    peak_rss_mb: float = 0.0
    load: float = 0.0
    host: str = ""
