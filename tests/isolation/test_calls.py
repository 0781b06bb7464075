"""Calls as cells: in order, resumed, and ended together when one fails."""

from __future__ import annotations

import json
import operator
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

from trailmark.errors import RunError
from trailmark.experiments import ExperimentOptions, Row
from trailmark.geometry import Pose2
from trailmark.isolation.calls import ANSWER_FILE, call_in_cells, read_plain, write_plain


def options(folder: Path, jobs: int = 1, **more) -> ExperimentOptions:
    return ExperimentOptions(quick=True, seed=0, out=folder, report=more.pop("report", print), jobs=jobs, is_kept=True)


@pytest.mark.parametrize("jobs", [1, 2])
def test_answers_come_in_order_and_what_was_raised_is_raised(tmp_path: Path, jobs: int) -> None:
    assert options(tmp_path, jobs).map(operator.sub, [(5, 1), (9, 2), (3, 3)]) == [4, 7, 0]

    with pytest.raises(ZeroDivisionError, match="division by zero"):
        options(tmp_path, jobs).map(operator.truediv, [(1, 1), (1, 0)])


@pytest.mark.parametrize("jobs", [1, 2])
def test_answers_that_are_there_are_taken(tmp_path: Path, jobs: int) -> None:
    marks = tmp_path / "marks"
    marks.mkdir()
    lines: list[str] = []
    calls = [(str(marks / "a"),), (str(marks / "b"),)]
    options(tmp_path, jobs).map(os.mkdir, calls[:1])

    options(tmp_path, jobs, report=lines.append).map(os.mkdir, calls)  # a second time it would fail

    assert sorted(path.name for path in marks.iterdir()) == ["a", "b"]
    assert lines == ["1 of 2 answers of an interrupted run are taken"]


def test_equal_calls_are_one(tmp_path: Path) -> None:
    """They would write into one folder at the same time."""
    first, second, other = call_in_cells(tempfile.mktemp, [("a",), ("a",), ("b",)], tmp_path, jobs=2)

    assert first == second  # a name drawn at random
    assert other.endswith("b")


def test_a_call_that_crashes_is_told_with_its_arguments(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"signal:raise_signal\(11,\) crashed: ended by SIGSEGV"):
        call_in_cells(signal.raise_signal, [(11,), (11,)], tmp_path, jobs=2)


def test_answers_may_hold_arrays_and_values_of_trailmark(tmp_path: Path) -> None:
    answer = {"pose": Pose2(1.0, 2.0, 3.0), "array": np.arange(6.0).reshape(2, 3), "path": tmp_path, "none": None}
    answer |= {"scalar": np.float32(0.1), "row": Row("e", "i", "mm", float("inf")), 3: (1, {2, 3}, b"x", 1j, {})}
    write_plain(tmp_path / ANSWER_FILE, answer)

    found = read_plain(tmp_path / ANSWER_FILE, "trailmark_some")

    np.testing.assert_array_equal(found["array"], answer["array"])
    assert {key: found[key] for key in answer if key != "array"} == {
        key: answer[key] for key in answer if key != "array"
    }
    assert type(found["scalar"]) is np.float32
    assert type(found["row"]) is Row


@pytest.mark.parametrize(
    "content",
    [
        *('{"fields": ["subprocess:Popen", {"args": "true"}]}', '{"enum": ["os:system", "true"]}', "[[[", "{}"),
        *('{"fields": ["trailmark.isolation.process:IsolatedProcess", {}]}', "{}"),
        '{"named": ["trailmark.isolation.calls:json", []]}',
        *('{"array": "k05VTVBZ"}', '{"fields": ["trailmark.geometry.se2:Pose2", {"x": 1}]}', '{"a": 1, "b": 2}'),
        *("[" * 5000, '{"call": ["os:system", "true"]}', "\x80\x04cos\nsystem\n(S'true'\ntR."),
    ],
)
def test_an_answer_runs_no_code(tmp_path: Path, content: str) -> None:
    (tmp_path / ANSWER_FILE).write_text(content)

    with pytest.raises(RunError, match="holds no answer that can be read"):
        read_plain(tmp_path / ANSWER_FILE, "trailmark")


def test_what_is_no_plain_data_is_not_written(tmp_path: Path) -> None:
    for value in (object(), np.array([object()]), print, [lambda: None]):
        with pytest.raises(TypeError):
            write_plain(tmp_path / ANSWER_FILE, value)
    assert not list(tmp_path.iterdir())


PLUGIN = """
import os, pathlib, time
from trailmark import hookimpl
from trailmark.experiments import Row

def slow(folder, name):
    mark = pathlib.Path(folder, name)
    mark.write_text(mark.read_text() + "x" if mark.exists() else "x")
    if name == "c" and not pathlib.Path(folder, "go").exists():
        print("waiting", flush=True)
        time.sleep(60)
    return len(name)

def toy(options):
    found = options.map(slow, [(str(options.out.parent), name) for name in "abcd"])
    return [Row("toy", "letters", "", float(sum(found)), bar=9.0)]

@hookimpl
def trailmark_register(registry):
    registry.experiment("toy", ":toy", summary="A toy")
"""


def test_an_interrupted_reproduction_goes_on_and_a_finished_one_begins_anew(tmp_path: Path) -> None:
    (tmp_path / "plugin.py").write_text(PLUGIN)
    command = [sys.executable, "-m", "trailmark.cli", "--plugin", str(tmp_path / "plugin.py"), "reproduce", "toy"]
    command += ["--out", str(tmp_path / "out"), "--json"]
    interrupted = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert interrupted.stdout is not None
    assert interrupted.stdout.readline() == "waiting\n"
    interrupted.kill()
    interrupted.wait()
    interrupted.stdout.close()
    (tmp_path / "out" / "go").touch()

    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    counts = [len((tmp_path / "out" / name).read_text()) for name in "abcd"]
    subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    again = [len((tmp_path / "out" / name).read_text()) for name in "abcd"]

    assert json.loads(done.stdout)[0]["ours"] == 4.0
    assert "2 of 4 answers of an interrupted run are taken" in done.stderr
    assert counts == [1, 1, 2, 1]
    assert again == [2, 2, 3, 2]
