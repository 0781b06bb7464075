"""Fig. 2: a turn clutters the change image, which is why streams stop in turns."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from trailmark.experiments import ExperimentOptions, Row
from trailmark.frames import Image
from trailmark.geometry import Trajectory
from trailmark.pipeline import Pipeline, Step
from trailmark_divs.layout import grey_region, make_layout
from trailmark_divs.stream import ChangeStream
from trailmark_papers.perroni2014.drives import STREAMS, Place, replay, teach
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
    name = "Fig. 2 street, a correction of 10 deg"
    options.report("Fig. 2: a change image before and in a turn")
    return [
        Row(name, f"pixels that changed at all, {which}", "%", 100.0 * float((picture > 0.0).mean()))
        for which, picture in (("before", before), ("in the turn", within))
    ] + [
        Row(name, f"pixels that kept changing, {which}", "%", 100.0 * float((picture >= _OFTEN).mean()))
        for which, picture in (("before", before), ("in the turn", within))
    ]


def _change_images(options: ExperimentOptions) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return the change image just before the robot turns back to its path, and at the end of the turn."""
    greys: list[tuple[float, npt.NDArray[np.uint8]]] = []

    def keep(_: Pipeline, step: Step) -> None:
        if step.frame is not None and isinstance(step.frame.payload, Image):
            rows = (0, step.frame.payload.pixels.shape[0] // 2)
            greys.append((step.frame.stamp_s, grey_region(step.frame.payload, rows)))

    streams = {"streams": {**STREAMS, "when_blind": "silent"}}
    place = Place("street", _WAY_M, _WIDTH_PX)
    taught = teach(options.out / "runs" / "clutter", place, streams, options.seed)
    with tempfile.TemporaryDirectory() as folder:
        result = replay(Path(folder), taught, {}, streams, options.seed, _TURNED_DEG, controller=_STEPS, on_step=keep)
    assert result.ground_truth is not None
    first, last = _turn_of(result.ground_truth.at([stamp_s for stamp_s, _ in greys]))
    return _change_image([grey for _, grey in greys], first), _change_image([grey for _, grey in greys], last)


def _turn_of(truth: Trajectory) -> tuple[int, int]:
    """Return the first picture of the first turn, and the last."""
    steps_deg = np.abs(np.degrees(np.diff(np.unwrap(truth.headings))))
    turns = np.flatnonzero(steps_deg > _TURN_DEG)
    first = int(turns[turns > _WINDOW][0])
    ends = np.flatnonzero(steps_deg[first:] <= _TURN_DEG)
    return first, first + int(ends[0]) if len(ends) else len(steps_deg)


def _change_image(greys: Sequence[npt.NDArray[np.uint8]], last: int) -> npt.NDArray[np.float32]:
    """Return the change image of the window that ends with a picture, Eq. (6)."""
    height, width = greys[0].shape[0] * 2, greys[0].shape[1]
    stream = ChangeStream(make_layout((width, height), _COLUMNS, (0.0, 0.5)), _WINDOW, keep_pictures=True)
    for grey in greys[max(0, last - _WINDOW) : last + 1]:
        stream.push(grey)
    return stream.change_image()
