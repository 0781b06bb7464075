"""Where the cells of a bench run: the interface of executors, which are plugins."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from trailmark.config.base import PluginConfig
from trailmark.errors import RunError
from trailmark.isolation.outcome import Outcome

__all__ = ["Executor", "ExecutorConfig", "ExecutorLostError", "Finished", "Job"]


class ExecutorLostError(RunError):
    """What runs the cells is gone: a scheduler, a network, a queue. It says nothing about the cells."""


class ExecutorConfig(PluginConfig):
    """What every executor takes."""

    jobs: int | None = None
    """Cells at a time; left out: as many as the executor has places for."""


@dataclass(frozen=True, slots=True)
class Job:
    """A cell to run.

    Attributes
    ----------
    id : str
        Of the cell.
    request : mapping
        Plain data for the process that runs it.
    """

    id: str
    request: Mapping[str, Any] = field(repr=False)


@dataclass(frozen=True, slots=True)
class Finished:
    """A job that ran.

    Attributes
    ----------
    id : str
        Of the cell.
    outcome : Outcome
        What became of it.
    folder : Path or None
        What it left, on this machine; taken over by the bench.
    files : mapping of str to bytes
        The same from another machine: name in the folder to content.
    is_lost : bool
        It did not end: the machine that ran it was lost, or its answer was. The cell is pending again then, and
        `outcome` says why; a state that blames the method would be wrong.
    """

    id: str
    outcome: Outcome
    folder: Path | None = None
    files: Mapping[str, bytes] = field(default_factory=dict, repr=False)
    is_lost: bool = False


class Executor(ABC):
    """Runs jobs somewhere.

    A job that is lost with the machine that ran it is run again by the executor, or ends with `Finished.is_lost`. When
    everything is lost, `submit`, `wait` or `slots` raise `ExecutorLostError`: the bench closes the executor then,
    starts it again, and submits what has not ended.

    Parameters
    ----------
    config : ExecutorConfig
        Its own keys.
    """

    def __init__(self, config: Any) -> None:
        self.config = config

    @abstractmethod
    def start(self, workspace: Path) -> None:
        """Get ready, after `close` too; `workspace` is a folder for what is in work on this machine.

        Raises
        ------
        ConfigError
            If what it needs is not there.
        """

    @property
    @abstractmethod
    def slots(self) -> int:
        """How many jobs it runs at a time."""

    @property
    def shares_frames(self) -> bool:
        """Whether a job finds the frames that another one rendered: the bench then does not start both side by side."""
        return False

    @abstractmethod
    def submit(self, job: Job) -> None:
        """Take a job; returns at once."""

    @abstractmethod
    def wait(self, timeout_s: float) -> Sequence[Finished]:
        """Return the jobs that have ended since; after `timeout_s` none if none has."""

    @abstractmethod
    def close(self) -> None:
        """End what is running, and leave nothing behind; twice too."""
