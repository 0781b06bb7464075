"""Why localizers were lost, without the numbers that make each reason another one."""

from __future__ import annotations

import re
from collections import Counter, defaultdict

from trailmark.evaluation.estimates_table import EstimateTable

__all__ = ["reasons_of"]

_NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")


def reasons_of(estimates: EstimateTable, outcome: str = "lost", most: int = 3) -> dict[str, int]:
    """Return why estimates had an outcome, and how often, the most frequent first.

    Reasons that differ in their numbers alone count together, under the first of them.
    """
    texts: defaultdict[str, list[str]] = defaultdict(list)
    for text in estimates.reason[estimates.outcome == outcome].tolist():
        texts[_NUMBER.sub("#", text)].append(text)
    counted = Counter({found[0]: len(found) for found in texts.values()})
    return dict(counted.most_common(most))
