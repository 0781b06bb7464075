"""Starting parts one by one: timed, guarded, with a session each; and closing them again, the last first."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from time import perf_counter_ns
from typing import Any

from trailmark.errors import RunError, TrailmarkError
from trailmark.frames import SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Mode, Part, Session
from trailmark.paths import Path
from trailmark.pipeline.seeds import part_rng
from trailmark.pipeline.timing import StageTimes

__all__ = ["Sessions", "Starter", "guarded"]

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class Sessions:
    """What every part of a run is told alike; `of` makes the session of one part."""

    mode: Mode
    seed: int
    path: Path | None = None
    start_pose: Pose2 | None = None
    sensors: Mapping[str, SensorInfo] = field(default_factory=dict)

    def of(self, kind: str, name: str, **more: Any) -> Session:
        """Return the session of a part, with `more` that only this one is told."""
        common: dict[str, Any] = {
            "name": name,
            "mode": self.mode,
            "sensors": self.sensors,
            "path": self.path,
            "start_pose": self.start_pose,
            "rng": part_rng(self.seed, kind, name),
        }
        return Session(**(common | more))


class Starter:
    """Starts parts and remembers what is to be closed."""

    def __init__(self, times: StageTimes) -> None:
        self._times = times
        self._closing: list[tuple[str, Callable[[], None]]] = []

    def start(self, kind: str, name: str, part: Part, session: Session) -> None:
        """Start a part; how long it took is the stage ``start.KIND.NAME``, or ``start.KIND`` of the only one.

        Raises
        ------
        RunError
            If it raises what is no error of Trailmark.
        """
        self.run(kind, name, lambda: part.start(session), part.close)

    def run(self, kind: str, name: str, start: Callable[[], None], close: Callable[[], None]) -> None:
        """Start something that is no part by itself."""
        part = kind if name == kind else f"{kind} {name!r}"
        self.on_close(part, close)
        began_ns = perf_counter_ns()
        guarded(part, "could not start", start)
        stage = f"start.{kind}" if name == kind else f"start.{kind}.{name}"
        self._times.stage(stage).append(perf_counter_ns() - began_ns)

    def on_close(self, what: str, close: Callable[[], None]) -> None:
        """Remember to close something."""
        self._closing.append((what, close))

    def close(self) -> None:
        """Close everything, the last first; what fails to close is a warning."""
        while self._closing:
            what, close = self._closing.pop()
            try:
                close()
            except Exception as error:
                logger.warning("%s did not close: %s: %s", what, type(error).__name__, error)


def guarded(part: str, what: str, call: Callable[[], None]) -> None:
    """Call, and turn what is no error of Trailmark into a `RunError` that names the part."""
    try:
        call()
    except TrailmarkError:
        raise
    except Exception as error:
        raise RunError(f"{part} {what}: {type(error).__name__}: {error}", part) from error
