"""What a run that is watched keeps in memory, when its notes cannot be written."""

from __future__ import annotations

import logging
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from trailmark.frames import Frame, Image
from trailmark.pipeline import Pipeline
from trailmark.watching import notes as notes_module
from trailmark.watching.notes import LiveNotes

CONFIG = {
    "sources": {"robot": {"plugin": "sim", "world": "ground_course", "route": "indoor", "sensors": ["wheels"]}},
    "localizers": {"wheels": {"plugin": "odometry"}},
    "estimator": {"plugin": "kalman"},
}


@pytest.fixture
def notes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> LiveNotes:
    """Return notes of a clock that goes on by a second whenever it is asked, and of a thread that does not wait."""
    seconds = count(100.0)
    monkeypatch.setattr(notes_module, "time", SimpleNamespace(monotonic=lambda: next(seconds)))
    monkeypatch.setattr(notes_module, "_WRITE_EVERY_S", 0.0)
    return LiveNotes(tmp_path)


def test_pictures_that_nobody_writes_are_let_go(notes: LiveNotes) -> None:
    notes._began_s = 0.0
    for n in range(300):
        notes._take_picture(Frame("eye", float(n), Image(np.zeros((4, 4), np.uint8))))

    assert len(notes._pictures) == 200


@pytest.mark.parametrize(
    ("error", "why"),
    [
        (OSError(28, "No space left on device"), "No space left on device"),
        (ValueError("no JPEG"), "ValueError: no JPEG"),
    ],
)
def test_nothing_is_noted_once_it_cannot_be_written(
    notes: LiveNotes, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, error: Exception, why: str
) -> None:
    def fail() -> None:
        raise error

    monkeypatch.setattr(notes, "write", fail)
    with Pipeline(CONFIG) as pipeline:
        steps = iter(pipeline)
        notes(pipeline, next(steps))
        assert len(notes._beliefs) == 1
        with caplog.at_level(logging.WARNING):
            notes._write_again_and_again()
        notes(pipeline, next(steps))

    assert notes._beliefs == notes._pictures == []
    assert caplog.messages == [f"the page of this run stands still: {why}"]
