"""``trailmark calibrate odometry``, ``mounting`` and ``delay``, as a user runs them, with a stranger's plugin."""

from __future__ import annotations

import json
import math
import os
import signal
from pathlib import Path

import numpy as np
import pytest
from tests.calibration.conftest import BELIEVED, RIGHT, numbers

from trailmark.cli import main
from trailmark.config.yaml_text import dump_yaml, read_yaml
from trailmark.geometry import Pose2
from trailmark.pipeline.sources.stream import SourceStream
from trailmark.plugins import load_plugins
from trailmark_calibration.config_lines import in_flow_style
from trailmark_calibration.drive import TwoLocalizers, observe_drive, read_localizers
from trailmark_calibration.simulating import SimulatedDrive, simulate

PLUGIN = Path(__file__).with_name("strange_plugin.py")
X0 = Pose2(*BELIEVED)
CONFIG = """
sources:
  base: {plugin: csv_odometry, path: wheels.csv, time_offset_s: 0.01}
  eye: {plugin: steps, path: steps.npy}
sensors:
  eye: {mounting: {x: 0.15, y: -0.05, z: 0.3, roll_deg: 180, yaw_deg: 22.91831}}
localizers:
  wheels: {plugin: odometry, distance_sigma: 0.01, correct: {way: 1.01}}
  eye: stepper
"""


