"""What the pages of runs and robots show, and when they are over."""

from __future__ import annotations

import io
import json
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from trailmark.errors import DataError
from trailmark.watching import beside
from trailmark.watching.robot import WatchedRobot
from trailmark.watching.run_state import writing_of
from trailmark.watching.watched import WatchedRun
from trailmark.writing import write_whole

#: Begins a run in the folder that it is told, and goes on until it is told to end.
RUN = """
import json, pathlib, sys, time
folder = pathlib.Path(sys.argv[1])
folder.mkdir(parents=True)
(folder / "estimates.csv").write_text(sys.argv[2])
try:
    (folder / "run.json").write_text(json.dumps({"status": "running"}))
    time.sleep(60)
except KeyboardInterrupt:
    (folder / "run.json").write_text(json.dumps({"status": "interrupted"}))
    sys.exit(130)
"""


def wait_for(condition: Callable[[], bool]) -> None:
    until_s = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < until_s
        time.sleep(0.02)


def has_begun(folder: Path) -> bool:
    path = folder / "run.json"
    return path.exists() and bool(path.read_text())


def raises(error: Exception) -> Callable[[], bool]:
    """Return what fails that way."""

    def fail() -> bool:
        raise error

    return fail


def newest(shown: WatchedRun | WatchedRobot) -> dict:
    shown._look()
    shown.show()
    return json.loads(shown.state(-1) or b"{}")


def test_a_run_is_told_from_its_beginning_to_its_end(watched, tmp_path: Path) -> None:
    folder, is_there = tmp_path / "run", [True]
    shown = WatchedRun(folder, "secret", is_there=lambda: is_there[0], process=1)
    assert newest(shown)["status"] == "beginning"

    shutil.copytree(watched.folder, folder)
    ended = (folder / "run.json").read_text()
    (folder / "run.json").write_text(json.dumps({"status": "running"}))
    running = newest(shown)
    assert (running["status"], running["isLive"], running["can"]) == ("running", True, ["stop"])
    assert running["explorer"]["isGoingOn"]
    assert running["health"]["rows"][0][0] == "wheels"

    (folder / "run.json").write_text(ended)
    assert newest(shown)["status"] == "interrupted: metrics and report are being made"
    assert not shown.has_ended()

    is_there[0] = False
    (folder / "report.html").write_text("<p>report</p>")
    last = newest(shown)
    assert (last["status"], last["isOver"], last["can"]) == ("ended: interrupted", True, [])
    assert last["note"].endswith("report.html")
    assert last["hasReport"]
    assert shown.report() == b"<p>report</p>"
    assert not last["explorer"]["isGoingOn"]
    assert shown.has_ended()
    assert not shown.has_told()  # the page that has just been told asks for the report now


def test_nothing_new_is_not_told_again(watched) -> None:
    shown = WatchedRun(watched.folder, "secret")
    newest(shown)  # of a run that has ended: that it has, at once, and then what its report shows
    number = newest(shown)["number"]

    shown._look()
    shown.show()

    assert shown.state(number) is None


