"""Several localizers see the same frames, beside the exact truth; none of them steers."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np

from trailmark.deprecation import deprecated_name
from trailmark.estimates import Belief, Estimate
from trailmark.frames import Frame
from trailmark.geometry import Trajectory
from trailmark.interfaces import FrameSource, Localizer

__all__ = ["Watcher", "observe_timed", "show"]


class Watcher(ABC):
    """A localizer that is shown frames, and keeps what it says."""

    @abstractmethod
    def see(self, frame: Frame) -> None:
        """Take the next frame of the source, of whatever sensor."""


def show(source: FrameSource, watchers: Collection[Watcher], kind: type) -> Trajectory:
    """Show all frames of a started source to all watchers; return the true poses at the frames of a kind.

    Parameters
    ----------
    kind : type
        Of the payload: the pictures that the watchers answer.
    """
    stamps_s = []
    for frame in source.frames():
        if isinstance(frame.payload, kind):
            stamps_s.append(frame.stamp_s)
        for watcher in watchers:
            watcher.see(frame)
    truth = source.ground_truth()
    assert truth is not None
    return truth.at(np.array(stamps_s))


def observe_timed(
    localizer: Localizer, frame: Frame, belief: Belief, clock_ns: Callable[[], int] = time.thread_time_ns
) -> tuple[Sequence[Estimate], float]:
    """Return what a localizer says of a frame, and what that cost by a clock of CPU time [ms]."""
    began_ns = clock_ns()
    answers = localizer.observe(frame, belief)
    return answers, (clock_ns() - began_ns) / 1e6


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"timed": observe_timed})
