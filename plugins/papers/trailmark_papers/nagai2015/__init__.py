"""The paper's experiments (Sec. IV), in the simulator: ``trailmark reproduce nagai2015``."""

from __future__ import annotations

from collections.abc import Sequence

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import begin_with, over_places
from trailmark_papers.nagai2015.cover import cover_rows
from trailmark_papers.nagai2015.hard_day import hard_day_rows
from trailmark_papers.nagai2015.indoor import indoor_rows
from trailmark_papers.nagai2015.outdoor import outdoor_rows
from trailmark_papers.nagai2015.straight import straight_rows
from trailmark_papers.nagai2015.times import time_rows

__all__ = ["nagai2015"]

_N_PLACES = 5
#: The figures by which the paper is judged.
_HEADLINES = (
    "B * m straight, *: odometer, worst of * floors",
    "B * m straight, *: heading, worst of * floors",
    "C * trips: offset from the path, m*",
    "D *, next day, *: offset from the path, m*",
    "D *, a hard next day, *: searches rejected",
    "D *, a hard next day, *: offset from the path, mean",
    "D *, a hard next day, *: offset at the searches, *, mean",
    "E times, *: relative search, *, mean",
    "E times, *: absolute search, *, mean",
)
_SECTIONS = (cover_rows, indoor_rows, outdoor_rows, hard_day_rows)


def nagai2015(options: ExperimentOptions) -> Sequence[Row]:
    """Repeat the experiments of Nagai & Watanabe 2015."""
    driven = [row for section in _SECTIONS for row in over_places(options, section, _N_PLACES)]
    return begin_with([*straight_rows(options), *driven, *time_rows(options)], *_HEADLINES)
