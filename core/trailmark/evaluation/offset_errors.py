"""What a localizer that says path offsets is judged by: along the path, beside it, and turned from it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.evaluation.absolute import Summary, summarize
from trailmark.evaluation.estimate_errors import EstimateErrors

__all__ = ["OffsetErrors", "offset_errors"]

_WORDS = (("along", "m", 1.0), ("lateral", "m", 1.0), ("heading", "deg", math.degrees(1.0)))


@dataclass(frozen=True, slots=True)
class OffsetErrors:
    """Errors of path offsets; None for what was not measured.

    Attributes
    ----------
    n : int
        Number of offsets that were compared.
    along, lateral, heading : Summary or None
        Of the absolute errors [m, m, rad].
    """

    n: int
    along: Summary | None
    lateral: Summary | None
    heading: Summary | None

    def metrics(self, *, against_truth: bool = True) -> dict[str, float]:
        """Return the metrics by name: metres and degrees; against the belief they are called differences."""
        found: dict[str, float] = {}
        for word, unit, scale in _WORDS:
            summary: Summary | None = getattr(self, word)
            if summary is not None:
                stem = f"offset_{word}" if against_truth else f"offset_{word}_difference"
                found |= summary.metrics(stem, unit, f"n={self.n}", scale=scale)
        return found


def offset_errors(judged: EstimateErrors) -> OffsetErrors | None:
    """Return the errors of the path offsets among judged estimates; None where none could be compared."""
    rows = (judged.estimates.kind == "pathoffset") & np.isfinite(judged.errors).all(axis=1)
    errors, information = judged.errors[rows], judged.information[rows]
    if not len(errors):
        return None
    is_measured = np.diagonal(information, axis1=1, axis2=2) > 0.0
    columns = [errors[is_measured[:, k], k] for k in range(3)]
    return OffsetErrors(len(errors), *(summarize(column) if len(column) else None for column in columns))
