"""``trailmark sim`` from the command line, and the data set on disk."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result

from trailmark.cli.root import root
from trailmark.config import read_calibration
from trailmark.errors import ConfigError
from trailmark.frames import RGBD, GroundPlane, Image, Odometry, Scan
from trailmark.geometry import Pose2, read_tum
from trailmark.recording import DatasetWriter
from trailmark_sim.describe import option_rows
from trailmark_sim.ground.floors import FLOORS
from trailmark_sim.pictures import picture_of
from trailmark_sim.source import SimSource
from trailmark_sim.worlds import WORLDS

CONFIG = """
sources:
  robot:
    plugin: sim
    sensors: [wheels, imu, light, floor]
    duration_s: 0.3
    options: {camera: {width: 96, height: 64, field_mm: [37.5, 25]}}
"""


def trailmark(*arguments: str) -> Result:
    return CliRunner().invoke(root, ["sim", *arguments], catch_exceptions=True)


def failure(result: Result) -> str:
    assert isinstance(result.exception, ConfigError), result.output
    return str(result.exception)


def test_list_names_worlds_routes_sensors_and_options() -> None:
    result = trailmark("list")

    assert result.exit_code == 0
    assert "ground_course: Courses for a ground camera" in result.output
    assert "straight, indoor, outdoor" in result.output


def test_list_as_json_can_be_read() -> None:
    rows: list[dict[str, Any]] = json.loads(trailmark("list", "--json").stdout)

    course = next(row for row in rows if row["world"] == "ground_course")
    assert course["sensors"] == ["wheels", "imu", "light", "floor"]
    assert "covered" in course["options"]


def test_list_of_one_world_explains_its_options() -> None:
    result = trailmark("list", "ground_course")

    lines = {line.split()[0]: line for line in result.stdout.splitlines()}
    assert "512" in lines["camera.width"]
    assert "Width of the picture [px]" in lines["camera.width"]
    assert {"covered.from_m", "in_replay.wet", "texture"} <= set(lines)


def test_list_of_a_world_that_is_not_there_names_the_nearest() -> None:
    assert "did you mean 'street'" in failure(trailmark("list", "stret"))


def test_every_option_of_every_world_is_explained() -> None:
    for world in WORLDS:
        for row in option_rows(world):
            assert row["meaning"], f"{world}: {row['key']}"


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from trailmark_sim.commands import sim; import trailmark_sim.plugin, trailmark_sim.config;"
        "print([name for name in ('cv2', 'numba', 'scipy', 'sklearn', 'matplotlib') if name in sys.modules])"
    )

    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert found.stdout.strip() == "[]"


def test_render_writes_what_the_camera_sees(tmp_path: Path) -> None:
    out = tmp_path / "new" / "a.png"

    result = trailmark("render", "ground_course", "--sensor", "floor", "--at", "1,0.5,30", "-o", str(out))

    assert result.exit_code == 0, result.output
    picture = cv2.imread(str(out), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    assert picture.shape == (480, 512)
    assert picture.std() > 3


def test_render_takes_options_of_the_world(tmp_path: Path) -> None:
    pictures = []
    for floor in ("wood", "carpet"):
        out = tmp_path / f"{floor}.png"
        assert trailmark("render", "ground_course", "--set", f"floor={floor}", "-o", str(out)).exit_code == 0
        pictures.append(cv2.imread(str(out), cv2.IMREAD_UNCHANGED))

    wood, carpet = pictures
    assert wood is not None
    assert carpet is not None
    assert carpet.std() > wood.std()


@pytest.mark.parametrize(
    ("arguments", "story"),
    [
        (["ground_cours"], "no world named 'ground_cours' (did you mean 'ground_course'?)"),
        (["ground_course", "--sensor", "flor"], "no sensor named 'flor' (did you mean 'floor'?)"),
        (["ground_course", "--sensor", "wheels"], "a reading of kind Odometry is no picture"),
        (["ground_course", "--at", "1,2"], "--at takes X,Y,DEG"),
        (["ground_course", "--at", "1,2,nan"], "--at takes X,Y,DEG"),
        (["ground_course", "--route", "indoor", "--at", "1.5,0.2,0"], "stands in the left pole of gate 1"),
        (["ground_course", "--route", "indor"], "no route named 'indor' (did you mean 'indoor'?)"),
        (["ground_course", "--set", "flor=wood"], "unknown key (did you mean 'floor'?)"),
        (["ground_course", "--set", "texture=nowhere.jpg"], "no such file or folder"),
        (["ground_course", "--set", "floor"], "KEY=VALUE"),
        (["ground_course", "--set", "camera.readout_ms=20"], "'floor' is read for 20 ms, but at 70 Hz"),
        (["corridor", "--set", "exposure_ms=60"], "'front' exposes for 60 ms, but at 20 Hz"),
        (["corridor", "--set", "readout_ms=-1"], "readout_ms"),
    ],
)
def test_render_says_what_is_wrong_in_one_line(tmp_path: Path, arguments: list[str], story: str) -> None:
    message = failure(trailmark("render", *arguments, "-o", str(tmp_path / "a.png")))

    assert story in message
    assert "\n" not in message
    assert not (tmp_path / "a.png").exists()


def test_statistics_of_pictures_and_floors_stand_in_one_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trailmark_sim.ground.floors.FLOORS", {"wood": FLOORS["wood"]})
    picture = tmp_path / "noise.png"
    cv2.imwrite(str(picture), np.random.default_rng(7).integers(90, 110, (600, 700)).astype(np.uint8))

    rows = json.loads(trailmark("statistics", str(picture), "--floors", "--json").stdout)

    names = [row["picture"] for row in rows]
    assert names == ["noise.png", "floor wood"]
    assert rows[0]["std"] == pytest.approx(20 / 12**0.5, rel=0.02)
    assert rows[0]["slope"] == pytest.approx(0.0, abs=0.1)


def test_statistics_of_what_is_no_picture_are_refused(tmp_path: Path) -> None:
    (tmp_path / "small.png").write_bytes(cv2.imencode(".png", np.zeros((9, 9), np.uint8))[1].tobytes())

    assert "96 x 96" in failure(trailmark("statistics", str(tmp_path / "small.png")))
    assert "is not there" in failure(trailmark("statistics", str(tmp_path / "nowhere.png")))
    assert "give pictures, or --floors" in failure(trailmark("statistics"))


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "config.yaml"
    path.write_text(CONFIG)
    return path


def test_record_writes_a_data_set_that_any_program_reads(config: Path, tmp_path: Path) -> None:
    out = tmp_path / "set"

    result = trailmark("record", str(config), "--out", str(out))

    assert result.exit_code == 0, result.output
    pictures = sorted((out / "floor").glob("*.png"))
    stamps = [line.split() for line in (out / "floor" / "timestamps.txt").read_text().splitlines()]
    assert [name for _, name in stamps] == [path.name for path in pictures]
    assert [float(stamp) for stamp, _ in stamps] == [k / 70 for k in range(21)]
    truth = read_tum(out / "groundtruth.tum")
    assert np.abs(truth.stamps_s[:, None] - np.arange(21) / 70).min(axis=0).max() < 1e-6
    rows = np.loadtxt(out / "wheels.csv", delimiter=",", skiprows=1)
    assert rows.shape == (15, 4)
    assert np.loadtxt(out / "imu.csv", delimiter=",", skiprows=1).shape == (30, 7)
    assert np.loadtxt(out / "light.csv", delimiter=",", skiprows=1).shape == (3, 2)


def test_a_recorded_calibration_is_the_sensors(config: Path, tmp_path: Path) -> None:
    out = tmp_path / "set"
    assert trailmark("record", str(config), "--out", str(out)).exit_code == 0

    calibration = read_calibration(out / "floor.calib.yaml")

    assert isinstance(calibration, GroundPlane)
    assert calibration.metres_per_pixel == pytest.approx((37.5e-3 / 96, 25e-3 / 64))
    assert calibration.flat_field is not None
    assert calibration.flat_field.shape == (64, 96)


def test_a_recorded_data_set_plays_again(config: Path, tmp_path: Path) -> None:
    from trailmark.config import load_run_config
    from trailmark.interfaces import Session
    from trailmark.plugins import load_plugins

    out = tmp_path / "set"
    assert trailmark("record", str(config), "--out", str(out)).exit_code == 0

    run = load_run_config(out / "config.yaml", plugins=load_plugins())

    assert set(run.sources) == {"wheels", "floor"}
    assert run.sensors["floor"].mounting is not None
    entry = run.sources["floor"]
    player = entry.spec.load()(entry.config)
    player.start(Session(name="floor"))
    frames = list(player.frames())
    assert [frame.stamp_s for frame in frames] == [k / 70 for k in range(21)]
    first = cv2.imread(str(out / "floor" / "000000.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(frames[0].payload.pixels, first)


def test_record_refuses_a_folder_that_is_not_empty_unless_told(config: Path, tmp_path: Path) -> None:
    out = tmp_path / "set"
    out.mkdir()
    (out / "mine.txt").write_text("keep")

    assert "is not empty" in failure(trailmark("record", str(config), "--out", str(out)))
    assert trailmark("record", str(config), "--out", str(out), "--overwrite").exit_code == 0
    assert (out / "mine.txt").read_text() == "keep"


@pytest.mark.parametrize("command", ["record", "render"])
def test_a_source_is_closed_when_its_command_fails(
    command: str, config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise OSError("no space left on device")

    closed: list[SimSource] = []
    monkeypatch.setattr(SimSource, "close", lambda source: closed.append(source))
    monkeypatch.setattr(DatasetWriter, "write", fail)
    monkeypatch.setattr(SimSource, "look", fail)
    source = [str(config)] if command == "record" else ["ground_course", "--sensor", "wheels"]

    result = trailmark(command, *source, "--out", str(tmp_path / "out.png"))

    assert isinstance(result.exception, OSError), result.output
    assert len(closed) == 1


def test_record_needs_a_simulated_source(tmp_path: Path) -> None:
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    cv2.imwrite(str(pictures / "0.png"), np.zeros((8, 8), np.uint8))
    path = tmp_path / "config.yaml"
    path.write_text(f"sources: {{camera: {{plugin: image_folder, path: {pictures}, rate_hz: 10}}}}")

    message = failure(trailmark("record", str(path), "--out", str(tmp_path / "set")))

    assert "takes a config with one source of plugin sim, not 0" in message


def test_a_scan_is_drawn_from_above_with_forward_up() -> None:
    picture = picture_of(Scan(np.array([4.0]), 0.0, 0.1, range_max_m=5.0))

    rows, cols = np.nonzero(picture == 0)
    assert rows.mean() < 0.3 * picture.shape[0]
    assert abs(cols.mean() - picture.shape[1] / 2) < 2


def test_colour_and_depth_are_drawn_side_by_side() -> None:
    depth = np.array([[1.0, np.nan]], dtype=np.float32)

    picture = picture_of(RGBD(np.full((1, 2, 3), 7, np.uint8), depth))

    assert picture.shape == (1, 4, 3)
    assert picture[0, 3].tolist() == [0, 0, 0]
    assert picture[0, 0].tolist() == [7, 7, 7]


def test_what_is_no_picture_is_refused() -> None:
    with pytest.raises(ConfigError, match="is no picture"):
        picture_of(Odometry(Pose2(1.0)))
    assert picture_of(Image(np.ones((2, 2), np.uint8))).shape == (2, 2)


@pytest.mark.parametrize("driver", ["auto", "commands"])
def test_a_controller_that_is_not_asked_is_told(driver: str, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    config = tmp_path / "c.yaml"
    config.write_text(f"""
sources: {{robot: {{plugin: sim, world: supermarket, sensors: [wheels], duration_s: 0.1, driver: {driver}}}}}
localizers: {{wheels: {{plugin: odometry}}}}
controller: {{plugin: goal_seeking, goal: [5, 3]}}
""")

    with caplog.at_level("WARNING"):
        result = CliRunner().invoke(root, ["run", str(config), "--out", str(tmp_path / "out")], catch_exceptions=False)

    assert result.exit_code == 0
    told = "the robot of source 'robot' drives itself, the controller is not asked"
    assert any(told in record.getMessage() for record in caplog.records) == (driver == "auto")
