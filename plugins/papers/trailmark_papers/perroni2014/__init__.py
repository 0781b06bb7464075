"""The experiments of Perroni Filho & Ohya 2014 (Sec. V) in the simulator: ``trailmark reproduce perroni2014``."""

from __future__ import annotations

from collections.abc import Sequence

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import begin_with, over_places

__all__ = ["perroni2014"]

_N_PLACES = 5
#: The figures by which the paper is judged.
_HEADLINES = (
    "Fig. 3 street, *5 deg: streams: mean less the true mean, worst drive",
    "Fig. 3 street, *5 deg: streams: error of an answer, mean absolute",
    "Fig. 4 corridor, *5 deg: streams: mean less the true mean, worst drive",
    "Fig. 4 corridor, *5 deg: streams: error of an answer, mean absolute",
    "Fig. 4 corridor, *5 deg: streams: sign right, *",
    "*, overexposed *: streams: error of an answer, mean absolute",
    "Fig. 5 *, 10 m: ?5 deg: came back to the path",
    "Fig. 5 *, 10 m: ?5 deg: offset at the end, max",
    "Fig. 5 street, the paper's steering: as printed: *",
    "correspondence, street, *: distance*: offset at the end when it steers, max",
    "time per picture, *: change vector and shift, one core",
)


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
    driven_rows = [row for part in parts for row in over_places(options, part, _N_PLACES)]
    return begin_with([*frame_time_rows(options), *driven_rows], *_HEADLINES)
