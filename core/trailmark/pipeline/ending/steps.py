"""The end of a run, step by step: no step that fails keeps the others from being made."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TypeVar

from trailmark.errors import RunError
from trailmark.interruption import CLOSE_S, ending_signal, reason_of, shielded
from trailmark.pipeline.outputs.result import Status

__all__ = ["Ending"]

logger = logging.getLogger(__name__)

_T = TypeVar("_T")


class Ending:
    """How a run ends. The first step that fails makes it ``failed``; of a run that has failed already it is a warning.

    Parameters
    ----------
    status : {"done", "stopped", "interrupted", "failed"}
        How its loop ended.
    reason : str
        Why; its first line counts.
    spared : frozenset of str
        Parts whose failure is a warning.

    Attributes
    ----------
    failure : BaseException or None
        What the first step that failed has raised.
    """

    def __init__(self, status: Status, reason: str, spared: frozenset[str] = frozenset()) -> None:
        self.status: Status = status
        self.reason = reason.partition("\n")[0]
        self.failure: BaseException | None = None
        self._spared = spared

    def attempt(self, step: Callable[[], _T], patience_s: float = CLOSE_S) -> _T | None:
        """Make a step and return its answer; None if it fails, or takes longer than one waits for it.

        Parameters
        ----------
        step : callable
            Makes it.
        patience_s : float
            How long after the program was told to end it may go on [s].
        """
        try:
            with shielded(patience_s):
                return step()
        except KeyboardInterrupt as error:
            if self.status in ("done", "stopped"):
                self.status, self.reason = "interrupted", f"{reason_of(error)} while finishing"
            else:
                logger.warning("not everything came to its end: %s", reason_of(error))
        except BaseException as error:
            self.fail(error)
        return None

    def fail(self, error: BaseException) -> None:
        """Take note of what a step has raised."""
        is_cut_off = self.status == "interrupted" and ending_signal() is not None  # what fails then may fail for that
        if self.status == "failed" or is_cut_off or (isinstance(error, RunError) and error.part in self._spared):
            logger.warning("%s", error)
        else:
            self.status, self.reason, self.failure = "failed", str(error).partition("\n")[0], error
