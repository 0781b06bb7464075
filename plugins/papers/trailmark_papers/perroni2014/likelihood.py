"""Fig. 1: how likely every shift is along a drive, with the shift that hill climbing and our tracker select."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trailmark.arrays import Floats, Grey8
from trailmark.experiments import ExperimentOptions, Row
from trailmark_divs.layout import make_layout
from trailmark_divs.options import Average, Threshold
from trailmark_divs.paper_shift import PaperShift, winc
from trailmark_divs.robust_shift import local_windows, shift_scores
from trailmark_divs.stream import ChangeStream
from trailmark_divs.tracking import ShiftTracker
from trailmark_papers.kit import Table
from trailmark_papers.perroni2014.drives import AFTERNOON, STREAMS, Place, Replay
from trailmark_papers.perroni2014.pictures import upper_halves
from trailmark_papers.perroni2014.plots import draw_likelihood

__all__ = ["likelihood_rows"]

_WIDTH_PX = 160
_WINDOW, _COLUMNS, _CORRELATION_WINDOW, _REACH = 25, 50, 5, 20
_TURNED_DEG = 5.0
_CONFIDENCE = 0.8
_JUMP_COLUMNS = 2.0

_REFERENCE, _OURS = "as the reference, hill climbing", "ours, tracked"

Pictures = list[Grey8]


def likelihood_rows(options: ExperimentOptions) -> list[Row]:
    """Return how steady both selections are, and draw Fig. 1."""
    length_m = 3.0 if options.quick else 10.0
    taught_pictures, pictures = _pictures_of(
        options, Place("street", length_m, _WIDTH_PX, world_seed=options.world_seed)
    )
    n = min(len(taught_pictures), len(pictures)) - _WINDOW  # by index, Eq. (11): both drives have the same speed
    maps, paths = _both(taught_pictures, pictures, n)
    draw_likelihood(options.out / "figure_1_likelihood.svg", maps, paths, _REACH)
    table = Table("Fig. 1 street, +5 deg", n)
    for name, path in paths.items():
        table.add(f"{name}: jumps of more than 2 columns", "%", _jumps_percent(path))
    greatest = np.argmax(maps[_REFERENCE], axis=1).astype(np.float64)
    table.add("maximum of each, without climbing: the same", "%", _jumps_percent(greatest))
    options.report(f"Fig. 1: {n} change vectors")
    return table.rows


def _jumps_percent(path: Floats) -> float:
    return 100.0 * float((np.abs(np.diff(path)) > _JUMP_COLUMNS).mean())


def change_vectors(pictures: Sequence[Grey8], threshold: Threshold, average: Average) -> Floats:
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
    climbed = _climb(*(change_vectors(pictures, "otsu", "mean")[:n] for pictures in (taught, seen)))
    tracked = _track_shifts(*(change_vectors(pictures, "p90", "trimmed")[:n] for pictures in (taught, seen)))
    maps, paths = zip(climbed, tracked, strict=True)
    return dict(zip((_REFERENCE, _OURS), maps, strict=True)), dict(zip((_REFERENCE, _OURS), paths, strict=True))


def _climb(taught: Floats, seen: Floats) -> tuple[Floats, Floats]:
    """Return the responses of the reference's correlation, and the shift that hill climbing selects."""
    paper, responses, columns = PaperShift(_CORRELATION_WINDOW), [], []
    for before, now in zip(taught, seen, strict=True):
        response = winc(before, now, _CORRELATION_WINDOW)
        responses.append(response[_COLUMNS - _REACH : _COLUMNS + _REACH + 1])
        columns.append(paper.update(before, now))
    return np.array(responses), np.array(columns)


def _track_shifts(taught: Floats, seen: Floats) -> tuple[Floats, Floats]:
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
    """Return the upper halves of all pictures of teaching, and of a drive turned aside, straight ahead."""
    streams, seen, again = {"streams": STREAMS}, upper_halves(), upper_halves()
    taught = place.teach(options.out / "runs" / "likelihood", streams, options.seed, on_step=seen)
    taught.replay(Replay(streams, options.seed, AFTERNOON, _TURNED_DEG, use=[]), again)
    return seen.values, again.values
