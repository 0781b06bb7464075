"""Runs from the command line, end to end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from trailmark.cli import main
from trailmark.geometry import read_tum
from trailmark.stores.sqlite import SqlitePathStore
from trailmark.stores.sqlite_config import SqliteStoreConfig

Run = Callable[..., "subprocess.CompletedProcess[str]"]

RUN_FILES = ("config.yaml", "run.json", "estimates.csv", "metrics.json", "timing.json", "report.html")


def test_a_run_leaves_a_complete_folder_and_prints_where(trailmark: Run, wheels_config: Path, tmp_path: Path) -> None:
    done = trailmark("run", wheels_config, "--out", "out")

    assert done.returncode == 0, done.stderr
    assert all((tmp_path / "out" / name).stat().st_size > 0 for name in RUN_FILES)
    assert {path.name for path in (tmp_path / "out" / "trajectories").iterdir()} == {
        "wheels.tum",
        "fused.tum",
        "groundtruth.tum",
    }
    assert list((tmp_path / "out" / "plots").glob("*.svg"))
    assert done.stdout.splitlines()[-2:] == ["out", "out/report.html"]
    assert "wheels" in done.stdout


def test_the_answer_is_right(trailmark: Run, wheels_config: Path, tmp_path: Path) -> None:
    done = trailmark("run", wheels_config, "--out", "out", "--json", "--no-report")

    rows = {row["name"]: row for row in json.loads(done.stdout)["rows"]}
    assert rows["fused"]["rmse_m"] < 1e-6
    estimate, truth = (read_tum(tmp_path / "out" / "trajectories" / f"{name}.tum") for name in ("fused", "groundtruth"))
    np.testing.assert_allclose(estimate.at(truth.stamps_s[1:]).positions, truth.positions[1:], atol=1e-6)


def test_a_worthless_run_is_warned_of_and_fails_when_strict(
    trailmark: Run, wheels_config: Path, tmp_path: Path
) -> None:
    header, *rows = (tmp_path / "wheels.csv").read_text().splitlines()
    in_mm = [",".join([t, *(f"{1000 * float(value):.6f}" for value in (x, y)), theta]) for t, x, y, theta in (
        row.split(",") for row in rows
    )]  # fmt: skip
    (tmp_path / "wheels.csv").write_text("\n".join([header, *in_mm]) + "\n")

    shown = trailmark("run", wheels_config, "--out", "a", "--no-report")
    strict = trailmark("run", wheels_config, "--out", "b", "--no-report", "--strict")

    assert (shown.returncode, strict.returncode) == (0, 1)
    assert "WARNING: wheels: was lost all the time, 399 of 399 (a jump of 25 m in 0.05 s: restarted?)" in shown.stderr
    assert "WARNING: no estimate was used" in shown.stderr
    assert strict.stderr.startswith(shown.stderr)
    assert "failed because of --strict: the end has" in strict.stderr


def test_a_good_run_is_good_when_strict(trailmark: Run, wheels_config: Path, tmp_path: Path) -> None:
    done = trailmark("run", wheels_config, "--out", "out", "--no-report", "--strict")

    assert (done.returncode, "WARNING" in done.stderr) == (0, False)


def test_the_same_config_and_seed_give_the_same_bytes(trailmark: Run, wheels_config: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        assert trailmark("run", wheels_config, "--out", name, "--seed", "7", "--no-report").returncode == 0

    for file in ("estimates.csv", "trajectories/wheels.tum", "trajectories/fused.tum"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_a_recording_needs_no_config(trailmark: Run, wheels_config: Path, tmp_path: Path) -> None:
    done = trailmark("run", "wheels.csv", "--localizer", "odometry", "--out", "out", "--no-report")

    assert done.returncode == 0, done.stderr
    assert "plugin: csv_odometry" in (tmp_path / "out" / "config.yaml").read_text()


def test_a_recording_that_lacks_a_key_is_told_how_to_be_given_it(trailmark: Run, tmp_path: Path) -> None:
    (tmp_path / "front").mkdir()
    for name in ("000.png", "001.png"):
        cv2.imwrite(str(tmp_path / "front" / name), np.zeros((48, 64), np.uint8))

    for command in ("run", "inspect"):
        refused = trailmark(command, "front")
        assert refused.returncode == 2
        assert "give rate_hz or timestamps" in refused.stderr
        assert "Without a config, give a key of the source by --set sources.front.KEY=VALUE" in refused.stderr
        assert trailmark(command, "front", "--set", "sources.front.rate_hz=10").returncode == 0


def test_what_another_part_lacks_is_no_key_of_the_source(trailmark: Run, wheels_config: Path) -> None:
    refused = trailmark("run", "wheels.csv", "--localizer", "nosuch")

    assert refused.returncode == 2
    assert "Without a config" not in refused.stderr


class TestWhatHasNoEffect:
    def test_a_run_without_a_localizer_is_warned_of(self, trailmark: Run, wheels_config: Path) -> None:
        shown = trailmark("run", "wheels.csv", "--out", "a", "--no-report")
        strict = trailmark("run", "wheels.csv", "--out", "b", "--no-report", "--strict")

        assert (shown.returncode, strict.returncode) == (0, 1)
        assert "WARNING: there is no localizer" in shown.stderr

    def test_frames_that_go_to_a_sink_need_no_localizer(self, trailmark: Run, wheels_config: Path) -> None:
        sink = "sinks=[{plugin: jsonl, to: out.jsonl}]"
        done = trailmark("run", "wheels.csv", "--set", sink, "--out", "out", "--no-report", "--strict")

        assert (done.returncode, "WARNING" in done.stderr) == (0, False)

    @pytest.mark.parametrize("place", ["sources.wheels", "sensors.wheels"])
    def test_a_mounting_of_odometry_is_warned_of(self, trailmark: Run, wheels_config: Path, place: str) -> None:
        mounting = f"{place}.mounting.yaw_deg=90"
        done = trailmark("run", wheels_config, "--set", mounting, "--out", "out", "--no-report", "--strict")

        assert done.returncode == 1
        assert "WARNING: wheels: its mounting changes nothing" in done.stderr

    def test_a_mounting_that_is_believed_wrongly_is_none_that_was_asked_for(
        self, trailmark: Run, tmp_path: Path
    ) -> None:
        (tmp_path / "robot.yaml").write_text(
            "sources:\n"
            "  robot:\n"
            "    {plugin: sim, world: supermarket, sensors: [wheels, laser], duration_s: 1, threads: 1,\n"
            "     perturb: {wrong: {yaw_deg: 2}}}\n"
            "localizers: {wheels: {plugin: odometry}}\n"
        )

        done = trailmark("run", "robot.yaml", "--out", "out", "--no-report")

        assert done.returncode == 0, done.stderr
        assert "mounting changes nothing" not in done.stderr


def test_a_folder_that_is_not_empty_is_kept(trailmark: Run, wheels_config: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.tex").touch()

    refused = trailmark("run", wheels_config, "--out", "out")
    allowed = trailmark("run", wheels_config, "--out", "out", "--overwrite", "--no-report")

    assert refused.returncode == 2
    assert "--overwrite" in refused.stderr
    assert allowed.returncode == 0
    assert (tmp_path / "out" / "thesis.tex").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run", "nowhere.yaml"), ("nowhere.yaml",)),
        (("run", "wheels.yaml", "--set", "localizers.wheels.plugin=odometri"), ("odometri", "odometry")),
        (("run", "wheels.yaml", "--set", "sources.wheels.pth=x"), ("pth", "path")),
        (("run", "wheels.yaml", "--set", "localizers={}", "--localizer", "odometry"), ("--localizer", "--set")),
        (("run", "wheels.yaml", "--set", "sources={}"), ("no sources",)),
        (("rnu", "wheels.yaml"), ("rnu", "run")),
        (("run", "wheels.yaml", "--sed", "3"), ("--sed", "--seed")),
        (("teach", "wheels.yaml"), ("--store",)),
        (("run",), ("trailmark run: missing argument", "'trailmark run --help' shows how")),
        (("run", "wheels.yaml", "--pace", "fast"), ("--pace", "'step', 'realtime'")),
        (("replay", "wheels.yaml", "--store", "no.trail"), ("no.trail",)),
        (("replay", "wheels.yaml", "--store", "no.trail", "--reverse"), ("--reverse", "wheels.yaml", "controller")),
        (("replay", "wheels.yaml", "--store", "no.trail", "--repeat", "2"), ("--repeat", "controller")),
        (("evaluate", "no.tum", "no2.tum"), ("no.tum",)),
        (("reproduce", "nobody1999"), ("nobody1999", "available")),
        (("--plugin", "what", "plugins"), ("no:NAME",)),
    ],
)
def test_a_wrong_request_is_said_in_words_with_exit_code_2(
    wheels_config: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    words: tuple[str, ...],
) -> None:
    monkeypatch.chdir(wheels_config.parent)

    with pytest.raises(SystemExit) as left:
        main([*arguments])

    told = capfd.readouterr().err
    assert left.value.code == 2, told
    assert all(word in told for word in words), told
    assert "Traceback" not in told
    assert "internal error" not in told
    assert len(told.splitlines()) == 1


def test_a_group_without_a_command_shows_its_help(trailmark: Run) -> None:
    done = trailmark("store")

    assert done.returncode == 2
    assert "Read and verify every row." in done.stderr


def test_a_path_is_taught_looked_into_and_extended(trailmark: Run, wheels_config: Path, tmp_path: Path) -> None:
    taught = trailmark("teach", wheels_config, "--store", "a.trail", "--out", "t", "--no-report")
    again = trailmark("teach", wheels_config, "--store", "a.trail", "--out", "t2", "--no-report")
    info = trailmark("store", "info", "a.trail", "--json")

    assert taught.returncode == 0, taught.stderr
    assert again.returncode == 2
    assert "--append" in again.stderr
    described = json.loads(info.stdout)
    assert described["waypoints"] == 201  # every 5 cm of the 9.975 m, and where it stopped
    assert described["length_m"] == pytest.approx(9.975, abs=1e-3)


def test_replaying_without_a_robot_tells_the_sinks(trailmark: Run, wheels_config: Path, tmp_path: Path) -> None:
    trailmark("teach", wheels_config, "--store", "a.trail", "--out", "t", "--no-report")
    steered = "controller={plugin: path_tracking_4ws}"
    sinks = "sinks=[{plugin: jsonl, to: said.jsonl}]"

    done = trailmark(
        "replay", wheels_config, "--store", "a.trail", "--out", "p", "--no-report", "--set", steered, "--set", sinks
    )

    assert done.returncode == 0, done.stderr
    said = [json.loads(line) for line in (tmp_path / "said.jsonl").read_text().splitlines()]
    assert any("command" in str(line).lower() for line in said)


@pytest.mark.slow
@pytest.mark.parametrize("n_kills", [8, pytest.param(20, marks=pytest.mark.long)])
def test_killing_teach_at_any_instant_loses_no_committed_waypoint(
    wheels_config: Path, tmp_path: Path, n_kills: int
) -> None:
    rng = np.random.default_rng(11)
    for trial in range(n_kills):
        store = tmp_path / f"{trial}.trail"
        reported = _teach_and_kill(wheels_config, store, after_waypoints=int(rng.integers(1, 190)))

        opened = SqlitePathStore(SqliteStoreConfig(path=str(store), access="read"))
        opened.start(_session())
        path = opened.path()
        opened.close()

        assert path is not None
        assert len(path) >= reported
        assert [waypoint.index for waypoint in path.waypoints] == list(range(len(path)))


def _session() -> object:
    from trailmark.interfaces import Session

    return Session(mode="replay")


def _teach_and_kill(config: Path, store: Path, after_waypoints: int) -> int:
    """Kill a teaching process once it has reported so many waypoints; return how many it reported in all."""
    command = [sys.executable, "-m", "trailmark.cli", "teach", str(config), "--store", str(store)]
    command += ["--out", f"{store}.run", "--progress", "json", "--no-report", "--set", "path_store.spacing_m=0.05"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    reported = 0
    for line in process.stdout:
        reported += json.loads(line)["committed"]
        if reported == after_waypoints:
            os.kill(process.pid, signal.SIGKILL)
    process.wait()
    return reported


def test_ctrl_c_keeps_what_is_done_and_says_so(wheels_config: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "trailmark.cli", "teach", str(wheels_config), "--store", str(tmp_path / "a.trail")]
    command += ["--out", str(tmp_path / "out"), "--progress", "json", "--no-report", "--pace", "realtime"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for _ in range(3):
        process.stdout.readline()

    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)

    assert process.returncode == 130
    assert "interrupted" in said
    assert "Traceback" not in said
    assert json.loads((tmp_path / "out" / "run.json").read_text())["status"] == "interrupted"
