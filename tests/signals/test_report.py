"""`trailmark report`: what a run had no time for, and what it makes itself."""

from __future__ import annotations

import hashlib
import math
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from trailmark.cli import main

WHEELS = """
sources: {wheels: {plugin: csv_odometry, path: wheels.csv, ground_truth: truth.tum}}
localizers: {wheels: {plugin: odometry}}
"""


def files_of(folder: Path) -> dict[str, str]:
    """Return every file of a folder with its digest."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture
def wheels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A config of a circle that wheels drive, in the working folder."""
    monkeypatch.chdir(tmp_path)
    poses = [(0.05 * i, 2 * math.sin(0.0125 * i), 2 - 2 * math.cos(0.0125 * i), 0.0125 * i) for i in range(200)]
    Path("wheels.csv").write_text("t,x,y,theta\n" + "".join(f"{t},{x},{y},{a}\n" for t, x, y, a in poses))
    quats = [(t, x, y, math.sin(a / 2), math.cos(a / 2)) for t, x, y, a in poses]
    Path("truth.tum").write_text("".join(f"{t} {x + 0.01} {y} 0 0 0 {s} {c}\n" for t, x, y, s, c in quats))
    (tmp_path / "c.yaml").write_text(WHEELS)
    return tmp_path


def trailmark(*words: str) -> int:
    """Run a command in this process, and return its exit code."""
    with pytest.raises(SystemExit) as left:
        main([*words, "--progress", "none"] if words[0] in ("run", "teach", "replay") else list(words))
    return int(left.value.code or 0)


@pytest.mark.parametrize("mode", ["run", "replay"])
def test_the_report_of_a_run_is_the_same_to_the_byte(wheels: Path, mode: str) -> None:
    store = ()
    if mode == "replay":
        assert trailmark("teach", "c.yaml", "--store", "a.trail", "--out", "taught", "--no-report") == 0
        store = ("--store", "a.trail")
    assert trailmark(mode, "c.yaml", "--out", "out", *store) == 0
    before = files_of(wheels / "out")
    made = [name for name in before if name.startswith("plots/") or name in ("report.html", "metrics.json")]
    for name in made:
        (wheels / "out" / name).unlink()

    assert trailmark("report", "out") == 0

    assert len(made) >= 4
    assert files_of(wheels / "out") == before


def test_an_interrupted_run_gets_its_report_later(start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    child = start("run", "c.yaml", "--out", "out", "--set", "localizers.mover.at=5")
    child.wait_for_output("here")
    child.send(signal.SIGTERM)
    assert child.end() == 143
    assert not (tmp_path / "out/report.html").exists()
    monkeypatch.chdir(tmp_path)

    assert trailmark("report", "out") == 0

    page = (tmp_path / "out/report.html").read_text()
    assert "Interrupted" in page
    assert "interrupted by SIGTERM" in page
    # They are written if there is time for it, which a busy machine may not have.
    assert ("What the cameras saw" in page) == (tmp_path / "out/pictures").is_dir()
    assert len(list((tmp_path / "out/plots").glob("*.svg"))) >= 2


def test_a_run_that_was_killed_gets_a_report_of_what_there_is(start, tmp_path: Path, capsys) -> None:
    child = start("run", "c.yaml", "--out", "out")
    child.wait_for(lambda: child.is_under_way)
    child.send(signal.SIGKILL)
    assert child.end() == -signal.SIGKILL

    assert trailmark("report", str(tmp_path / "out")) == 0

    assert (tmp_path / "out/report.html").exists()


def test_a_folder_of_something_else_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert trailmark("report", str(tmp_path)) == 2
    assert "is not the folder of a run" in capsys.readouterr().err


def test_the_signals_are_heard_under_nohup_too(tmp_path: Path) -> None:
    """What is ignored by inheritance would be ignored by every child: `tests/conftest.py` sees to that."""
    code = "import signal, subprocess, sys; signal.signal(signal.SIGINT, signal.SIG_IGN);"
    code += "signal.signal(signal.SIGHUP, signal.SIG_IGN); sys.exit(subprocess.call(sys.argv[1:]))"
    test = "tests/cli/test_run.py::test_ctrl_c_keeps_what_is_done_and_says_so"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", test]

    done = subprocess.run(
        [sys.executable, "-c", code, *command],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTEST_XDIST_WORKER": ""},
    )

    assert done.returncode == 0, done.stdout
