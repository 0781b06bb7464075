"""What a run is measured with: its clock, counts of everything that happened, and how long each stage took."""

from __future__ import annotations

import sys
from array import array
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field
from numbers import Integral

import numpy as np
import numpy.typing as npt

from trailmark.clock import RunClock

__all__ = [
    "EXACT_CALLS",
    "LOCALIZER_COUNTS",
    "SOURCE_COUNTS",
    "Counters",
    "Instruments",
    "StageTimes",
    "counts_of",
    "peak_rss_mb",
]

#: A stage with no more calls than this has exact percentiles; beyond, they are within 0.6 %.
EXACT_CALLS = 1 << 16

#: What the pipeline counts of each source and of each localizer.
SOURCE_COUNTS = frozenset({"frames", "repeated", "skipped", "dropped"})
LOCALIZER_COUNTS = frozenset(
    {"accepted", "gated", "late", "refused", "unused", "lost", "overwritten", "given_up", "disabled"}
)

_PER_OCTAVE = 64  # a bin is 1.1 % wide
_N_BINS = 48 * _PER_OCTAVE  # up to 2**48 ns, three days
_PERCENTILES = (50.0, 95.0, 99.0)


class Counters(Counter[str]):
    """Counts by dotted name, such as ``localizer.floor.late``; nothing is dropped without one."""

    def add(self, name: str, n: int = 1) -> None:
        """Count `n` more of something."""
        self[name] += n

    def merged(self, others: Mapping[str, Mapping[str, int]]) -> dict[str, int]:
        """Return all counts, sorted, with what parts counted themselves below their own prefix."""
        counts = Counter(self)
        for prefix, own in others.items():
            counts.update({f"{prefix}.{name}": n for name, n in own.items()})
        return dict(sorted(counts.items()))


def counts_of(counted: object, taken: AbstractSet[str] = frozenset()) -> dict[str, int]:
    """Return what a part has counted itself, by name.

    Parameters
    ----------
    counted : object
        The answer of `Part.counters`.
    taken : set of str
        What the pipeline counts of such a part: under such a name the part's own count is ``own.NAME``.

    Raises
    ------
    TypeError
        If it is no mapping of names to whole numbers.
    """
    if not isinstance(counted, Mapping):
        raise TypeError(f"it returned {type(counted).__name__}, not counts by name")
    for name, n in counted.items():
        if not isinstance(name, str) or not isinstance(n, Integral):
            raise TypeError(f"it returned {n!r} for {name!r}, not a whole number for a name")
    return {f"own.{name}" if name in taken else name: int(n) for name, n in counted.items()}


class StageTimes:
    """Durations of calls by stage: ``localizer.floor``, ``estimator``, ``sink.jsonl`` ...

    Exactly for the first calls, in a histogram once there are many: a stage needs at most half a megabyte, however
    long the run. The hot path appends to `stage` itself::

        times = stage_times.stage("estimator")
        began_ns = perf_counter_ns()
        ...
        times.append(perf_counter_ns() - began_ns)
    """

    def __init__(self) -> None:
        self._ns: dict[str, array[int]] = {}
        self._folded: defaultdict[str, _Histogram] = defaultdict(_Histogram)

    def stage(self, name: str) -> array[int]:
        """Return the latest durations of a stage, to append to [ns]."""
        return self._ns.setdefault(name, array("q"))

    def fold(self) -> None:
        """Move the durations of stages with many calls into histograms; to be called every few thousand frames."""
        for name, ns in self._ns.items():
            if len(ns) > EXACT_CALLS:
                self._folded[name].add(_empty_buffer(ns))

    def table(self) -> dict[str, dict[str, float]]:
        """Return n, mean, median, tail and maximum of each stage that ran, by name [ms]."""
        rows = {}
        for name, ns in sorted(self._ns.items()):
            if name in self._folded:
                self._folded[name].add(_empty_buffer(ns))
                rows[name] = self._folded[name].row()
            elif ns:
                rows[name] = _row(np.asarray(ns, dtype=np.float64) / 1e6)
        return rows


class _Histogram:
    """Counts of durations in bins of equal ratio, with the exact sum and maximum."""

    def __init__(self) -> None:
        self._counts = np.zeros(_N_BINS, np.int64)
        self._sum_ns = 0
        self._max_ns = 0

    def add(self, ns: npt.NDArray[np.int64]) -> None:
        """Count durations."""
        if ns.size == 0:
            return
        bins = np.floor(_PER_OCTAVE * np.log2(np.maximum(ns, 1))).astype(np.int64)
        self._counts += np.bincount(np.minimum(bins, _N_BINS - 1), minlength=_N_BINS)
        self._sum_ns += int(ns.sum())
        self._max_ns = max(self._max_ns, int(ns.max()))

    def row(self) -> dict[str, float]:
        """Return the figures of all durations [ms]."""
        up_to = np.cumsum(self._counts)
        n = int(up_to[-1])
        bins = np.searchsorted(up_to, np.array(_PERCENTILES) / 100.0 * n)
        middles_ms = np.minimum(np.exp2((bins + 0.5) / _PER_OCTAVE), self._max_ns) / 1e6
        return _figures(n, self._sum_ns / n / 1e6, middles_ms.tolist(), self._max_ns / 1e6)


@dataclass(frozen=True, slots=True, eq=False)
class Instruments:
    """What a run is measured with."""

    clock: RunClock
    counters: Counters = field(default_factory=Counters)
    times: StageTimes = field(default_factory=StageTimes)
    patience_s: float = 120.0


def _empty_buffer(ns: array[int]) -> npt.NDArray[np.int64]:
    """Empty an array to which other threads may append meanwhile, and return what was in it."""
    taken = ns[:]
    del ns[: len(taken)]
    return np.asarray(taken, dtype=np.int64)


def peak_rss_mb() -> float | None:
    """Return the largest memory that this process has used; None where the system does not say [MB]."""
    try:
        import resource
    except ImportError:  # not on Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / (1e6 if sys.platform == "darwin" else 1e3), 1)


def _row(ms: npt.NDArray[np.float64]) -> dict[str, float]:
    return _figures(len(ms), float(ms.mean()), np.percentile(ms, _PERCENTILES).tolist(), float(ms.max()))


def _figures(n: int, mean_ms: float, percentiles_ms: Sequence[float], max_ms: float) -> dict[str, float]:
    p50, p95, p99 = percentiles_ms
    row = {"mean_ms": mean_ms, "p50_ms": p50, "p95_ms": p95, "p99_ms": p99, "max_ms": max_ms}
    return {"n": n} | {name: round(value, 6) for name, value in row.items()}
