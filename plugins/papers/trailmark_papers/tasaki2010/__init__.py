"""The experiments of Tasaki et al. 2010 (Sec. IV) in the simulated supermarket: ``trailmark reproduce tasaki2010``.

Written in the words of a config, so that every part can be swapped there: nothing here imports another plugin.
"""

from __future__ import annotations

from collections.abc import Sequence

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import begin_with, over_places

__all__ = ["tasaki2010"]

_N_PLACES = 5
#: The figures by which the paper is judged.
_HEADLINES = (
    "Table 1: developed, true position error, mean",
    "Table 1: SURF only, *: true position error, mean",
    "Table 1, paired: error, *over developed",
    "Table 1, paired: time, *over developed",
    "White wall, *: developed, largest error",
    "Selection: *: error, mean",
    "Table 2: true distance at reported arrival, mean",
    "* random starts: arrived *",
    "* random starts: drives that touched something",
    "Laser alone*: right place *",
)


def tasaki2010(options: ExperimentOptions) -> Sequence[Row]:
    """Repeat the experiments of Tasaki et al. 2010."""
    return begin_with(over_places(options, _rows_of_place, _N_PLACES), *_HEADLINES)


def _rows_of_place(options: ExperimentOptions) -> list[Row]:
    from trailmark_papers.tasaki2010.ambiguous import ambiguous_rows
    from trailmark_papers.tasaki2010.goals import goal_rows
    from trailmark_papers.tasaki2010.laser_alone import laser_rows
    from trailmark_papers.tasaki2010.line import line_rows
    from trailmark_papers.tasaki2010.people import people_rows
    from trailmark_papers.tasaki2010.place import taught_place

    place = taught_place(options)
    return [
        *line_rows(options, place),
        *people_rows(options, place),
        *goal_rows(options, place),
        *laser_rows(options, place),
        *ambiguous_rows(options),
    ]