def test_a_run_that_was_killed_is_not_waited_for(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(json.dumps({"status": "running"}))
    shown = WatchedRun(tmp_path, "secret", is_there=lambda: False, process=1)

    assert newest(shown)["status"] == "ended without a word"
    assert shown.has_ended()
    assert shown.press("stop") == "the run has ended"


@pytest.mark.parametrize(
    ("error", "why"),
    [
        (DataError("row 7 is torn"), "row 7 is torn"),
        (OSError(28, "disk full"), "[Errno 28] disk full"),
        (ValueError("no JSON of nan"), "ValueError: no JSON of nan"),
    ],
)
def test_a_page_that_cannot_go_on_says_why_and_ends(
    watched, monkeypatch: pytest.MonkeyPatch, error: Exception, why: str
) -> None:
    shown = WatchedRun(watched.folder, "secret", process=1)
    before = newest(shown)
    monkeypatch.setattr(shown, "_look", raises(error))
    assert not shown.has_ended()

    shown._look_again_and_again()

    last = json.loads(shown.state(before["number"]) or b"{}")
    assert last["note"] == f"the page stands still: {why}"
    assert (last["isLive"], last["isOver"], last["can"]) == (False, True, [])
    assert last["explorer"] == before["explorer"]
    assert shown.has_ended()


def test_a_page_that_cannot_begin_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = WatchedRun(tmp_path, "secret")
    monkeypatch.setattr(shown, "_look", raises(ValueError("torn")))

    shown._look_again_and_again()

    assert json.loads(shown.state(-1) or b"{}")["note"] == "the page stands still: ValueError: torn"
    assert shown.has_ended()


def test_the_page_of_a_robot_that_stands_still_can_stop_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = WatchedRobot("robot.yaml", "secret", lambda task, folder, notes: [], lambda task: tmp_path / task)
    try:
        monkeypatch.setattr(shown, "_look", raises(ValueError("torn")))
        shown._look_again_and_again()
        told = json.loads(shown.state(-1) or b"{}")
    finally:
        shown.close()

    assert (told["isOver"], "stop" in told["can"], told["name"]) == (False, True, "robot.yaml")


def test_a_picture_is_one_of_the_runs(watched, tmp_path: Path) -> None:
    notes = tmp_path / "notes"
    (notes / "pictures").mkdir(parents=True)
    (notes / "pictures" / "eye_1.00s.jpg").write_bytes(b"jpeg")
    (notes / "pictures" / "eye_2.00s.jpg").symlink_to(tmp_path / "secret")
    (tmp_path / "secret").write_bytes(b"secret")
    shown = WatchedRun(watched.folder, "secret", notes=notes)

    assert shown.picture("eye_1.00s.jpg") == b"jpeg"
    for name in ("eye_2.00s.jpg", "eye_3.00s.jpg", "../run.json", "run.json", ""):
        assert shown.picture(name) is None


def test_the_buttons_of_a_robot_begin_and_stop_runs(watched, tmp_path: Path) -> None:
    head = (watched.folder / "estimates.csv").read_text().splitlines(keepends=True)[0]

    def command_of(task: str, folder: Path, notes: Path) -> list[str]:
        (notes / "outlines.json").write_text('{"around": []}')
        return [sys.executable, "-S", "-c", RUN, str(folder), head]

    shown = WatchedRobot("robot.yaml", "secret", command_of, lambda task: tmp_path / task)
    try:
        first = newest(shown)
        assert (first["status"], first["can"], first["name"]) == ("idle", ["teach", "replay"], "robot.yaml")

        assert shown.press("teach") == ""
        assert shown.press("replay") == "replay is refused: teach is going on"
        assert "no button" in shown.press("shutdown")
        wait_for(lambda: has_begun(tmp_path / "teach"))
        going_on = newest(shown)
        assert (going_on["status"], going_on["can"], going_on["name"]) == ("teach", ["stop"], "teach")

        assert shown.press("stop") == ""
        stopped = newest(shown)
        assert (stopped["status"], stopped["isOver"]) == ("idle: teach was stopped", False)
        assert json.loads((tmp_path / "teach" / "run.json").read_text())["status"] == "interrupted"

        assert shown.press("replay") == ""
        wait_for(lambda: has_begun(tmp_path / "replay"))
    finally:
        shown.close()
    assert json.loads((tmp_path / "replay" / "run.json").read_text())["status"] == "interrupted"


@pytest.mark.parametrize("button", ["teach", "stop"])
def test_a_folder_that_is_watched_has_no_buttons(watched, button: str) -> None:
    assert "there is no button" in WatchedRun(watched.folder, "secret").press(button)


def test_the_run_before_it_in_its_folder_is_not_shown(watched, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(watched.folder, folder)
    (folder / "run.json").write_text(json.dumps({"status": "done"}))
    shown = WatchedRun(folder, "secret", process=1, earlier=writing_of(folder))
    assert newest(shown)["status"] == "beginning"

    shutil.rmtree(folder)
    assert newest(shown)["status"] == "beginning"
    shutil.copytree(watched.folder, folder)
    write_whole(folder / "run.json", json.dumps({"status": "running"}))

    assert newest(shown)["status"] == "running"


def test_a_page_beside_a_run_is_told_which_run_is_not_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = io.BytesIO()
    monkeypatch.setattr(told, "close", lambda: None)
    child = SimpleNamespace(stdin=told, poll=lambda: None)
    monkeypatch.setattr(beside.subprocess, "Popen", lambda *args, **options: child)
    (tmp_path / "run.json").write_text(json.dumps({"status": "done"}))

    with beside.page_beside(tmp_path, 0) as (_, notes):
        notes.rmdir()

    assert tuple(json.loads(told.getvalue())["earlier"]) == writing_of(tmp_path)
