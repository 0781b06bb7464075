"""How long each stage took: every call is kept, so percentiles are exact."""

from __future__ import annotations

import sys
from array import array
from typing import Any

import numpy as np

__all__ = ["StageTimes", "peak_rss_mb"]


class StageTimes:
    """Durations of calls by stage: ``localizer.floor``, ``estimator``, ``sink.jsonl`` ...

    A call costs 8 bytes: a day of six stages at 70 Hz is 290 MB. The hot path appends to `stage` itself::

        times = stage_times.stage("estimator")
        began_ns = perf_counter_ns()
        ...
        times.append(perf_counter_ns() - began_ns)
    """

    def __init__(self) -> None:
        self._ns: dict[str, array[int]] = {}

    def stage(self, name: str) -> array[int]:
        """Return the durations of a stage, to append to [ns]."""
        return self._ns.setdefault(name, array("q"))

    def table(self) -> dict[str, dict[str, float]]:
        """Return n, mean, median, tail and maximum of each stage that ran, by name [ms]."""
        return {name: _row(np.asarray(ns, dtype=np.float64) / 1e6) for name, ns in sorted(self._ns.items()) if ns}


def peak_rss_mb() -> float | None:
    """Return the largest memory that this process has used; None where the system does not say [MB]."""
    try:
        import resource
    except ImportError:  # not on Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / (1e6 if sys.platform == "darwin" else 1e3), 1)


def _row(ms: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, float]:
    p50, p95, p99 = np.percentile(ms, [50, 95, 99]).tolist()
    row = {"mean_ms": float(ms.mean()), "p50_ms": p50, "p95_ms": p95, "p99_ms": p99, "max_ms": float(ms.max())}
    return {"n": len(ms)} | {name: round(value, 6) for name, value in row.items()}
