"""A run while it goes on: as its report will show it, as far as it is known."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from trailmark.evaluation import read_run
from trailmark.frames import Frame, Image
from trailmark.report.glimpses import PICTURE_NAME
from trailmark.report.write import explorer_of_run
from trailmark.watching.growing import GrowingRun
from trailmark.watching.notes import LiveNotes


def tracks(document: dict) -> dict:
    return {track["name"]: track for track in document["tracks"]}


def unpacked(column: list) -> np.ndarray:
    return np.cumsum([step or 0 for step in column[1:]]) / column[0]


def test_a_run_that_goes_on_is_shown_with_its_belief_and_the_truth(watched) -> None:
    document = watched.document

    assert document["isGoingOn"]
    assert set(tracks(document)) == {"groundtruth", "wheels", "fused"}
    assert document["errors"]
    assert document["beliefs"] is not None
    assert document["robot"]
    assert document["lanes"][0]["counts"] == {"accepted": watched.midway.watch.localizers["wheels"].n}


def test_what_was_shown_midway_is_what_the_run_itself_then_wrote(watched) -> None:
    own = read_run(watched.folder).trajectories["wheels"]
    midway = watched.midway._as_far_as_known().trajectories["wheels"]

    assert 0 < len(midway) < len(own)
    assert np.array_equal(midway.stamps_s, own.stamps_s[: len(midway)])
    assert np.allclose(midway.poses, own.poses[: len(midway)], atol=1e-9)


def test_a_run_that_has_ended_is_shown_as_in_its_report(watched) -> None:
    ended = GrowingRun(watched.folder, watched.notes)
    assert not ended.look()

    document = ended.document()

    assert document is not None
    assert document.pop("isGoingOn") is False
    assert document == explorer_of_run(read_run(watched.folder))


def test_without_notes_the_localizers_own_ways_are_shown(watched, tmp_path: Path) -> None:
    folder = tmp_path / "going-on"
    folder.mkdir()
    for name in ("config.yaml", "estimates.csv"):
        shutil.copy(watched.folder / name, folder)
    (folder / "run.json").write_text(json.dumps({"status": "running"}))
    run = GrowingRun(folder)
    assert run.look()

    document = run.document()

    assert document is not None
    assert set(tracks(document)) == {"wheels"}
    assert document["beliefs"] is None
    assert unpacked(tracks(document)["wheels"]["t"])[-1] == pytest.approx(document["span"], abs=1e-4)


def test_a_long_run_stays_small(watched, tmp_path: Path) -> None:
    folder = tmp_path / "long"
    folder.mkdir()
    head, row = (watched.folder / "estimates.csv").read_text().splitlines()[:2]
    fields = row.split(",")
    with (folder / "estimates.csv").open("w") as file:
        file.write(head + "\n")
        for n in range(12000):
            fields[0], fields[3], fields[4] = (repr(0.02 * k) for k in (n + 1, n, n + 1))
            file.write(",".join(fields) + "\n")
    shutil.copy(watched.folder / "config.yaml", folder)
    (folder / "run.json").write_text(json.dumps({"status": "running"}))
    run = GrowingRun(folder)

    looks = 0
    while run.look() and run.n_left:
        looks += 1

    assert looks >= 1  # it is read in pieces
    assert run.watch.localizers["wheels"].n == 12000
    known = run._as_far_as_known()
    assert len(known.trajectories["wheels"]) <= 2000
    assert known.estimates is not None
    assert 1500 <= len(known.estimates) <= 3000
    assert run.document()["span"] == pytest.approx(240.0, abs=0.1)


def test_pictures_are_noted_once_a_second_and_thinned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr("trailmark.watching.notes.time.monotonic", lambda: now[0])
    notes = LiveNotes(tmp_path)
    notes._began_s = 5.0
    for n in range(700):
        now[0] += 0.25
        notes._take_picture(Frame("eye", 5.0 + 0.25 * n, Image(np.full((40, 900), n % 250, dtype=np.uint8))))
        notes.write()

    found = [PICTURE_NAME.fullmatch(path.name) for path in (tmp_path / "pictures").iterdir()]
    times = sorted(float(match[2]) for match in found if match)

    assert len(times) == len(found)
    assert 20 <= len(times) <= 40
    assert times[0] == 0.0
    assert times[-1] >= 0.25 * 700 - 1.5


def test_a_source_that_cannot_say_the_truth_yet_is_asked_no_more(tmp_path: Path) -> None:
    class Source:
        n_asked = 0

        def ground_truth(self) -> None:
            self.n_asked += 1
            raise RuntimeError("not before the end")

    class Parts:
        sources = (Source(),)

    class Run:
        parts = Parts()

    notes = LiveNotes(tmp_path)
    notes._ask_for_truth(Run())

    assert notes._truth_at_s == float("inf")
