"""Faults on purpose: the frames of a source, worse than they came.

Every frame draws its numbers from (seed, source, sensor, fault, index) alone: a fault on one sensor changes no other
sensor, adding one fault changes no other, and twice the noise is the same noise, twice as strong.
"""

from __future__ import annotations

import heapq
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from typing import Any

import numpy as np

from trailmark.config.host import DEFAULT_PLUGINS
from trailmark.errors import ConfigError, SourceError, SourceFailedError
from trailmark.failures import call_guarded, raise_failure
from trailmark.frames import Frame, SensorInfo
from trailmark.interfaces import Fault, Session
from trailmark.pipeline.instruments import counts_of

__all__ = ["Perturber"]


class Perturber:
    """Applies the faults of one source, each around the one before it.

    Parameters
    ----------
    source : str
        Its name.
    makers : mapping of str to callable
        What makes each fault, by its name, in the order in which they are applied; called once for each sensor.
    wanted : sequence of str or None
        The sensors that they befall; None: all that they can.

    Raises
    ------
    ConfigError
        From `start`, if a sensor is wanted that the source does not have, or if a fault, or an option of it, can befall
        none of them.
    """

    def __init__(self, source: str, makers: Mapping[str, Callable[[], Fault]], wanted: Sequence[str] | None) -> None:
        self._source = source
        self._makers = makers
        self._wanted = wanted
        self._chains: dict[str, list[_Seeded]] = {}
        self._first_s: float | None = None
        self._index: Counter[str] = Counter()

    def start(self, session: Session, sensors: Mapping[str, SensorInfo]) -> None:
        """Make and start the faults of each sensor.

        Parameters
        ----------
        session : Session
            The source's; nothing is drawn from its generator.
        sensors : mapping of str to SensorInfo
            The source's sensors, as they are called in the run.
        """
        self._first_s = None
        self._index.clear()
        befallen = self._befallen(sensors)
        self._chains = {name: [] for name in befallen}
        for fault_name, make in self._makers.items():
            made = {sensor: make() for sensor in befallen}
            fitting = {name: fault for name, fault in made.items() if _can_befall(fault, befallen[name])}
            if made and not fitting:
                wanted = f"sensors of kind {' or '.join(sorted(next(iter(made.values())).kinds))}"
                raise ConfigError(_idle_message(self._source, fault_name, wanted, befallen))
            self._refuse_idle_options(fault_name, fitting, befallen)
            for sensor, fault in fitting.items():
                seeded = _seeded(fault_name, fault, befallen[sensor], session)
                self._chains[sensor].append(seeded)
                call_guarded(self._fault_name(fault_name), "start", partial(_start, seeded, befallen[sensor], session))

    def _refuse_idle_options(
        self, fault_name: str, fitting: Mapping[str, Fault], befallen: Mapping[str, SensorInfo]
    ) -> None:
        """Refuse an option of a fault that would change none of the sensors."""
        idle = [
            call_guarded(self._fault_name(fault_name), "idle_options", partial(_idle_of, fault, befallen[sensor]))
            for sensor, fault in fitting.items()
        ]
        for option in idle[0] if idle else ():
            if all(option in others for others in idle):
                key = option if fault_name == DEFAULT_PLUGINS["fault"] else f"{fault_name}.{option}"
                raise ConfigError(_idle_message(self._source, key, idle[0][option], befallen))

    def close(self) -> None:
        """Close the faults. Any thread, twice."""
        with ExitStack() as closing:  # one that raises keeps no other from being closed
            for seeded in self._seeded():
                closing.callback(call_guarded, self._fault_name(seeded.name), "close", seeded.fault.close)

    def counters(self) -> dict[str, int]:
        """Return what the faults counted: ``perturb.dropped``, ``perturb.NAME.counter`` of others than the default."""
        found: Counter[str] = Counter()
        for seeded in self._seeded():
            prefix = "perturb" if seeded.name == DEFAULT_PLUGINS["fault"] else f"perturb.{seeded.name}"
            own = call_guarded(self._fault_name(seeded.name), "counters", partial(_counts_of, seeded.fault))
            found.update({f"{prefix}.{name}": n for name, n in own.items()})
        return dict(found)

    def believed(self, info: SensorInfo) -> SensorInfo:
        """Return a sensor as the run shall believe it to be."""
        for seeded in self._chains.get(info.name, ()):
            info = call_guarded(self._fault_name(seeded.name), "believed", partial(_believed, seeded.fault, info))
        return info

    def frames(self, frames: Iterator[Frame]) -> Iterator[Frame]:
        """Yield the frames that are left, in the order of their stamps.

        Raises
        ------
        SourceError
            If a fault raises, or gives a frame of another sensor or of an earlier stamp.
        """
        waiting: list[tuple[float, int, Frame]] = []
        order = count()
        for frame in frames:
            while waiting and waiting[0][0] <= frame.stamp_s:
                yield heapq.heappop(waiting)[2]
            left = self._perturb(frame)
            if left is not None and left.stamp_s > frame.stamp_s:
                heapq.heappush(waiting, (left.stamp_s, next(order), left))
            elif left is not None:
                yield left
        while waiting:
            yield heapq.heappop(waiting)[2]

    def _perturb(self, frame: Frame) -> Frame | None:
        """Return a frame as its sensor's faults leave it; None where it is lost."""
        chain = self._chains.get(frame.sensor)
        if chain is None:
            return frame
        self._first_s = frame.stamp_s if self._first_s is None else self._first_s
        index = self._index[frame.sensor]
        self._index[frame.sensor] += 1
        for seeded in chain:
            try:
                left = seeded.fault.apply(frame, seeded.rng(index), frame.stamp_s - self._first_s)
                if left is not None and not isinstance(left, Frame):
                    raise TypeError(f"it returned {type(left).__name__}, not a Frame")
            except BaseException as error:
                raise_failure(error, self._fault_name(seeded.name), "apply", kind=SourceFailedError)
            if left is None:
                return None
            if left.sensor != frame.sensor or left.stamp_s < frame.stamp_s:
                told = f"made {left.sensor!r} at {left.stamp_s:.6f} s of {frame.sensor!r} at {frame.stamp_s:.6f} s"
                raise SourceError(f"{self._fault_name(seeded.name)} {told}")
            frame = left
        return frame

    def _fault_name(self, fault: str) -> str:
        return f"fault {fault!r} of source {self._source!r}"

    def _befallen(self, sensors: Mapping[str, SensorInfo]) -> dict[str, SensorInfo]:
        for name in self._wanted or ():
            if name not in sensors:
                raise ConfigError(
                    f"sources.{self._source}.perturb.sensors: the source has no sensor {name!r}; it has"
                    f" {', '.join(sensors)}"
                )
        return {name: info for name, info in sensors.items() if self._wanted is None or name in self._wanted}

    def _seeded(self) -> Iterator[_Seeded]:
        return (seeded for chain in self._chains.values() for seeded in chain)


