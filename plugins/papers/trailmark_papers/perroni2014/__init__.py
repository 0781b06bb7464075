"""The experiments of Perroni Filho & Ohya 2014 (Sec. V) in the simulator: ``trailmark reproduce perroni2014``."""

from __future__ import annotations

from collections.abc import Sequence

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import over_places

__all__ = ["perroni2014"]

_N_PLACES = 5


def perroni2014(options: ExperimentOptions) -> Sequence[Row]:
    """Repeat the experiments of Perroni Filho & Ohya 2014."""
    from trailmark_papers.perroni2014.closed_loop import closed_loop_rows
    from trailmark_papers.perroni2014.clutter import clutter_rows
    from trailmark_papers.perroni2014.corners import corner_rows
    from trailmark_papers.perroni2014.correspondences import correspondence_rows
    from trailmark_papers.perroni2014.frame_time import frame_time_rows
    from trailmark_papers.perroni2014.likelihood import likelihood_rows
    from trailmark_papers.perroni2014.offline import offline_rows
    from trailmark_papers.perroni2014.own_steering import own_steering_rows

    driven = (closed_loop_rows, own_steering_rows, corner_rows, correspondence_rows)
    parts = (likelihood_rows, clutter_rows, offline_rows, *driven)
    return frame_time_rows(options) + [row for part in parts for row in over_places(options, part, _N_PLACES)]
