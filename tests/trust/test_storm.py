"""A share of the hostile commands in each run of the tests, and what makes a finding; the whole by `make trust`."""

from __future__ import annotations

import copy
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import click
import numpy as np
import pytest
from tests.trust.records import CaseRecord, Records
from tests.trust.storm import cases
from tests.trust.storm.arguments import commands, grown_arguments
from tests.trust.storm.box import FILES, Box
from tests.trust.storm.damage import spoil_bytes, spoil_records
from tests.trust.storm.oracle import GOOD_STORE, N_WAYPOINTS, Ending, findings_of, n_waypoints
from tests.trust.storm.worker import run_case
from tests.trust.storm.workers import Worker

N_CASES = 3


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> Box:
    return Box(tmp_path_factory.mktemp("box") / "box")


def ending(code: object = 0, out: str = "", err: str = "", **more: object) -> Ending:
    known = {"arguments": ("run", "c.yaml"), "cpu_s": 0.1, "peak_mib": 300.0}
    return Ending(code=code, out=out, err=err, **(known | more))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("target", sorted(cases.TARGETS))
def test_hostile_commands_are_answered(box: Box, target: str) -> None:
    run_case(target, 0, box, patience_s=100.0)  # imports and compiles what is needed on first use
    found = {number: run_case(target, number, box)[1] for number in range(N_CASES)}

    assert not any(found.values()), found


@pytest.mark.slow
def test_good_input_is_accepted(box: Box, tmp_path: Path, monkeypatch) -> None:
    """The box is good, or all refusals would prove nothing."""
    from click.testing import CliRunner

    from trailmark.cli.root import ChosenPlugins, root

    box.copy(FILES, tmp_path)
    monkeypatch.chdir(tmp_path)
    for call in (
        ["run", "run.yaml", "--out", "out", "--no-report"],
        ["inspect", "drive.bag"],
        ["inspect", "drive.mcap"],
        ["inspect", "drive_db3"],
        ["inspect", "rgbd"],
        ["inspect", "kitti"],
        ["inspect", "log.clf"],
        ["inspect", "film.avi"],
        ["store", "check", GOOD_STORE],
        ["compare", "done"],
        ["evaluate", "truth.tum", "truth.tum"],
        ["watch", "done", "--once"],
    ):
        answer = CliRunner().invoke(root, call, obj=ChosenPlugins())

        assert answer.exit_code == 0, (call, answer.output, answer.exception)


def test_a_case_is_made_from_its_number_alone(box: Box, tmp_path: Path) -> None:
    before = copy.deepcopy(cases.SOURCES)
    made = []
    for turn in range(2):
        for number in range(5):
            (tmp_path / f"{turn}-{number}").mkdir()
            call, _ = cases.TARGETS["config"](np.random.default_rng(number), tmp_path / f"{turn}-{number}", box)
            texts = [path.read_bytes() for path in (tmp_path / f"{turn}-{number}").glob("c.*")]
            made.append((call, texts))

    assert made[:5] == made[5:]
    assert before == cases.SOURCES


@pytest.mark.parametrize(
    ("end", "words"),
    [
        (ending(1, err="Traceback (most recent call last):\n ..."), "Traceback"),
        (ending(1, err="trailmark: internal error: x is wrong"), "internal error"),
        (ending(1), "without a word"),
        (ending(2, err="trailmark: no"), "hardly a word"),
        (ending(2, err="trailmark: a.csv: 'NoneType' object has no attribute 'x'"), "NoneType"),
        (ending("RuntimeError ..."), "ended with"),
        (ending(139), "ended with 139"),
        (ending(peak_mib=4000.0), "took 4000 MiB"),
        (ending(was_stopped=True), "still at it"),
    ],
)
def test_what_a_user_should_not_see_is_a_finding(tmp_path: Path, end: Ending, words: str) -> None:
    assert words in " ".join(findings_of(end, tmp_path))


@pytest.mark.parametrize(
    ("counters", "err", "n"),
    [
        ('{"frames": 0}', "", 1),
        ('{"frames": 9, "localizer.a.refused": 9}', "", 1),
        ('{"frames": 9, "localizer.a.refused": 9}', "WARNING: no estimate was used", 0),
        ('{"frames": 9, "localizer.a.accepted": 8}', "", 0),
    ],
)
def test_a_run_that_used_nothing_without_a_word_is_a_finding(tmp_path: Path, counters: str, err: str, n: int) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out/run.json").write_text(f'{{"counters": {counters}}}')

    assert len(findings_of(ending(err=err), tmp_path)) == n


