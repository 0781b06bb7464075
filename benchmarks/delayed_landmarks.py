"""A one-file plugin for ``benchmarks/fusion.py``: fixes that are about their frame, but arrive seconds later.

An ``async`` localizer is busy while it works and leaves pictures out; a slow radio or a server delays everything and
leaves nothing out. This is the second kind.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING

from pydantic import Field
from trailmark_mrclam.config import RangeBearingConfig
from trailmark_mrclam.localizer import RangeBearing

from trailmark import hookimpl
from trailmark.config import Sensor
from trailmark.estimates import Belief, Estimate
from trailmark.frames import Frame
from trailmark.interfaces import Session

if TYPE_CHECKING:
    from trailmark.plugins import Registry


class DelayedConfig(RangeBearingConfig):
    """Landmarks whose fixes are held back."""

    clock: Sensor["odometry"]  # noqa: F821, UP037
    """A sensor whose frames say what time it is."""
    delay_s: float = Field(2.0, gt=0)
    """How late fixes arrive [s]."""


class DelayedRangeBearing(RangeBearing):
    """Looks when it is asked, and answers later."""

    config: DelayedConfig

    def start(self, session: Session) -> None:
        """Hold nothing yet."""
        super().start(session)
        self._held: deque[tuple[float, Sequence[Estimate]]] = deque()

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return what is due."""
        if frame.sensor == self.config.sightings:
            self._held.append((frame.stamp_s + self.config.delay_s, super().observe(frame, belief)))
        due: list[Estimate] = []
        while self._held and self._held[0][0] <= frame.stamp_s:
            due += self._held.popleft()[1]
        return due


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register the localizer."""
    registry.localizer(
        "delayed_range_bearing", ":DelayedRangeBearing", config=":DelayedConfig", summary="Late fixes", gives=("fix",)
    )
