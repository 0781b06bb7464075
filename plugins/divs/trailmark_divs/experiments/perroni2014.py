"""``trailmark reproduce perroni2014``: all experiments of the paper, and what it leaves open."""

from __future__ import annotations

from collections.abc import Sequence

from trailmark.experiments import ExperimentOptions, Row
from trailmark_divs.experiments.closed_loop import closed_loop_rows
from trailmark_divs.experiments.clutter import clutter_rows
from trailmark_divs.experiments.corners import corner_rows
from trailmark_divs.experiments.correspondences import correspondence_rows
from trailmark_divs.experiments.frame_time import frame_time_rows
from trailmark_divs.experiments.likelihood import likelihood_rows
from trailmark_divs.experiments.offline import offline_rows

__all__ = ["perroni2014"]

_PARTS = (
    frame_time_rows,
    likelihood_rows,
    clutter_rows,
    offline_rows,
    closed_loop_rows,
    corner_rows,
    correspondence_rows,
)


def perroni2014(options: ExperimentOptions) -> Sequence[Row]:
    """Repeat the experiments of Perroni Filho & Ohya 2014."""
    return [row for part in _PARTS for row in part(options)]
