"""A localizer at work: called, timed, guarded, and told what its last call took."""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice
from numbers import Real
from time import perf_counter_ns
from types import MappingProxyType
from typing import TYPE_CHECKING, NoReturn

from trailmark.errors import RunError, StoreFailedError, TrailmarkError
from trailmark.estimates import Belief, Estimate, Fix, Lost, Motion, PathOffset
from trailmark.failures import raise_failure
from trailmark.frames import Frame, SensorInfo
from trailmark.interfaces import Localizer, Session
from trailmark.pipeline.instruments import Instruments
from trailmark.pipeline.localizers.correcting import with_corrected_motions
from trailmark.pipeline.parts import LocalizerPart
from trailmark.values import quick_dataclass

if TYPE_CHECKING:
    from trailmark.worker import PendingCall, Workers

__all__ = [
    "LONGEST_REASON",
    "LocalizerFailedError",
    "LocalizerRunner",
    "ObserveResult",
    "SyncRunner",
    "beginning_early",
    "new_runner",
]

logger = logging.getLogger(__name__)

# One that has begun and is not asked for is waited for so long [s].
_PATIENCE_S = 5.0

#: More estimates about one frame are a mistake, and each costs time.
_MOST_ESTIMATES = 1000

#: What is written for each estimate is for people to read: more of it is cut, and that is said.
_MOST_DETAILS = 1000
#: So are words: letters.
LONGEST_REASON = 1000

# Of these types nearly all details are; the general question takes longer.
_PLAIN_MAPPINGS = (MappingProxyType, dict)
# What an answer may be. As tuples: a union would be made anew at every frame.
_SEQUENCES, _TEXTS, _ESTIMATES = (tuple, list, Sequence), (str, bytes), (Motion, Fix, PathOffset, Lost)


class LocalizerFailedError(RunError):
    """A localizer raised, or returned what is no sequence of estimates."""


@quick_dataclass(frozen=True, slots=True, eq=False)
class ObserveResult:
    """What a localizer said about a frame.

    Attributes
    ----------
    arrived_s, frame_s : float
        When it is known to the run, and the frame's stamp [s].
    estimates : sequence of Estimate
        What it said; not empty.
    """

    arrived_s: float
    frame_s: float
    estimates: Sequence[Estimate]