def record(drive: SimulatedDrive, folder: Path) -> None:
    """Write what wheels and sensor say, as their own readings."""
    pose, rows = Pose2(), [f"{drive.wheels[0].since_s:.6f},0,0,0"]
    for motion in drive.wheels:
        pose = pose @ Pose2.exp(*(np.array(motion.pose_since_now.log()) / (1.01, 1.0, 1.0)).tolist())  # as by `correct`
        rows.append(f"{motion.stamp_s - 0.01:.6f},{pose.x:.9f},{pose.y:.9f},{pose.theta:.9f}")
    (folder / "wheels.csv").write_text("\n".join(["t,x,y,theta", *rows]) + "\n")
    seen = [X0.inverse() @ motion.pose_since_now @ X0 for motion in drive.sensor]
    stamps = [(motion.since_s, motion.stamp_s) for motion in drive.sensor]
    np.save(folder / "steps.npy", np.array([[*when, *step.array()] for when, step in zip(stamps, seen)]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A recorded drive of a good minute, and a config that is wrong about the robot."""
    there = tmp_path_factory.mktemp("drive")
    record(simulate(np.random.default_rng(7), RIGHT, BELIEVED, duration_s=70.0), there)
    (there / "robot.yaml").write_text(CONFIG)
    return there


def trailmark(capsys, *arguments: str | Path) -> tuple[int, str, str]:
    capsys.readouterr()
    with pytest.raises(SystemExit) as end:
        main(["--plugin", str(PLUGIN), *map(str, arguments)])
    said = capsys.readouterr()
    return int(end.value.code or 0), said.out, said.err


def found_by(capsys, *arguments: str | Path) -> dict[str, dict[str, float]]:
    code, out, error = trailmark(capsys, "calibrate", *arguments, "--json")
    assert code == 0, error
    document = json.loads(out)
    assert document["clocks_run_apart"] is False
    return document["numbers"] | {"lines": document["config"]}


def with_lines(folder: Path, lines: list[str]) -> Path:
    """Return the config with printed lines in place of its own: as a user pastes them."""
    config, (pasted, _) = read_yaml(CONFIG)[0], read_yaml("\n".join(lines))
    for section, parts in pasted.items():
        config[section] |= parts
    file = folder / "pasted.yaml"
    file.write_text(dump_yaml(config))
    return file


def agrees(number: dict[str, float], right: float) -> bool:
    return number["told"] and abs(number["value"] - right) < 3.5 * number["sigma"]


def test_wheels_are_right_once_the_line_is_pasted(folder, capsys):
    found = found_by(capsys, "odometry", folder / "robot.yaml")
    again = found_by(capsys, "odometry", with_lines(folder, found["lines"]))

    assert agrees(found["way"], 1.03)
    assert agrees(found["turn"], 0.94)
    assert agrees(found["turn_per_m"], 0.01)
    line = read_yaml("\n".join(found["lines"]))[0]["localizers"]["wheels"]
    assert line["plugin"] == "odometry"
    assert line["distance_sigma"] == 0.01
    assert line["correct"]["way"] == pytest.approx(1.01 * found["way"]["value"], abs=2e-5)
    for name, right in (("way", 1.0), ("turn", 1.0), ("turn_per_m", 0.0)):
        assert again[name]["value"] == pytest.approx(right, abs=0.2 * again[name]["sigma"])


def test_a_mounting_is_right_once_the_line_is_pasted_and_keeps_what_was_known(folder, capsys):
    found = found_by(capsys, "mounting", folder / "robot.yaml")
    again = found_by(capsys, "mounting", with_lines(folder, found["lines"]))

    for name, right in (("x", 0.2), ("y", -0.1), ("yaw", 0.5)):
        assert agrees(found[name], right)
        assert again[name]["value"] == pytest.approx(found[name]["value"], abs=0.2 * found[name]["sigma"])
    mounting = read_yaml("\n".join(found["lines"]))[0]["sensors"]["eye"]["mounting"]
    assert mounting["z"] == 0.3
    assert mounting["roll_deg"] == 180
    assert mounting["yaw_deg"] == pytest.approx(math.degrees(found["yaw"]["value"]), abs=1e-3)


def test_a_delay_is_gone_once_the_line_is_pasted(folder, capsys):
    found = found_by(capsys, "delay", folder / "robot.yaml")
    again = found_by(capsys, "delay", with_lines(folder, found["lines"]))

    assert agrees(found["delay"], 0.08)
    line = read_yaml("\n".join(found["lines"]))[0]["sources"]["eye"]
    assert line == {"plugin": "steps", "path": "steps.npy", "time_offset_s": round(found["delay"]["value"], 4)}
    assert again["delay"]["value"] == pytest.approx(0.0, abs=0.3 * again["delay"]["sigma"] + 1e-4)


def test_it_is_said_with_uncertainty_and_checked_on_the_other_half(folder, capsys):
    code, out, _ = trailmark(capsys, "calibrate", "odometry", folder / "robot.yaml", "--track", "0.4")

    lines = out.splitlines()
    assert code == 0
    assert lines[0].startswith("odometry: 'wheels' against 'eye'")
    assert lines[1].startswith("  scale of the way        1.0")
    assert lines[1].endswith("(95 %)")
    assert "checked on the other half of the drive: 5 s were wrong by" in out
    assert "left wheel x " in out
    assert lines[-1].startswith("  wheels: {plugin: odometry, distance_sigma: 0.01, correct: {way: 1.0")


def test_the_folder_of_a_run_will_do(folder, capsys):
    alone = "estimator={plugin: dead_reckoning, use: [eye]}"
    assert (
        trailmark(capsys, "run", folder / "robot.yaml", "--set", alone, "--out", folder / "run", "--no-report")[0] == 0
    )

    found = found_by(capsys, "odometry", folder / "run")

    assert agrees(found["way"], 1.03)
    assert agrees(found["turn"], 0.94)


def test_a_run_whose_recording_was_moved_says_what_is_missing(tmp_path, capsys, caplog):
    record(simulate(np.random.default_rng(7), RIGHT, BELIEVED, duration_s=70.0), tmp_path)
    (tmp_path / "robot.yaml").write_text(CONFIG)
    alone = "estimator={plugin: dead_reckoning, use: [eye]}"
    run = ("run", tmp_path / "robot.yaml", "--set", alone, "--out", tmp_path / "run", "--no-report")
    assert trailmark(capsys, *run)[0] == 0
    (tmp_path / "wheels.csv").write_text("something else by now\n")
    caplog.clear()

    code, _, error = trailmark(capsys, "calibrate", "odometry", tmp_path / "run")

    assert code == 0, error
    (warning,) = [entry for entry in caplog.records if entry.name.startswith("trailmark_calibration")]
    assert warning.levelname == "WARNING"
    assert "source 'base' cannot be opened any more" in warning.getMessage()
    assert "mountings that its recording knows are missing" in warning.getMessage()
    assert len(warning.getMessage().splitlines()) == 1


def test_a_stranger_that_cannot_start_any_more_is_warned_of(tmp_path, capsys, caplog):
    record(simulate(np.random.default_rng(7), RIGHT, BELIEVED, duration_s=70.0), tmp_path)
    (tmp_path / "robot.yaml").write_text(CONFIG)
    alone = "estimator={plugin: dead_reckoning, use: [eye]}"
    run = ("run", tmp_path / "robot.yaml", "--set", alone, "--out", tmp_path / "run", "--no-report")
    assert trailmark(capsys, *run)[0] == 0
    (tmp_path / "steps.npy").write_text("something else by now\n")
    caplog.clear()

    code, _, error = trailmark(capsys, "calibrate", "odometry", tmp_path / "run")

    assert code == 0, error
    (warning,) = [entry for entry in caplog.records if entry.name.startswith("trailmark_calibration")]
    assert "source 'eye' cannot be opened any more" in warning.getMessage()
    assert "source 'eye' failed in start: ValueError" in warning.getMessage()


def test_an_interrupted_drive_is_none(folder, monkeypatch):
    frames = SourceStream.frames

    def interrupted(stream):
        for n, frame in enumerate(frames(stream)):
            if n == 600:  # of 700 steps of the sensor: it would be enough
                os.kill(os.getpid(), signal.SIGINT)
            yield frame

    monkeypatch.setattr(SourceStream, "frames", interrupted)
    plugins = load_plugins(files=[PLUGIN])

    with pytest.raises(KeyboardInterrupt):
        observe_drive(read_localizers(folder / "robot.yaml", plugins, []), TwoLocalizers("wheels", "eye"))

    monkeypatch.setattr(SourceStream, "is_live", True)  # a robot is driven by hand, and Ctrl-C ends the drive
    drive = observe_drive(
        read_localizers(folder / "robot.yaml", plugins, ["pace=step"]), TwoLocalizers("wheels", "eye")
    )
    assert len(drive.said["wheels"]) > 100


@pytest.mark.parametrize("as_json", [(), ("--json",)])
def test_an_interrupted_drive_calibrates_nothing_and_says_so(folder, capsys, monkeypatch, as_json):
    def interrupted(config, two):
        raise KeyboardInterrupt

    monkeypatch.setattr("trailmark_calibration.drive.observe_drive", interrupted)

    code, out, error = trailmark(capsys, "calibrate", "odometry", folder / "robot.yaml", *as_json)

    assert code == 130
    assert out == ""
    assert "the drive was cut short, so nothing is calibrated" in error
    assert "trailmark: interrupted" in error


@pytest.fixture(scope="module")
def straight_folder(tmp_path_factory) -> Path:
    """A drive that never turns."""
    there = tmp_path_factory.mktemp("straight")
    record(simulate(np.random.default_rng(8), RIGHT, BELIEVED, duration_s=60.0, course="straight"), there)
    (there / "robot.yaml").write_text(CONFIG)
    return there


def test_a_straight_drive_keeps_the_known_place_and_says_why(straight_folder, capsys):
    code, out, _ = trailmark(capsys, "calibrate", "mounting", straight_folder / "robot.yaml")

    assert code == 0
    assert "forward                 this drive cannot tell it" in out
    assert "turn more" in out
    mounting = read_yaml("\n".join(out.splitlines()[-2:]))[0]["sensors"]["eye"]["mounting"]
    assert mounting["x"] == 0.15
    assert mounting["y"] == -0.05
    assert mounting["yaw_deg"] == pytest.approx(math.degrees(0.5), abs=1.5)


def test_where_nothing_is_told_the_exit_code_says_so(tmp_path, capsys):
    drive = simulate(np.random.default_rng(4), RIGHT, BELIEVED, duration_s=30.0, course="circle")
    record(drive, tmp_path)
    (tmp_path / "robot.yaml").write_text(CONFIG)

    code, out, error = trailmark(capsys, "calibrate", "delay", tmp_path / "robot.yaml")

    assert code == 2
    assert out == ""
    assert "delay this drive cannot tell it" in error
    assert "begin and end more turns" in error
    assert len(error.strip().splitlines()) == 1


def test_swapped_wheels_are_said_in_words(tmp_path, capsys):
    right = replace_numbers(turn=-1.0, yaw=math.pi)
    record(simulate(np.random.default_rng(6), right, BELIEVED, duration_s=60.0), tmp_path)
    (tmp_path / "robot.yaml").write_text(CONFIG)

    code, out, _ = trailmark(capsys, "calibrate", "odometry", tmp_path / "robot.yaml")

    assert code == 0
    assert "left and right wheel are swapped" in out
    assert "the other way round" in out


def replace_numbers(**named: float) -> np.ndarray:
    return numbers(x=0.15, y=-0.05) + numbers(**named) - numbers()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("odometry", "robot.yaml", "--of", "wheel"), "no localizer is called 'wheel'; the config has wheels, eye"),
        (("odometry", "robot.yaml", "--of", "eye", "--against", "eye"), "cannot be compared with itself"),
        (("odometry", "robot.yaml", "--track", "-1"), "--track must be between"),
        (("delay", "robot.yaml", "--interval", "0"), "--interval must be between"),
        (("mounting", "robot.yaml", "--sensor", "base"), "looks at no sensor 'base', but at eye"),
        (("odometry", "robot.yaml", "--sensor", "eye"), "--sensor says whose mounting is asked for"),
        (("delay", "robot.yaml", "--sensor", "nonsense"), "'calibrate delay' takes none"),
        (("mounting", "robot.yaml", "--of", "wheels", "--against", "eye"), "odometry is of base"),
        (("odometry", "nowhere.yaml"), "nowhere.yaml"),
        (("odometry", "."), "is no folder of a run"),
        (("odometry", "robot.yaml", "--set", "sources={}"), "no source"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(folder, capsys, monkeypatch, arguments, message):
    monkeypatch.chdir(folder)

    code, out, error = trailmark(capsys, "calibrate", *arguments)

    assert code == 2
    assert out == ""
    assert message in error
    assert len(error.strip().splitlines()) == 1


def test_one_line_of_yaml_reads_back_as_it_was():
    value = {"a": [1, 2.5, -1e-9], "b": "yes", "c": "x: y", "d": None, "e": True, "f": {"g": "dir/file.csv"}, "h": "no"}

    assert read_yaml(in_flow_style(value))[0] == value
