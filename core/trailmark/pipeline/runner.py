"""The loop of a run: what happens at a frame, in which order."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Generator, Sequence
from functools import partial

from trailmark.commands import Stop
from trailmark.errors import RunError
from trailmark.frames import Frame
from trailmark.pipeline.applying import Applying
from trailmark.pipeline.merging import merged
from trailmark.pipeline.observing import Answer, Asked
from trailmark.pipeline.pacing import Event, held_to_stamps, live
from trailmark.pipeline.result import Status
from trailmark.pipeline.rig import Rig
from trailmark.pipeline.steps import Step, Told
from trailmark.pipeline.telling import Telling

__all__ = ["Runner"]

logger = logging.getLogger(__name__)


class Runner:
    """Works on frames with the parts of a rig.

    At each frame: results that are due are applied; the localizers that subscribe are asked in the order of the
    config, each with the belief at the frame's stamp, and its estimates are applied before the next is asked; in
    teach a waypoint is laid; the controller is asked, if it is time.

    Parameters
    ----------
    rig : Rig
        Started parts.
    telling : Telling
        Tells the sinks.
    """

    def __init__(self, rig: Rig, telling: Telling) -> None:
        self._rig = rig
        self._telling = telling
        self._applying = Applying(rig.plan, rig.counters, rig.times, telling)
        self._asked = list(rig.asked)
        self.n_frames = 0

    def events(self) -> Generator[Event]:
        """Yield the frames of the sources and the controller's ticks, as the pace says."""
        rig, plan = self._rig, self._rig.plan
        if not plan.is_realtime:
            return merged(plan.feeds)
        if plan.is_live:
            return live(plan.feeds, rig.clock, lambda: rig.control.due_s, rig.counters)
        if rig.robot is not None:  # simulated: when its frame is there, it has moved on already
            return held_to_stamps(merged(plan.feeds), rig.clock, lambda: math.inf)
        return held_to_stamps(merged(plan.feeds), rig.clock, lambda: rig.control.due_s)

    def work(self, event: Event) -> Step:
        """Take a frame through all parts; at a tick, ask only the controller."""
        now_s = event.stamp_s
        told: list[Told] = []
        for asked in self._beside():
            told += self._apply(asked, partial(asked.arrived, now_s))
        frame = event if isinstance(event, Frame) else None
        if frame is not None:
            told += self._observe(frame)
        belief = self._applying.belief(now_s)
        if frame is not None:
            self._telling.belief(belief)
            if self._rig.place.teaching is not None:
                self._rig.place.teaching.on_belief(belief)
        command = self._rig.control.step(belief)
        if command is not None:
            self._telling.command(now_s, command)
        return Step(now_s, frame, belief, tuple(told), command)

    def ends_with(self, step: Step) -> tuple[Status, str] | None:
        """Return status and reason if the run is over with this step."""
        if isinstance(step.command, Stop):
            if step.command.done:
                return "done", step.command.reason
            if self._rig.control.has_given_up(step.stamp_s):
                return "stopped", step.command.reason
        return None

    def finish(self) -> None:
        """Apply what is still in work; in teach, end the path and let the localizers finish."""
        for asked in self._beside():
            self._apply(asked, asked.finish)
            self._apply(asked, partial(asked.arrived, math.inf))
        place = self._rig.place
        if place.teaching is not None:
            place.teaching.end(self._applying.belief())
            place.finish_teaching([asked.planned for asked in self._asked])

    def _observe(self, frame: Frame) -> list[Told]:
        self.n_frames += 1
        self._rig.counters.add("frames")
        self._telling.frame(frame)
        told: list[Told] = []
        for asked in tuple(self._asked):
            if frame.sensor in asked.planned.sensors:
                belief = self._applying.belief(frame.stamp_s)
                told += self._apply(asked, partial(asked.take, frame, belief))
        return told

    def _beside(self) -> list[Asked]:
        return [asked for asked in self._asked if asked.planned.is_async]

    def _apply(self, asked: Asked, answer: Callable[[], Sequence[Answer]]) -> list[Told]:
        """Apply what a localizer answers; if it raises, end the run or switch it off, as the config says."""
        try:
            answers = answer()
        except RunError as error:
            if asked.planned.on_error == "fail":
                raise
            self._switch_off(asked, error)
            return []
        return self._applying.apply(asked.planned, answers) if answers else []

    def _switch_off(self, asked: Asked, error: RunError) -> None:
        name = asked.planned.name
        logger.warning("%s; it is switched off (on_error: disable)", error)
        self._asked.remove(asked)
        self._rig.counters.add(f"localizer.{name}.disabled")
        self._applying.health[name] = f"switched off: {error}"
        asked.close()