class LocalizerRunner(ABC):
    """Runs one localizer: frames are submitted, results polled.

    Parameters
    ----------
    part : LocalizerPart
        The localizer.
    sensors : mapping of str to SensorInfo
        The sensors of the run.
    times : array of int
        Takes the duration of every call [ns].
    is_realtime : bool
        Whether the localizer is told measured durations, or modelled ones.
    """

    def __init__(
        self, part: LocalizerPart, sensors: Mapping[str, SensorInfo], times: array[int], is_realtime: bool
    ) -> None:
        self.part = part
        self.name = part.name
        self.uses_belief = part.localizer.uses_belief
        self.looks_at_frames = part.localizer.looks_at_frames
        self.begins_early = part.localizer.begins_early and not self.uses_belief
        self._localizer = part.localizer
        self._times = times
        self._is_realtime = is_realtime
        self._last_latency_s = 0.0
        self._has_been_cut = False
        kinds = {sensors[name].kind for name in part.sensors if name in sensors}
        self._has_snapshots = bool(kinds & {"image", "rgbd", "scan"})
        self._fixed_latency_s = part.options.latency_s
        has_model = type(part.localizer).latency_s is not Localizer.latency_s
        self._takes_time = has_model or self._fixed_latency_s is not None

    def start(self, session: Session) -> None:
        """Start the localizer."""
        self._localizer.start(session)

    def last_latency_s(self) -> float:
        """Return the duration of the localizer's last call: measured in realtime, modelled in step [s]."""
        return self._last_latency_s

    @abstractmethod
    def submit(self, frame: Frame, belief: Belief) -> Sequence[ObserveResult]:
        """Hand over a frame; returns what is known at once.

        Raises
        ------
        LocalizerFailedError
            If the localizer has failed.
        """

    def poll(self, now_s: float) -> Sequence[ObserveResult]:
        """Return the results that have arrived until `now_s`, each once.

        Raises
        ------
        LocalizerFailedError
            If the localizer has failed, once the results from before are returned.
        """
        return ()

    def drain(self) -> Sequence[ObserveResult]:
        """Return the result that is still in work; frames that wait are given up and counted."""
        return ()

    def close(self) -> None:  # noqa: B027  (most have nothing to stop)
        """Stop working."""

    def _observe(self, frame: Frame, belief: Belief) -> tuple[Sequence[Estimate], float]:
        """Return what the localizer says, and how long that takes by its model [s].

        Raises
        ------
        LocalizerFailedError
            If it raises or returns what is no sequence of estimates; the message names it and the frame.
        """
        began_ns = perf_counter_ns()
        try:
            estimates = self._checked_estimates(self._localizer.observe(frame, belief))
            if self.part.options.correct is not None:
                estimates = with_corrected_motions(estimates, self.part.options.correct)
        except BaseException as error:
            self._raise_failure("observe", frame, error)
        elapsed_ns = perf_counter_ns() - began_ns
        self._times.append(elapsed_ns)
        modelled_s = self._modelled_latency_s(frame) if self._takes_time else 0.0
        self._last_latency_s = elapsed_ns * 1e-9 if self._is_realtime else modelled_s
        return estimates, modelled_s

    def _checked_estimates(self, answer: object) -> Sequence[Estimate]:
        """Return what `Localizer.observe` has returned, if it is a sequence of estimates; what nobody reads is cut."""
        if type(answer) is tuple and not answer:  # nearly all answers of most
            return ()
        if not isinstance(answer, _SEQUENCES) or isinstance(answer, _TEXTS):
            raise TypeError(f"it returned {type(answer).__name__}, not a sequence of estimates")
        estimates = tuple(islice(answer, _MOST_ESTIMATES + 1))
        if len(estimates) > _MOST_ESTIMATES:
            raise ValueError(f"it returned {len(answer)} estimates about one frame, more than {_MOST_ESTIMATES}")
        says_too_much = False
        for estimate in estimates:
            if not isinstance(estimate, _ESTIMATES):
                raise TypeError(f"it returned {type(estimate).__name__} in its sequence of estimates")
            if type(estimate.stamp_s) is not float and not isinstance(estimate.stamp_s, Real):
                raise TypeError(f"it returned an estimate with the stamp {estimate.stamp_s!r}, not a number")
            details = estimate.details
            if type(details) not in _PLAIN_MAPPINGS and not isinstance(details, Mapping):
                raise TypeError(f"it returned an estimate whose details are {type(details).__name__}, no mapping")
            if isinstance(estimate, Lost):
                if not isinstance(estimate.reason, str):
                    raise TypeError(f"it returned a Lost whose reason is {type(estimate.reason).__name__}, not words")
                says_too_much |= len(estimate.reason) > LONGEST_REASON
            says_too_much |= len(details) > _MOST_DETAILS
        return self._cut(estimates) if says_too_much else estimates

    def _cut(self, estimates: Sequence[Estimate]) -> Sequence[Estimate]:
        """Return estimates without what nobody reads, and say so once."""
        if not self._has_been_cut:
            self._has_been_cut = True
            logger.warning(
                "localizer %r says too much about an estimate (%d details, a reason of %d letters): %d details and %d"
                " letters of each are kept",
                self.name,
                max(len(estimate.details) for estimate in estimates),
                max(len(estimate.reason) if isinstance(estimate, Lost) else 0 for estimate in estimates),
                _MOST_DETAILS,
                LONGEST_REASON,
            )
        return tuple(_shortened(estimate) for estimate in estimates)

    def _modelled_latency_s(self, frame: Frame) -> float:
        """Return the latency in step pace; of a localizer that looks at pictures, only pictures cost time."""
        if self._fixed_latency_s is None:
            try:
                latency_s = float(self._localizer.latency_s() or 0.0)
                if not 0.0 <= latency_s < math.inf:
                    raise ValueError(f"{latency_s} is no duration")
            except BaseException as error:
                self._raise_failure("latency_s", frame, error)
            return latency_s
        return self._fixed_latency_s if frame.payload.is_snapshot or not self._has_snapshots else 0.0

    def _raise_failure(self, method: str, frame: Frame, error: BaseException) -> NoReturn:
        where = f"{method} at the frame of {frame.sensor!r} at {frame.stamp_s:.6f} s"
        raise_failure(error, f"localizer {self.name!r}", where, kind=LocalizerFailedError, keeps=StoreFailedError)


