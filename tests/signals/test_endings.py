"""However a command is told to end: the robot is stopped, its folder is whole, and it is gone within two seconds."""

from __future__ import annotations

import csv
import json
import math
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from tests.signals.conftest import CONFIG, PLUGIN

from trailmark.evaluation import read_run
from trailmark.pipeline import Pipeline

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="ends are waited for by pidfd")

Start = Callable[..., "object"]
SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT]
LIMIT_S = 2.0

PLAYED = """
sources: {robot: {plugin: toy_robot, live: false}}
localizers: {mover: {plugin: toy_mover}}
controller: toy_driver
"""


def is_whole(folder: Path) -> bool:
    """Return whether a run's folder can be read without a complaint, and ends with whole rows."""
    run = read_run(folder)
    rows = list(csv.reader((folder / "estimates.csv").open(encoding="utf-8")))
    return not run.problems and len({len(row) for row in rows}) == 1 and not list(folder.rglob("*.part"))


@pytest.mark.parametrize(
    ("command", "number"),
    [
        *(("run", number) for number in SIGNALS),
        ("run", signal.SIGUSR1),
        ("run", signal.SIGXCPU),
        ("teach", signal.SIGTERM),
        ("teach", signal.SIGHUP),
        ("replay", signal.SIGTERM),
    ],
)
def test_a_robot_is_stopped_and_closed_and_its_run_is_written(start, command: str, number: int, tmp_path: Path) -> None:
    if command == "replay":
        teach = start("teach", "c.yaml", "--store", "a.trail", "--out", "taught", "--set", "sources.robot.n=20")
        teach.send(0)
        assert teach.end() == 0, teach.stderr
        (tmp_path / "robot.log").unlink()
    store = () if command == "run" else ("--store", "a.trail")
    child = start(command, "c.yaml", "--out", "out", "--set", "localizers.mover.at=5", *store)
    child.wait_for_output("here")
    if command != "teach":
        child.wait_for(lambda: child.is_under_way)
    child.send(number)

    assert child.end() == 128 + number
    assert child.took_less_than(LIMIT_S)
    told = child.told()
    assert told[-1] == "close"
    assert told[-2].startswith("drive Stop interrupted by")
    name = signal.Signals(number).name
    assert child.run_document()["status"] == "interrupted"
    assert name in child.run_document()["reason"]
    assert len(read_run(tmp_path / "out").trajectories["fused"]) >= 4
    assert is_whole(tmp_path / "out")
    assert "Traceback" not in child.stderr
    assert "trailmark report " in child.stderr


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_recording_is_kept_and_plays_again(start, number: int, tmp_path: Path) -> None:
    child = start("record", "c.yaml", "--out", "out", "--set", "sources.robot.drives_itself=true")
    child.wait_for((tmp_path / "out/eye/000010.png").exists)
    child.send(number)

    assert child.end() == 128 + number
    assert child.took_less_than(LIMIT_S)
    assert "what came before is kept" in child.stderr
    frames = len((tmp_path / "out/eye/timestamps.txt").read_text().splitlines())
    with Pipeline(tmp_path / "out/config.yaml") as pipeline:
        assert len([step for step in pipeline if step.frame]) == frames >= 10


def test_a_demo_ends_at_its_first_half(start, tmp_path: Path) -> None:
    child = start("demo", "--out", "demo")
    child.wait_for((tmp_path / "demo/teach/estimates.csv").exists, 300.0)
    child.send(signal.SIGTERM)

    assert child.end() == 128 + signal.SIGTERM
    assert child.took_less_than(LIMIT_S)
    assert child.run_document("demo/teach")["status"] == "interrupted"
    assert not (tmp_path / "demo/replay").exists()


def test_what_is_ignored_stays_ignored(start, tmp_path: Path) -> None:
    """As under nohup, and in the background of a shell."""
    child = start("run", "c.yaml", "--out", "out", ignored=(signal.SIGHUP, signal.SIGINT))
    child.wait_for(lambda: child.is_under_way)
    for number in (signal.SIGHUP, signal.SIGINT):
        child.send(number)
    n = len(child.told())
    child.wait_for(lambda: len(child.told()) > n + 5)
    child.send(signal.SIGTERM)

    assert child.end() == 128 + signal.SIGTERM


