"""Fig. 2: a turn clutters the change image, which is why streams stop in turns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trailmark.arrays import Float32s, Grey8
from trailmark.experiments import ExperimentOptions, Row
from trailmark.geometry import Trajectory
from trailmark_divs.layout import make_layout
from trailmark_divs.stream import ChangeStream
from trailmark_papers.kit import Table, truth_of
from trailmark_papers.perroni2014.drives import STREAMS, Place, Replay
from trailmark_papers.perroni2014.pictures import upper_halves
from trailmark_papers.perroni2014.plots import draw_clutter

__all__ = ["clutter_rows"]

_WIDTH_PX, _WINDOW, _COLUMNS = 320, 25, 50
_WAY_M = 3.0
_TURNED_DEG = 10.0
#: The paper's way: turn, then straight on; its robot turned more sharply than ours is made to.
_STEPS = {"law": "steps", "correction_limit_deg_per_m": 40.0}
_OFTEN = 0.3  # of the window: a pixel that an edge crosses again and again
_TURN_DEG = 0.05


def clutter_rows(options: ExperimentOptions) -> list[Row]:
    """Return how much a turn spreads the changes, and draw Fig. 2."""
    before, within = _change_images(options)
    pictures = {"(a) before the correction": before, "(b) while turning, had it gone on collecting": within}
    draw_clutter(options.out / "figure_2_clutter.svg", pictures)
    options.report("Fig. 2: a change image before and in a turn")
    table = Table("Fig. 2 street, a correction of 10 deg")
    for item, floor in (("changed at all", 1e-9), ("kept changing", _OFTEN)):
        for which, picture in (("before", before), ("in the turn", within)):
            table.add(f"pixels that {item}, {which}", "%", 100.0 * float((picture >= floor).mean()))
    return table.rows


def _change_images(options: ExperimentOptions) -> tuple[Float32s, Float32s]:
    """Return the change image just before the robot turns back to its path, and at the end of the turn."""
    keeper, streams = upper_halves(), {"streams": {**STREAMS, "when_blind": "silent"}}
    taught = Place("street", _WAY_M, _WIDTH_PX, world_seed=options.world_seed).teach(
        options.out / "runs" / "clutter", streams, options.seed
    )
    how = Replay(streams, options.seed, turned_deg=_TURNED_DEG, controller=_STEPS)
    first, last = _turn_of(truth_of(taught.replay(how, keeper)).at(keeper.stamps_s))
    return _change_image(keeper.values, first), _change_image(keeper.values, last)


def _turn_of(truth: Trajectory) -> tuple[int, int]:
    """Return the first picture of the first turn, and the last."""
    steps_deg = np.abs(np.degrees(np.diff(np.unwrap(truth.headings))))
    turns = np.flatnonzero(steps_deg > _TURN_DEG)
    first = int(turns[turns > _WINDOW][0])
    ends = np.flatnonzero(steps_deg[first:] <= _TURN_DEG)
    return first, first + int(ends[0]) if len(ends) else len(steps_deg)


def _change_image(greys: Sequence[Grey8], last: int) -> Float32s:
    """Return the change image of the window that ends with a picture, Eq. (6)."""
    height, width = greys[0].shape[0] * 2, greys[0].shape[1]
    stream = ChangeStream(make_layout((width, height), _COLUMNS, (0.0, 0.5)), _WINDOW, keep_pictures=True)
    for grey in greys[max(0, last - _WINDOW) : last + 1]:
        stream.push(grey)
    return stream.change_image()
