"""The life of a part: its session, its start, timed and guarded; and closing, the last first."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from time import perf_counter_ns
from typing import TYPE_CHECKING, Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import TrailmarkError
from trailmark.failures import call_guarded
from trailmark.frames import SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Mode, Part, Session
from trailmark.interruption import CLOSE_S, Interrupted, shielded
from trailmark.pipeline.instruments import StageTimes

if TYPE_CHECKING:
    from trailmark.paths import Path

__all__ = ["PartStarter", "Sessions", "part_rng"]

logger = logging.getLogger(__name__)


def part_rng(seed: int, kind: str, name: str) -> np.random.Generator:
    """Return the generator of one part: from (seed, kind, name) alone, the same on every machine.

    Adding or renaming one part changes no other part's numbers.
    """
    digest = hashlib.sha256(f"{kind}:{name}".encode()).digest()
    words = np.frombuffer(digest, dtype="<u4").tolist()
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=words))


@dataclass(frozen=True, slots=True, eq=False)
class Sessions:
    """What the sessions of all parts of a run have in common; `session_of` makes the session of one part.

    Attributes
    ----------
    mode : Mode
        What the run is for.
    seed : int
        Every part's random numbers branch off it.
    path : Path or None
        The taught path, in replay.
    start_pose : Pose2 or None
        Base in the map at the start; None: unknown.
    sensors : mapping of str to SensorInfo
        All sensors of the run, by name.
    tell_pose : callable or None
        Passes a pose that a person gives on to the estimator.
    """

    mode: Mode
    seed: int
    path: Path | None = None
    start_pose: Pose2 | None = None
    sensors: Mapping[str, SensorInfo] = field(default_factory=dict)
    tell_pose: Callable[[Pose2, Floats | None], None] | None = None

    def session_of(self, kind: str, name: str, **more: Any) -> Session:
        """Return the session of a part; `more` holds the fields of this part alone."""
        common: dict[str, Any] = {
            "name": name,
            "mode": self.mode,
            "sensors": self.sensors,
            "path": self.path,
            "start_pose": self.start_pose,
            "rng": part_rng(self.seed, kind, name),
        }
        if self.tell_pose is not None:
            common["tell_pose"] = self.tell_pose
        return Session(**(common | more))


class PartStarter:
    """Starts parts one by one, and leaves behind how they are closed.

    Parameters
    ----------
    closing : ExitStack
        Takes what closes each part.
    times : StageTimes
        Takes how long each start took: ``start.KIND.NAME``, or ``start.KIND`` of the only one.

    Attributes
    ----------
    not_closed : list of TrailmarkError
        What parts raised when they were closed.
    """

    def __init__(self, closing: ExitStack, times: StageTimes) -> None:
        self.not_closed: list[TrailmarkError] = []
        self._closing = closing
        self._times = times
        closing.push(self._warn_of_failures)

    def start(self, kind: str, part: Part, session: Session) -> None:
        """Start a part.

        Raises
        ------
        RunError
            If it raises what is no error of Trailmark.
        """
        self.run(kind, session.name, lambda: part.start(session), part.close)

    def run(self, kind: str, name: str, start: Callable[[], None], close: Callable[[], None]) -> None:
        """Start something that is no part by itself."""
        part = kind if name == kind else f"{kind} {name!r}"
        self.on_close(part, close)
        began_ns = perf_counter_ns()
        with shielded(0.0):  # a device that does not answer is not waited for
            call_guarded(part, "start", start)
        stage = f"start.{kind}" if name == kind else f"start.{kind}.{name}"
        self._times.stage(stage).append(perf_counter_ns() - began_ns)

    def on_close(self, what: str, close: Callable[[], None]) -> None:
        """Remember to close something; one that fails keeps no other from being closed."""
        self._closing.callback(self._close, what, close)

    def _close(self, what: str, close: Callable[[], None]) -> None:
        try:
            with shielded(CLOSE_S):
                call_guarded(what, "close", close)
        except Interrupted:
            logger.warning("%s did not close in time", what)
        except TrailmarkError as error:
            self.not_closed.append(error)

    def _warn_of_failures(self, kind: type[BaseException] | None, *_: object) -> None:
        """Report parts that did not close after a start that failed: the error of the start comes first."""
        for error in self.not_closed if kind is not None else ():
            logger.warning("%s", error)
