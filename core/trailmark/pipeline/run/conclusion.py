"""What is left of a run: its sinks and folder, its result as it stands, and the steps of its end.

No step that fails keeps the others from being made.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING, TypeVar

from trailmark.errors import RunError, TrailmarkError
from trailmark.interfaces import RunEnd, Sink
from trailmark.interruption import CLOSE_S, FINISH_S, KEEP_S, STOP_S, ending_signal, reason_of, shielded
from trailmark.pipeline.instruments import Instruments, peak_rss_mb
from trailmark.pipeline.outputs.fanout import SinkFanout
from trailmark.pipeline.outputs.result import RunResult, Status
from trailmark.pipeline.outputs.tracks import Tracks
from trailmark.pipeline.sources.stream import ground_truth_of, outlines_of
from trailmark.pipeline.startup import RunningParts

if TYPE_CHECKING:
    from trailmark.pipeline.outputs.recorder import Recorder

__all__ = ["Conclusion"]

logger = logging.getLogger(__name__)

_T = TypeVar("_T")


class Conclusion:
    """Concludes a run: collects what becomes of it, and takes the steps of its end, once.

    Parameters
    ----------
    running : RunningParts
        The parts, started.
    instruments : Instruments
        Counts and times of the run.
    recorder : Recorder or None
        Writes the run's folder.

    Attributes
    ----------
    result : RunResult or None
        How the run ended, once it has.
    """

    def __init__(self, running: RunningParts, instruments: Instruments, recorder: Recorder | None) -> None:
        self.result: RunResult | None = None
        self._running = running
        self._recorder = recorder
        self._counters, self._times = instruments.counters, instruments.times
        self._tracks = Tracks((localizer.name for localizer in running.localizers), running.session)
        self._sinks = SinkFanout({}, instruments.times)
        self._began_s = perf_counter()

    def open_sinks(self) -> SinkFanout:
        """Open the run's folder and return all sinks: those of the config, the trajectories, the recorder."""
        parts = self._running.parts
        sinks: dict[str, Sink] = {**parts.sinks, "tracks": self._tracks}
        if self._recorder is not None:
            self._recorder.open(parts.document, self._running.sensors)
            sinks["recorder"] = self._recorder
        self._sinks = SinkFanout(sinks, self._times)
        self._began_s = perf_counter()
        return self._sinks

    def counters(self) -> dict[str, int]:
        """Return what has been counted so far; without what a part that fails at it has counted."""
        own: dict[str, Mapping[str, int]] = {}
        for prefix, ask in self._running.own_counters():
            with suppress(TrailmarkError):  # the end of the run says it
                own[prefix] = ask()
        return self._counters.merged(own)

    def result_as_it_stands(self, reason: str) -> RunResult:
        """Return the result for a run that cannot end in order; its parts are not asked for counts, one may hang."""
        result = self._result_of("interrupted", reason, self._counters.merged({}))
        return replace(result, ground_truth=ground_truth_of(self._running.parts.sources))

    def take_steps(
        self,
        status: Status,
        reason: str,
        *,
        finish: Callable[[], None],
        close_events: Callable[[], None],
        on_end: Callable[[RunResult], None],
    ) -> None:
        """Take the steps of the end; none that hangs is waited for when the program was told to end.

        Parameters
        ----------
        status, reason
            How the loop has ended.
        finish : callable
            Finishes what is in work; not called if the run has failed.
        close_events : callable
            Lets go what the loop went on with.
        on_end : callable
            Called with the result, when everything is written and closed.

        Raises
        ------
        BaseException
            What the first step that failed has raised, when all are taken.
        """
        running = self._running
        ending = Ending(status, reason, self._spared_parts())
        if (control := running.control) is not None:
            ending.attempt(lambda: control.stop_for_good(reason or status), STOP_S)
        if status != "failed":
            ending.attempt(finish, FINISH_S)
        own = {prefix: ending.attempt(ask) or {} for prefix, ask in running.own_counters()}
        truth = ending.attempt(lambda: ground_truth_of(running.parts.sources), KEEP_S)
        outlines = ending.attempt(lambda: outlines_of(running.parts.sources), KEEP_S)
        with shielded(KEEP_S):
            result = self._result_of(ending.status, ending.reason, self._counters.merged(own))
            self.result = result = replace(result, ground_truth=truth, outlines=outlines)
        for tell in self._sinks.on_end(RunEnd(ending.status, ending.reason, result.counters)):
            ending.attempt(tell)
        self._write(ending, result)
        ending.attempt(running.closing.close, math.inf)
        for error in running.not_closed:
            ending.fail(error)
        ending.attempt(close_events)
        if ending.status != result.status:  # what failed while the end was written, and at closing
            self.result = result = replace(result, status=ending.status, reason=ending.reason)
            self._write_status(ending, result)
        on_end(result)
        if ending.failure is not None:
            raise ending.failure

    def _write(self, ending: Ending, result: RunResult) -> None:
        """Write the run's folder, if there is one."""
        if (recorder := self._recorder) is not None:
            ending.attempt(lambda: recorder.write(result), KEEP_S)

    def _write_status(self, ending: Ending, result: RunResult) -> None:
        if (recorder := self._recorder) is not None:
            ending.attempt(lambda: recorder.write_status(result), KEEP_S)

    def _spared_parts(self) -> frozenset[str]:
        """Return the localizers whose failure ends no run."""
        parts = self._running.parts.localizers
        return frozenset(f"localizer {part.name!r}" for part in parts if part.options.on_error == "disable")

    def _result_of(self, status: Status, reason: str, counters: Mapping[str, int]) -> RunResult:
        return RunResult(
            status=status,
            reason=reason,
            counters=counters,
            trajectories=self._tracks.trajectories(),
            timing={
                "stages": self._times.table(),
                "peak_rss_mb": peak_rss_mb(),
                "frames": self._counters["frames"],
                "wall_s": round(perf_counter() - self._began_s, 6),
            },
            folder=None if self._recorder is None else self._recorder.folder,
        )


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