def test_two_signals_at_once_are_one(start, tmp_path: Path) -> None:
    """As of `timeout`, which signals the process and then its group."""
    child = start("run", "c.yaml", "--out", "out")
    child.wait_for(lambda: child.is_under_way)
    child.send(signal.SIGTERM)
    child.process.send_signal(signal.SIGHUP)

    assert child.end() in (128 + signal.SIGTERM, 128 + signal.SIGHUP)
    assert "at the second signal" not in child.stderr
    assert child.told()[-1] == "close"


class TestWhatHangs:
    """Two seconds hold whatever the parts do; the robot is stopped at once by another thread."""

    @pytest.mark.parametrize(
        "change",
        [
            "localizers.mover.hangs=observe",
            "localizers.mover.hangs=stubbornly",
            "sources.robot.hangs=close",
            "sources.robot.hangs=close stubbornly",
            "sources.robot.hangs=drive",
        ],
    )
    def test_it_is_not_waited_for(self, start, change: str, tmp_path: Path) -> None:
        child = start("run", "c.yaml", "--out", "out", "--set", change, "--set", "stop_when.stall_s=null")
        child.wait_for_output("here") if "mover" in change else child.wait_for(
            lambda: child.told().count("drive Velocity") >= 5
        )
        sent_s = time.monotonic()
        child.send(signal.SIGTERM)

        assert child.end(may_be_cut_off=True) == 128 + signal.SIGTERM
        assert child.took_less_than(LIMIT_S)
        assert child.told_at_s("drive Stop") - sent_s < 0.3 * child.load
        assert child.run_document()["status"] == "interrupted"
        assert len(read_run(tmp_path / "out").trajectories["fused"]) >= 2
        assert is_whole(tmp_path / "out")

    def test_a_localizer_that_trains_for_long_is_left_to_the_next_run(self, start, tmp_path: Path) -> None:
        words = ("teach", "c.yaml", "--out", "out", "--store", "a.trail", "--set", "localizers.mover.hangs=finish")
        child = start(*words, "--set", "sources.robot.n=30", config=PLAYED)
        child.wait_for_output("here")
        child.send(signal.SIGINT)

        assert child.end() == 130
        assert child.took_less_than(LIMIT_S)
        assert child.run_document()["reason"].startswith("interrupted by the user (SIGINT)")
        assert (tmp_path / "a.trail").exists()


def test_a_second_signal_leaves_at_once(start, tmp_path: Path) -> None:
    child = start("run", "c.yaml", "--out", "out", "--set", "localizers.mover.hangs=stubbornly")
    child.wait_for_output("here")
    child.process.send_signal(signal.SIGINT)
    time.sleep(0.4)
    child.send(signal.SIGINT)

    assert child.end() == 130
    assert child.took_less_than(0.9)  # the deadline comes 1 s after it
    assert "at the second signal" in child.stderr
    assert child.told()[-1].startswith("drive Stop")
    assert child.run_document()["status"] == "interrupted"
    assert is_whole(tmp_path / "out")


@pytest.mark.parametrize("delay_s", np.linspace(0.02, 1.6, 12).round(2).tolist())
def test_ctrl_c_at_any_instant_of_a_start_ends_it(start, delay_s: float, tmp_path: Path) -> None:
    """While it imports, loads plugins, opens parts, and begins."""
    child = start("run", "c.yaml", "--out", "out")
    time.sleep(delay_s)
    child.send(signal.SIGINT)

    code = child.end()
    began = code in (-signal.SIGINT, 1) and "in call_until_signal" not in child.stderr  # before anybody hears it
    assert code == 130 or began
    assert child.took_less_than(LIMIT_S)
    if child.told():
        assert child.told()[-1] == "close"
    if (tmp_path / "out/run.json").exists():
        assert child.run_document()["status"] == "interrupted"


def test_a_start_that_takes_long_is_cut_off(start, tmp_path: Path) -> None:
    child = start("run", "c.yaml", "--out", "out", "--set", "sources.robot.slow_start_s=60")
    child.wait_for(lambda: "start" in child.told())
    child.send(signal.SIGINT)

    assert child.end() == 130
    assert child.took_less_than(LIMIT_S)
    assert child.told() == ["start", "close"], child.stderr
    assert not (tmp_path / "out").exists()


