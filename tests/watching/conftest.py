"""A short run of a simulated robot, as it is while it goes on and when it has ended."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from trailmark.pipeline import Pipeline
from trailmark.watching.growing import GrowingRun
from trailmark.watching.notes import LiveNotes

CONFIG = {
    "sources": {"robot": {"plugin": "sim", "world": "ground_course", "route": "indoor", "sensors": ["wheels"]}},
    "localizers": {"wheels": {"plugin": "odometry"}},
    "estimator": {"plugin": "kalman"},
}


@dataclass
class Watched:
    """A run that was looked at in its middle."""

    folder: Path
    notes: Path
    midway: GrowingRun
    document: dict


@pytest.fixture(scope="session")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Watched:
    folder, notes_folder = (tmp_path_factory.mktemp("watched") / name for name in ("run", "notes"))
    notes_folder.mkdir()
    notes = LiveNotes(notes_folder)  # its thread is not started: what it would do is done here
    with Pipeline(CONFIG, out=folder) as pipeline:
        for n, step in enumerate(pipeline):
            if n == 250:
                notes._truth_at_s = 0.0  # a second has not gone
            notes(pipeline, step)
            if n in (0, 250):
                notes.write()
            if n == 250:
                midway = GrowingRun(folder, notes_folder)
                assert midway.look()
                document = midway.document()
                break
        for n, _ in enumerate(pipeline):
            if n == 100:
                break
    assert document is not None
    return Watched(folder, notes_folder, midway, document)