def _shortened(estimate: Estimate) -> Estimate:
    if isinstance(estimate, Lost):
        estimate = replace(estimate, reason=estimate.reason[:LONGEST_REASON])
    return replace(estimate, details=dict(islice(estimate.details.items(), _MOST_DETAILS)))


class SyncRunner(LocalizerRunner):
    """Runs a localizer that is waited for.

    In step pace one that asks for it (`Localizer.begins_early`) needs nothing but the frame: it begins before its
    turn, in a thread, while the localizers before it are at work. What it says is taken at its turn, and is the same.
    """

    _workers: Workers | None = None
    _begun: PendingCall[tuple[Sequence[Estimate], float]] | None = None

    def begin(self, frame: Frame) -> None:
        """Ask the localizer in a thread; `submit` of the same frame waits for its answer."""
        if self._workers is None:
            from trailmark.worker import Workers  # of no use to most runs

            self._workers = Workers(f"localizer {self.name}")
        self._begun = self._workers.submit(partial(self._observe, frame, Belief(frame.stamp_s)))

    def submit(self, frame: Frame, belief: Belief) -> Sequence[ObserveResult]:
        """Ask the localizer, or wait for it if it has begun; its result is there at once."""
        begun, self._begun = self._begun, None
        estimates, _ = self._observe(frame, belief) if begun is None else self._answer_of(begun, frame)
        return (ObserveResult(frame.stamp_s, frame.stamp_s, estimates),) if estimates else ()

    def _answer_of(
        self, begun: PendingCall[tuple[Sequence[Estimate], float]], frame: Frame
    ) -> tuple[Sequence[Estimate], float]:
        try:
            return begun.result()
        except TrailmarkError:  # it has its words already
            raise
        except BaseException as error:  # it does not come back, or Ctrl-C
            self._raise_failure("observe", frame, error)

    def drain(self) -> Sequence[ObserveResult]:
        """Wait for what has begun and was not asked for: the loop has ended before its turn."""
        begun, self._begun = self._begun, None
        if begun is not None and not begun.wait(_PATIENCE_S):
            part = f"localizer {self.name!r}"
            raise LocalizerFailedError(f"{part} has not come back {_PATIENCE_S:g} s after the last frame", part)
        return ()

    def close(self) -> None:
        """End the thread, if there is one."""
        if self._workers is not None:
            self._workers.close()


def beginning_early(runners: Sequence[LocalizerRunner], is_realtime: bool) -> tuple[SyncRunner, ...]:
    """Return those of a sensor's localizers that may begin with a frame while the first of them is at work.

    Parameters
    ----------
    runners : sequence of LocalizerRunner
        That subscribe to the sensor, in the order in which they are asked.
    is_realtime : bool
        In real time every localizer may be given a thread by its options (``async``); none is taken here.
    """
    if is_realtime or len(runners) < 2:
        return ()
    from trailmark.worker import n_cores

    if n_cores() < 2:
        return ()
    return tuple(runner for runner in runners[1:] if isinstance(runner, SyncRunner) and runner.begins_early)


def new_runner(
    part: LocalizerPart, sensors: Mapping[str, SensorInfo], is_realtime: bool, instruments: Instruments
) -> LocalizerRunner:
    """Return what runs a localizer: waited for, or beside the run if its options say ``async`` or ``delay_ms``.

    Parameters
    ----------
    part : LocalizerPart
        The localizer.
    sensors : mapping of str to SensorInfo
        The sensors of the run.
    is_realtime : bool
        Whether what runs beside the run has a thread, or a modelled latency.
    instruments : Instruments
        Of the run.
    """
    times = instruments.times.stage(f"localizer.{part.name}")
    if not part.options.answers_later or (is_realtime and not part.options.is_async):
        return SyncRunner(part, sensors, times, is_realtime)
    if is_realtime:
        from trailmark.pipeline.localizers.threaded import ThreadedRunner

        return ThreadedRunner(part, sensors, times, instruments)
    from trailmark.pipeline.localizers.modelled import ModelledRunner

    return ModelledRunner(part, sensors, times, instruments.counters)