def test_ctrl_c_while_the_report_is_drawn_keeps_everything_else(start, tmp_path: Path) -> None:
    child = start("run", "c.yaml", "--out", "out", "--set", "sources.robot.n=200", config=PLAYED)
    child.wait_for((tmp_path / "out/metrics.json").exists)
    time.sleep(0.2)  # drawing takes a second and more
    child.send(signal.SIGINT)

    assert child.end() == 130
    assert child.took_less_than(LIMIT_S)
    assert child.run_document()["status"] == "done"
    assert json.loads((tmp_path / "out/metrics.json").read_text())["trajectories"]["fused"]["poses"] == 200
    assert "trailmark report " in child.stderr
    assert is_whole(tmp_path / "out")


class TestSuspending:
    """Ctrl-Z stops the robot before the process stands still, and `fg` lets it drive on."""

    def test_the_robot_stands_until_the_run_goes_on(self, start) -> None:
        child = start("run", "c.yaml", "--out", "out", "--set", "sources.robot.rate_hz=200")
        child.wait_for(lambda: child.is_under_way)
        for n_suspended in (1, 2):
            child.send(signal.SIGTSTP)
            child.wait_for(lambda: child.is_suspended)
            told = child.told()
            assert told[-1] == "drive Stop suspended by SIGTSTP"
            assert told.count(told[-1]) == n_suspended
            time.sleep(0.1)
            assert child.told() == told
            child.process.send_signal(signal.SIGCONT)
            n = child.told().count("drive Velocity")
            child.wait_for(lambda n=n: child.told().count("drive Velocity") > n + 5)
        child.send(signal.SIGTERM)

        assert child.end() == 128 + signal.SIGTERM
        assert child.told()[-1] == "close"
        assert child.run_document()["counters"]["control.stall_stops"] == 2

    def test_a_suspended_run_ends_when_it_goes_on(self, start) -> None:
        child = start("run", "c.yaml", "--out", "out")
        child.wait_for(lambda: child.is_under_way)
        child.process.send_signal(signal.SIGTSTP)
        child.wait_for(lambda: child.is_suspended)
        child.send(signal.SIGTERM)
        child.process.send_signal(signal.SIGCONT)

        assert child.end() == 128 + signal.SIGTERM
        assert child.told()[-1] == "close"

    def test_a_robot_whose_time_stands_still_is_not_told(self, start) -> None:
        child = start("run", "c.yaml", "--out", "out", config=PLAYED)
        child.wait_for(lambda: child.is_under_way)
        child.process.send_signal(signal.SIGTSTP)
        child.wait_for(lambda: child.is_suspended)

        assert not any(line.startswith("drive Stop") for line in child.told())

    def test_it_is_ignored_where_it_was(self, start) -> None:
        child = start("run", "c.yaml", "--out", "out", ignored=(signal.SIGTSTP,))
        child.wait_for(lambda: child.is_under_way)
        child.process.send_signal(signal.SIGTSTP)
        n = len(child.told())
        child.wait_for(lambda: len(child.told()) > n + 5)

        assert not any(line.startswith("drive Stop") for line in child.told())


@pytest.mark.parametrize("step", [7, pytest.param(1, marks=pytest.mark.long)])
def test_ctrl_c_at_every_line_that_hears_of_it_ends_the_command(step: int) -> None:
    """Beginning before the handlers are set, and going on until they are what they were."""
    instants = [sys.executable, str(Path(__file__).with_name("instants.py")), str(step)]
    ended = subprocess.run(instants, capture_output=True, text=True, timeout=300.0, check=True)

    codes = [int(line.split()[1]) for line in ended.stdout.splitlines()]
    assert len(codes) > 200 / step
    n_before = codes.index(130)  # Python's own handler is in charge
    assert set(codes[:n_before]) == {-signal.SIGINT}
    n_heard = codes[n_before:].count(130)
    assert codes[n_before : n_before + n_heard] == [130] * n_heard
    assert set(codes[n_before + n_heard :]) <= {-signal.SIGINT}  # everything is said; the system ends us, in silence
    assert ended.stderr.count("Traceback") == ended.stderr.count("\nKeyboardInterrupt\n") == n_before


