"""Stretches of a run in which a localizer was lost, or said nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from trailmark.evaluation import EstimateTable
from trailmark.evaluation.association import usual_interval_s

__all__ = ["Gap", "find_gaps"]

# A localizer that speaks now and then is silent after so many of its usual intervals, and not for less of the run.
_INTERVALS = 8.0
_SHARE = 0.01
_MAX_GAPS = 200


@dataclass(frozen=True, slots=True)
class Gap:
    """A stretch without an answer.

    Attributes
    ----------
    name : str
        The localizer.
    kind : {"lost", "silent"}
        It looked and could not say, or it said nothing.
    start_s, stop_s : float
        From its last answer to the next, or to the end of the run [s].
    reason : str
        What it said of it, where it was lost.
    """

    name: str
    kind: Literal["lost", "silent"]
    start_s: float
    stop_s: float
    reason: str = ""

    def document(self, start_s: float) -> dict[str, Any]:
        """Return it as plain data, in time since the start of the run."""
        return {
            "name": self.name,
            "kind": self.kind,
            "from": round(self.start_s - start_s, 4),
            "to": round(self.stop_s - start_s, 4),
            "reason": self.reason,
        }


def find_gaps(estimates: EstimateTable, span_s: tuple[float, float]) -> list[Gap]:
    """Return the stretches in which a localizer that had spoken gave no answer; the longest, in their order in time.

    Parameters
    ----------
    estimates : EstimateTable
        Of a whole run.
    span_s : (float, float)
        Of the run [s].
    """
    found = [gap for name in estimates.sources() for gap in _gaps_of(name, estimates.of(name), span_s)]
    longest = sorted(found, key=lambda gap: gap.start_s - gap.stop_s)[:_MAX_GAPS]
    return sorted(longest, key=lambda gap: (gap.start_s, gap.name))


def _gaps_of(name: str, rows: EstimateTable, span_s: tuple[float, float]) -> list[Gap]:
    """Return the gaps between answers; of those in which it said `Lost`, why it said so last."""
    is_lost = rows.outcome == "lost"
    answers = np.unique(rows.stamp_s[~is_lost & np.isfinite(rows.stamp_s)])
    if not len(answers):
        return []
    losses = rows.where(is_lost & np.isfinite(rows.stamp_s))
    losses = losses.where(np.argsort(losses.stamp_s, kind="stable"))
    least_s = _SHARE * (span_s[1] - span_s[0])
    if len(answers) > 1:
        least_s = max(least_s, _INTERVALS * usual_interval_s(answers))
    edges = np.append(answers, span_s[1])
    until = np.searchsorted(losses.stamp_s, edges, side="right")
    n_losses, length_s = np.diff(until), np.diff(edges)
    gaps = []
    for index in np.flatnonzero((length_s > 0.0) & ((n_losses > 1) | (length_s > least_s))).tolist():
        is_lost_there = bool(n_losses[index])
        reason = str(losses.reason[until[index + 1] - 1]) if is_lost_there else ""
        gaps.append(
            Gap(name, "lost" if is_lost_there else "silent", float(edges[index]), float(edges[index + 1]), reason)
        )
    return gaps