def test_a_waypoint_that_is_gone_is_a_finding(box: Box, tmp_path: Path) -> None:
    import sqlite3

    box.copy((GOOD_STORE,), tmp_path)
    assert n_waypoints(tmp_path / GOOD_STORE) == N_WAYPOINTS
    assert findings_of(ending(), tmp_path) == []
    with sqlite3.connect(tmp_path / GOOD_STORE) as store:
        store.execute("DELETE FROM waypoints WHERE id = 3")
    store.close()

    assert findings_of(ending(), tmp_path) == ["11 of 12 waypoints are left"]


def test_a_hang_is_a_finding(box: Box, monkeypatch) -> None:
    monkeypatch.setattr("tests.trust.storm.worker.PATIENCE_S", 0.2)

    def spin(arguments: list[str]) -> None:
        while time.process_time() > 0:
            pass

    monkeypatch.setattr("trailmark.cli.main", spin)

    assert "still at it" in run_case("surroundings", 0, box)[1][0]


def test_what_is_written_outside_is_a_finding(box: Box, monkeypatch) -> None:
    monkeypatch.setattr("trailmark.cli.main", lambda arguments: Path(os.pardir, "outside").touch())

    assert "wrote outside of its folder" in " ".join(run_case("surroundings", 0, box)[1])


def test_arguments_come_from_the_commands_of_the_program() -> None:
    known = commands()
    rng = np.random.default_rng(7)

    assert {"run", "store check", "bench merge", "plugins new"} <= set(known)
    assert not {"demo", "reproduce", "bench run"} & set(known)
    for words, command in known.items():
        assert grown_arguments(words, command, FILES, rng)[: 1 + words.count(" ")] != []
        assert isinstance(command, click.Command)


def test_damage_changes_what_it_damages() -> None:
    text = "t,x,y,theta\n" + "".join(f"{i},{i},0,0\n" for i in range(20))
    data = bytes(range(256)) * 8

    n_texts = sum(spoil_records(text, np.random.default_rng(n)) != text for n in range(50))
    n_bytes = sum(spoil_bytes(data, np.random.default_rng(n)) != data for n in range(50))

    assert n_texts > 40
    assert n_bytes > 40


class TestRecords:
    """Work that is cut off goes on where it was, and what was mended is tried again."""

    def test_what_has_passed_is_known_when_the_file_is_read_again(self, tmp_path: Path) -> None:
        records = Records(tmp_path / "storm.jsonl")
        records.add(CaseRecord("config", 1, "0", cpu_s=0.5, peak_mib=300.0, commit="abc"))
        records.add(CaseRecord("config", 2, "2", findings=("config 2: failed without a word",), commit="abc"))
        records.add(CaseRecord("store", 1, "1", cpu_s=0.25, commit="abc"))

        again = Records(tmp_path / "storm.jsonl")

        assert [again.has_passed("config", n) for n in (1, 2, 3)] == [True, False, False]
        assert again.tallies() == records.tallies()
        assert again.tallies()["config"].ended == {"0": 1, "2": 1}
        assert again.commits() == "abc (3)"

    def test_the_last_record_of_a_case_counts(self, tmp_path: Path) -> None:
        for findings in (("a", "b"), ()):
            Records(tmp_path / "storm.jsonl").add(CaseRecord("config", 2, "2", findings=findings))

        assert Records(tmp_path / "storm.jsonl").tallies()["config"].findings == []


@pytest.fixture
def as_worker(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Lets a program of a few lines serve in the place of a worker."""

    def serve(program: str) -> None:
        start = subprocess.Popen
        command = (sys.executable, "-c", program)
        monkeypatch.setattr("tests.trust.storm.workers.subprocess.Popen", lambda _, **keys: start(command, **keys))

    return serve


class TestWaiting:
    """A worker that waits without working hangs; one that others keep from the processor does not."""

    @pytest.fixture
    def worker(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Worker]:
        monkeypatch.setattr("tests.trust.storm.workers._LOOK_S", 0.05)
        monkeypatch.setattr("tests.trust.storm.workers.WAITING_S", 0.5)
        worker = Worker(tmp_path)
        yield worker
        worker.close()

    def test_what_sleeps_has_hung(self, worker: Worker, as_worker: Callable[[str], None]) -> None:
        as_worker("import time; time.sleep(60)")

        assert "no answer" in worker.run("config", 1)["findings"][0]

    def test_what_works_is_waited_for(self, worker: Worker, as_worker: Callable[[str], None]) -> None:
        as_worker("import time\nwhile time.process_time() < 1.5: pass\nprint('{\"findings\": []}')")

        assert worker.run("config", 1) == {"findings": []}