@pytest.mark.long
def test_ctrl_c_at_every_line_of_a_run_closes_its_robot(tmp_path: Path) -> None:
    step = 5
    (tmp_path / "c.yaml").write_text(CONFIG)
    run = ["--plugin", str(PLUGIN), "run", "c.yaml", "--out", "out", "--set", "sources.robot.n=1", "--no-report"]
    instants = [sys.executable, str(Path(__file__).with_name("instants.py")), str(step), *run]
    ended = subprocess.run(instants, cwd=tmp_path, capture_output=True, text=True, timeout=2400.0, check=True)

    lines = [line.split(maxsplit=2)[1:] for line in ended.stdout.splitlines()]
    n_heard = sum(code == "130" for code, *_ in lines)
    assert n_heard > 1000 / step
    assert all(told == "close" for _, told in lines)
    ends = [str(-signal.SIGINT)] * (len(lines) - n_heard)  # at the end the system ends us, in silence
    assert [code for code, _ in lines] == ["130"] * n_heard + ends, ended.stdout + ended.stderr
    assert "internal error" not in ended.stderr
    assert "Traceback" not in ended.stderr
    said = ended.stderr.splitlines()
    assert not any("what is known was written" in one and one == other for one, other in pairwise(said))


def test_a_signal_is_heard_when_everybody_else_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """The main thread may come to its end, and forget the request, just when the listening thread has made it."""
    import threading

    from trailmark import interruption
    from trailmark.cli.signals import call_until_signal

    is_handled, is_forgotten, failures = threading.Event(), threading.Event(), []
    make = interruption.ask_to_end

    def make_and_lose(number: int) -> interruption.Interrupted:
        by = make(number)
        if threading.current_thread().name == "signals":
            is_handled.wait(30.0)  # or the handler, which comes after the pipe, would make it anew
            interruption.forget()
            is_forgotten.set()
        else:
            is_handled.set()
        return by

    monkeypatch.setattr(interruption, "ask_to_end", make_and_lose)
    monkeypatch.setattr(threading, "excepthook", failures.append)
    before = threading.enumerate()

    def be_told() -> bool:
        with interruption.shielded():
            signal.raise_signal(signal.SIGTERM)
            return is_forgotten.wait(30.0)

    assert call_until_signal(be_told, is_whole_program=False) is True
    for thread in threading.enumerate():
        if thread not in before and thread.name in ("signals", "stop"):
            thread.join(30.0)

    assert not failures


class _EatsSignals:
    """Python drops what is raised while an object is let go, and says so on standard error."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGTERM)


def test_a_signal_that_comes_while_an_object_is_let_go_is_raised_again(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from trailmark import interruption
    from trailmark.cli.signals import call_until_signal

    monkeypatch.setattr(interruption, "_REPEAT_S", 60.0)  # for whoever catches and drops it: nobody does here
    reached: list[str] = []

    def let_go() -> None:
        eats = _EatsSignals()
        del eats
        time.sleep(30.0)
        reached.append("the end")

    assert call_until_signal(let_go, is_whole_program=False) == 128 + signal.SIGTERM
    assert not reached
    assert "ignored" not in capsys.readouterr().err


def test_handlers_are_those_of_before_when_a_command_has_ended() -> None:
    from trailmark.cli import main

    before = [signal.getsignal(number) for number in SIGNALS]
    unraisable = sys.unraisablehook
    wakeup = signal.set_wakeup_fd(-1)
    signal.set_wakeup_fd(wakeup)

    with pytest.raises(SystemExit) as left:
        main(["--version"])

    assert left.value.code == 0
    assert [signal.getsignal(number) for number in SIGNALS] == before
    assert sys.unraisablehook is unraisable
    assert signal.set_wakeup_fd(wakeup) == wakeup


def test_a_run_from_python_touches_no_handler(tmp_path: Path) -> None:
    import trailmark

    before = [signal.getsignal(number) for number in [*SIGNALS, signal.SIGALRM]]
    rows = "\n".join(f"{t / 20},{math.sin(t / 20)},0,0" for t in range(40))
    (tmp_path / "w.csv").write_text(f"t,x,y,theta\n{rows}\n")
    source = {"plugin": "csv_odometry", "path": str(tmp_path / "w.csv")}
    seen = set()

    trailmark.run(
        {"sources": {"wheels": source}, "localizers": {"wheels": {"plugin": "odometry"}}},
        tmp_path / "out",
        report=False,
        on_step=lambda *_: seen.add(tuple(signal.getsignal(number) for number in [*SIGNALS, signal.SIGALRM])),
    )

    assert seen == {tuple(before)}