@dataclass(frozen=True, slots=True, eq=False)
class _Seeded:
    """A fault of one sensor at work, and where its random numbers come from."""

    name: str
    fault: Fault
    entropy: Any
    key: tuple[int, ...]

    def rng(self, *index: int) -> np.random.Generator:
        """Return the generator of one frame; without an index, that of the run."""
        return np.random.default_rng(np.random.SeedSequence(self.entropy, spawn_key=(*self.key, *index)))


def _believed(fault: Fault, info: SensorInfo) -> SensorInfo:
    believed = fault.believed(info)
    if not isinstance(believed, SensorInfo):
        raise TypeError(f"it returned {type(believed).__name__}, not a SensorInfo")
    return believed


def _idle_of(fault: Fault, info: SensorInfo) -> Mapping[str, str]:
    idle: object = fault.idle_options(info)
    if not isinstance(idle, Mapping) or not all(isinstance(text, str) for item in idle.items() for text in item):
        raise TypeError(f"it returned {idle!r}, not a mapping of str to str")
    return idle


def _counts_of(fault: Fault) -> dict[str, int]:
    return counts_of(fault.counters())


def _can_befall(fault: Fault, info: SensorInfo) -> bool:
    return not fault.kinds or info.kind in fault.kinds


def _idle_message(source: str, key: str, wanted: str, sensors: Mapping[str, SensorInfo]) -> str:
    have = ", ".join(f"{sensor} ({info.kind})" for sensor, info in sensors.items())
    return f"sources.{source}.perturb.{key}: befalls {wanted}, not {have}"


def _seeded(name: str, fault: Fault, info: SensorInfo, session: Session) -> _Seeded:
    """Return a fault of one sensor; it draws from a branch of the source's seed, and not from the source's."""
    seeds: Any = session.rng.bit_generator.seed_seq
    branch = b"perturb" if name == DEFAULT_PLUGINS["fault"] else f"perturb {name}".encode()
    return _Seeded(name, fault, seeds.entropy, (*seeds.spawn_key, zlib.crc32(branch), zlib.crc32(info.name.encode())))


def _start(seeded: _Seeded, info: SensorInfo, session: Session) -> None:
    seeded.fault.start(replace(session, name=seeded.name, sensors={info.name: info}, rng=seeded.rng()))
