"""How soon a localizer answers, and for how long it leaves its user alone: from an unknown start, after a fault.

A localizer *looks* whenever it says anything, `Lost` included. An answer is *right* where it is not silently wrong
(`trailmark.evaluation.silent`): a wide one is right, too.
"""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.evaluation.estimate_errors import estimate_errors
from trailmark.evaluation.naming import metric_name
from trailmark.evaluation.plugged import JudgedEstimates
from trailmark.evaluation.silent import silently_wrong_ones

__all__ = ["answers"]


def answers(judged: JudgedEstimates) -> dict[str, float]:
    """Return how soon there was an answer, and the longest time without one [s].

    ``first_answer_s`` counts from the first look, ``longest_silence_s`` from an answer to the next, or to the last
    look. With truth, ``first_right_s`` and ``recovery_s`` are the same for right answers alone: ``recovery_s`` is the
    time that a fault costs, its own length included. Where none ever came, each is the whole time that it looked, so
    that a localizer that never answers has the worst figures of all and is not left out of a mean.
    """
    estimates = judged.estimates
    if not len(estimates):
        return {}
    stamps_s = estimates.stamp_s
    is_answer = (estimates.kind != "lost") & (estimates.outcome != "refused")
    protocol = f"n={len(estimates)}"
    first_s, gap_s = _first_and_gap(stamps_s, is_answer)
    found = {metric_name("first_answer_s", protocol): first_s, metric_name("longest_silence_s", protocol): gap_s}
    if judged.truth is None:
        return found
    errors = estimate_errors(estimates, judged.truth, judged.map_frame, judged.path)
    is_known, is_wrong = silently_wrong_ones(errors)
    if not is_known.any():
        return found
    is_right = is_answer.copy()
    is_right[is_answer] = is_known & ~is_wrong
    # Where the truth is not known, nobody can say how long it took: those looks do not count.
    is_judged = ~is_answer
    is_judged[is_answer] = is_known
    first_s, gap_s = _first_and_gap(stamps_s[is_judged], is_right[is_judged])
    return found | {metric_name("first_right_s", protocol): first_s, metric_name("recovery_s", protocol): gap_s}


def _first_and_gap(stamps_s: Floats, is_good: Bools) -> tuple[float, float]:
    """Return the time from the first look to the first good one, and the longest from a good one to the next [s]."""
    order = np.argsort(stamps_s, kind="stable")
    stamps_s, is_good = stamps_s[order], is_good[order]
    if not is_good.any():
        whole_s = float(stamps_s[-1] - stamps_s[0])
        return whole_s, whole_s
    good_s = stamps_s[is_good]
    gaps_s = np.diff(np.append(good_s, stamps_s[-1]))
    return float(good_s[0] - stamps_s[0]), float(gaps_s.max())
