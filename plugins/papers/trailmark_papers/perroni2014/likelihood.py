"""Fig. 1: how likely every shift is along a drive, with the shift that hill climbing and our tracker select."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from trailmark.experiments import ExperimentOptions, Row
from trailmark.frames import Image
from trailmark.pipeline import Pipeline, Step
from trailmark_divs.layout import grey_region, make_layout
from trailmark_divs.options import Average, Threshold
from trailmark_divs.paper_shift import PaperShift, winc
from trailmark_divs.robust_shift import local_windows, shift_scores
from trailmark_divs.stream import ChangeStream
from trailmark_divs.tracking import ShiftTracker
from trailmark_papers.perroni2014.drives import STREAMS, Place, Taught, replay, teach
from trailmark_papers.perroni2014.plots import draw_likelihood

__all__ = ["likelihood_rows"]

_WIDTH_PX = 160
_WINDOW, _COLUMNS, _CORRELATION_WINDOW, _REACH = 25, 50, 5, 20
_TURNED_DEG = 5.0
_AFTERNOON = {"time": "afternoon", "people": 3}
_CONFIDENCE = 0.8
_JUMP_COLUMNS = 2.0

_REFERENCE, _OURS = "as the reference, hill climbing", "ours, tracked"

Floats = npt.NDArray[np.float64]
Pictures = list[npt.NDArray[np.uint8]]


def likelihood_rows(options: ExperimentOptions) -> list[Row]:
    """Return how steady both selections are, and draw Fig. 1."""
    length_m = 3.0 if options.quick else 10.0
    taught_pictures, pictures = _pictures_of(options, Place("street", length_m, _WIDTH_PX))
    n = min(len(taught_pictures), len(pictures)) - _WINDOW  # by index, Eq. (11): both drives have the same speed
    maps, paths = _both(taught_pictures, pictures, n)
    draw_likelihood(options.out / "figure_1_likelihood.svg", maps, paths, _REACH)
    rows, figure = [], "Fig. 1 street, +5 deg"
    for name, path in paths.items():
        rows.append(Row(figure, f"{name}: jumps of more than 2 columns", "%", _jumps_percent(path), n=n))
    greatest = np.argmax(maps[_REFERENCE], axis=1).astype(np.float64)
    rows.append(Row(figure, "maximum of each, without climbing: the same", "%", _jumps_percent(greatest), n=n))
    options.report(f"Fig. 1: {n} change vectors")
    return rows


def _jumps_percent(path: npt.NDArray[np.float64]) -> float:
    return 100.0 * float((np.abs(np.diff(path)) > _JUMP_COLUMNS).mean())


def change_vectors(
    pictures: Sequence[npt.NDArray[np.uint8]], threshold: Threshold, average: Average
) -> npt.NDArray[np.float64]:
    """Return the change vectors of upper halves, Eqs. (4) to (7), (N - w, d)."""
    height, width = pictures[0].shape[0] * 2, pictures[0].shape[1]
    stream = ChangeStream(make_layout((width, height), _COLUMNS, (0.0, 0.5)), _WINDOW, threshold, average)
    vectors = []
    for picture in pictures:
        stream.push(picture)
        if stream.is_full:
            vectors.append(stream.vector())
    return np.array(vectors)


def _both(taught: Pictures, seen: Pictures, n: int) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return the likelihoods and the selected shifts of both ways, each with its own change vectors.

    (n, 2 reach + 1) and (n,) each.
    """
    climbed = _climbed(*(change_vectors(pictures, "otsu", "mean")[:n] for pictures in (taught, seen)))
    tracked = _tracked(*(change_vectors(pictures, "p90", "trimmed")[:n] for pictures in (taught, seen)))
    maps, paths = zip(climbed, tracked, strict=True)
    return dict(zip((_REFERENCE, _OURS), maps, strict=True)), dict(zip((_REFERENCE, _OURS), paths, strict=True))


def _climbed(taught: Floats, seen: Floats) -> tuple[Floats, Floats]:
    """Return the responses of the reference's correlation, and the shift that hill climbing selects."""
    paper, responses, columns = PaperShift(_CORRELATION_WINDOW), [], []
    for before, now in zip(taught, seen, strict=True):
        response = winc(before, now, _CORRELATION_WINDOW)
        responses.append(response[_COLUMNS - _REACH : _COLUMNS + _REACH + 1])
        columns.append(paper.update(before, now))
    return np.array(responses), np.array(columns)


def _tracked(taught: Floats, seen: Floats) -> tuple[Floats, Floats]:
    """Return our scores, and the tracked shift: NaN where the tracker is not sure enough to speak."""
    tracker, scores, columns = ShiftTracker(_REACH, _WINDOW), [], []
    usable = np.ones(_COLUMNS, dtype=np.bool_)
    for pair in zip(taught, seen, strict=True):
        before, now = (local_windows(vector, usable, _CORRELATION_WINDOW) for vector in pair)
        scores.append(shift_scores(before, now, _REACH))
        shift = tracker.update(scores[-1])
        columns.append(shift.columns if shift.confidence >= _CONFIDENCE else np.nan)
    return np.array(scores), np.array(columns)


def _pictures_of(options: ExperimentOptions, place: Place) -> tuple[Pictures, Pictures]:
    """Return the upper halves of all pictures of teaching, and of a drive turned aside."""
    taught_pictures: Pictures = []
    folder = options.out / "runs" / "likelihood"
    taught = teach(folder, place, {"streams": STREAMS}, options.seed, UpperHalves(taught_pictures))
    return taught_pictures, straight_pictures(taught, options.seed)


def straight_pictures(taught: Taught, seed: int) -> Pictures:
    """Return the upper halves of the pictures of a drive straight ahead, from a start turned by 5 degrees."""
    found: Pictures = []
    with tempfile.TemporaryDirectory() as folder:
        streams = {"streams": STREAMS}
        replay(Path(folder), taught, _AFTERNOON, streams, seed, _TURNED_DEG, use=[], on_step=UpperHalves(found))
    return found


class UpperHalves:
    """Keeps the upper half of every picture in grey, as a pipeline's ``on_step``."""

    def __init__(self, found: Pictures) -> None:
        self._found = found

    def __call__(self, _: Pipeline, step: Step) -> None:
        """Keep the picture of a step that has one."""
        if step.frame is not None and isinstance(step.frame.payload, Image):
            rows = (0, step.frame.payload.pixels.shape[0] // 2)
            self._found.append(grey_region(step.frame.payload, rows))
