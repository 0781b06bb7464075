"""The paper's experiments (Sec. IV), in the simulator: ``trailmark reproduce nagai2015``."""

from __future__ import annotations

from collections.abc import Sequence

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import over_places
from trailmark_papers.nagai2015.cover import cover_rows
from trailmark_papers.nagai2015.hard_day import hard_day_rows
from trailmark_papers.nagai2015.indoor import indoor_rows
from trailmark_papers.nagai2015.outdoor import outdoor_rows
from trailmark_papers.nagai2015.straight import straight_rows
from trailmark_papers.nagai2015.times import time_rows

__all__ = ["nagai2015"]

_N_PLACES = 5
_SECTIONS = (cover_rows, indoor_rows, outdoor_rows, hard_day_rows)


def nagai2015(options: ExperimentOptions) -> Sequence[Row]:
    """Repeat the experiments of Nagai & Watanabe 2015."""
    driven = [row for section in _SECTIONS for row in over_places(options, section, _N_PLACES)]
    return [*straight_rows(options), *driven, *time_rows(options)]
