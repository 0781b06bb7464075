"""``trailmark calibrate ground``, as a user runs it: driven in the simulator, and from a recording."""

from __future__ import annotations

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from trailmark.cli import main
from trailmark.cli.in_config import path_in_config
from trailmark.config import Mounting, read_calibration
from trailmark.config.yaml_text import read_yaml
from trailmark.frames import GroundPlane, SensorInfo
from trailmark.geometry import Pose2, Pose3
from trailmark.pipeline import SourceStream, read_config
from trailmark.testing.ground import GroundCamera, MirroredFloor
from trailmark_ground_vo.calibration import Calibrated
from trailmark_ground_vo.calibration_drive import Speeds, observe_drive
from trailmark_ground_vo.commands import _lines, _write

CAMERA = GroundCamera((512, 480), (3.9e-4, 3.9e-4), Pose3(x=0.08, y=0.02, yaw=math.radians(176.0)), noise_sigma=2.0)
SIMULATED = """
sources:
  floor:
    plugin: sim
    world: ground_course
    vehicle: {kind: differential}
    sensors: [floor]
    threads: 1
    options: {camera: {x_m: 0.1, yaw_deg: 176.0}}
    perturb: {wrong: {scale: 1.03, yaw_deg: 2.0, x_m: 0.03, y_m: -0.02}}
"""


def trailmark(capsys, *arguments: str) -> tuple[int, str, str]:
    capsys.readouterr()
    with pytest.raises(SystemExit) as end:
        main(list(arguments))
    said = capsys.readouterr()
    return int(end.value.code or 0), said.out, said.err


@pytest.fixture
def there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_what_is_believed_wrongly_is_found_within_the_stated_uncertainty(there, capsys):
    (there / "robot.yaml").write_text(SIMULATED)

    code, out, error = trailmark(
        capsys, "calibrate", "ground", "robot.yaml", "--distance", "0.3", "--drive", "--turn", "100", "--json"
    )

    assert code == 0, error
    found = json.loads(out)
    assert abs(found["metres_per_pixel"][0] - 0.2 / 512) < 2 * found["metres_per_pixel_sigma"][0]
    assert abs(math.remainder(found["yaw_deg"] - 176.0, 360.0)) < 2 * found["yaw_sigma_deg"]
    assert abs(found["x_m"] - 0.1) < 2 * found["x_sigma_m"]
    assert abs(found["y_m"]) < 2 * found["y_sigma_m"]
    assert found["metres_per_pixel_sigma"][0] < 0.005 * found["metres_per_pixel"][0]
    assert found["yaw_sigma_deg"] < 0.2
    assert found["x_sigma_m"] < 1e-3
    plane = read_calibration(there / "floor.calib.yaml")
    assert plane.metres_per_pixel == pytest.approx(found["metres_per_pixel"], rel=1e-6)
    assert plane.flat_field.shape == (480, 512)
    assert "turning by 100 deg" in error


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    """A folder of pictures: standing, 0.12 m straight, standing, a turn of 70 deg, standing."""
    folder = tmp_path_factory.mktemp("pictures")
    ground = MirroredFloor.procedural(seed=3, size_px=512, grain_px=1.5)
    straight, turn = Pose2(0.12 / 32), Pose2(0.0, 0.0, math.radians(70.0 / 56))
    pose = Pose2()
    for index, step in enumerate([*[Pose2()] * 26, *[straight] * 32, *[Pose2()] * 26, *[turn] * 56, *[Pose2()] * 26]):
        cv2.imwrite(str(folder / f"{index:04}.png"), CAMERA.image(ground, pose, seed=1, index=index))
        pose = pose @ step
    return folder


def test_a_recording_of_a_camera_of_unknown_scale_is_enough(there, recording, capsys):
    (there / "mine.yaml").write_text(f"sources: {{floor: {{plugin: image_folder, path: {recording}, rate_hz: 70}}}}\n")

    code, out, error = trailmark(capsys, "calibrate", "ground", "mine.yaml", "--distance", "0.12", "--out", "a.yaml")

    assert code == 0, error
    assert "The robot must" in error
    assert "scale along u   0.39" in out
    assert "not measured, ratio to u as before" in out
    line = next(line for line in out.splitlines() if line.startswith("  floor: "))
    (there / "used.yaml").write_text(
        f"sources: {{floor: {{plugin: image_folder, path: {recording}, rate_hz: 70}}}}\nsensors:\n{line}\n"
        "localizers: {floor: {plugin: ground_vo}}\n"
    )
    code, out, error = trailmark(capsys, "run", "used.yaml")
    assert code == 0, error
    assert read_calibration(there / "a.yaml").metres_per_pixel[0] == pytest.approx(3.9e-4, rel=0.01)


@pytest.mark.parametrize("lever_m", [None, (0.08123456, -0.02)])
def test_the_line_for_the_config_keeps_what_was_known(lever_m: tuple[float, float] | None, tmp_path: Path) -> None:
    sigma = None if lever_m is None else (1e-3, 1e-3)
    found = Calibrated((4e-4, 4e-4), (1e-6, 1e-6), True, math.radians(176.0), 1e-3, lever_m, sigma, 1.0)
    known = Pose3(x=0.05, z=0.2, roll=math.radians(180.0), yaw=math.radians(90.0))

    *_, head, line = _lines(found, SensorInfo("floor", "image", pose_base_sensor=known), "floor.calib.yaml")

    x, y = lever_m or (0.05, 0.0)
    config = read_yaml(f"{head}\n{line}\n")[0]["sensors"]["floor"]
    assert config["calibration"] == "floor.calib.yaml"
    assert Mounting(**config["mounting"]) == Mounting(x=round(x, 5), y=y, z=0.2, roll_deg=180.0, yaw_deg=176.0)


def test_two_calibrations_of_one_folder_have_a_flat_field_each(tmp_path: Path) -> None:
    found = Calibrated((4e-4, 4e-4), (1e-6, 1e-6), True, 0.0, 1e-3, None, None, 1.0)
    for name, brightness in (("cal.a.yaml", 0.5), ("cal.b.yaml", 0.9)):
        plane = GroundPlane((4e-4, 4e-4), flat_field=np.full((2, 2), brightness, np.float32))
        _write(tmp_path / name, found, SensorInfo("floor", "image", calibration=plane), ["told"])

    fields = [read_calibration(tmp_path / name).flat_field for name in ("cal.a.yaml", "cal.b.yaml")]
    assert [float(field[0, 0]) for field in fields] == pytest.approx([0.5, 0.9])


def test_what_is_missing_is_said_in_a_line(there, recording, capsys):
    (there / "mine.yaml").write_text(f"sources: {{floor: {{plugin: image_folder, path: {recording}, rate_hz: 70}}}}\n")
    command = ("calibrate", "ground", "mine.yaml")

    for arguments, complaint in (
        ((*command, "--distance", "0.12", "--distance", "0.2"), "2 straight moves were announced"),
        ((*command, "--distance", "-1"), "greater than 0"),
        ((*command, "--distance", "0.1", "--drive"), "cannot be driven"),
        ((*command, "--distance", "0.1", "--camera", "roof"), "no camera 'roof'; there are: floor"),
        ((*command, "--distance", "0.1", "--turn", "90"), "--turn says how far --drive turns the robot"),
    ):
        code, _, error = trailmark(capsys, *arguments)
        assert code == 2
        assert complaint in error
        assert "Traceback" not in error
    assert not (there / "floor.calib.yaml").exists()


def test_a_file_that_is_there_is_kept(there, recording, capsys):
    (there / "mine.yaml").write_text(f"sources: {{floor: {{plugin: image_folder, path: {recording}, rate_hz: 70}}}}\n")
    (there / "floor.calib.yaml").write_text("mine")
    command = ("calibrate", "ground", "mine.yaml", "--distance", "0.12")

    code, out, error = trailmark(capsys, *command)

    assert (code, out) == (2, "")
    assert "floor.calib.yaml is there already; choose another --out, or --overwrite" in error
    assert (there / "floor.calib.yaml").read_text() == "mine"
    assert "stand still" not in error
    assert trailmark(capsys, *command, "--overwrite")[0] == 0
    assert read_calibration(there / "floor.calib.yaml").metres_per_pixel[0] == pytest.approx(3.9e-4, rel=0.01)


def test_the_line_for_the_config_names_the_file_as_the_config_finds_it(there, recording, capsys):
    (there / "robot" / "lenses").mkdir(parents=True)
    (there / "robot" / "mine.yaml").write_text(
        f"sources: {{floor: {{plugin: image_folder, path: {recording}, rate_hz: 70}}}}\n"
    )
    command = ("calibrate", "ground", "robot/mine.yaml", "--distance", "0.12")

    below = trailmark(capsys, *command, "--out", "robot/lenses/a.yaml")
    elsewhere = trailmark(capsys, *command)

    assert "calibration: lenses/a.yaml}" in below[1]
    assert path_in_config(there / "a, b" / "c.yaml", there) == '"a, b/c.yaml"'
    assert f"calibration: {there.resolve() / 'floor.calib.yaml'}}}" in elsewhere[1]


@pytest.mark.parametrize(
    ("believed_deg", "has_sideways", "doubt"),
    [
        (0.0, False, None),
        (170.0, True, None),
        (90.0, False, "86 deg from the config's; did the robot drive forward (else --backward)"),
        (0.0, True, "if the first moves were those along the robot; else it is 90 deg off"),
    ],
)
def test_a_heading_that_other_moves_would_explain_is_doubted(believed_deg, has_sideways, doubt):
    found = Calibrated((4e-4, 4e-4), (1e-6, 1e-6), True, math.radians(176.0), 1e-3, None, None, 1.0)
    known = Pose3(yaw=math.radians(believed_deg))  # without any mounting nothing is believed

    lines = _lines(found, SensorInfo("floor", "image", pose_base_sensor=known), "floor.calib.yaml", has_sideways)

    heading = next(line for line in lines if line.startswith("heading"))
    assert heading.endswith("deg") if doubt is None else doubt in heading


class TestADriveThatIsNotFinished:
    """Less than the distance was driven: every figure would be wrong and sure."""

    @pytest.mark.parametrize("duration_s", [1.0, 2.5])
    def test_pictures_that_end_before_it_measure_nothing(self, there, capsys, duration_s):
        (there / "robot.yaml").write_text(SIMULATED + f"    duration_s: {duration_s}\n")

        code, out, error = trailmark(capsys, "calibrate", "ground", "robot.yaml", "--distance", "0.3", "--drive")

        assert (code, out) == (2, "")
        assert "ended before the drive was over" in error
        assert not list(there.glob("*.calib.*"))

    def test_an_interrupted_one_measures_nothing(self, there, monkeypatch):
        (there / "robot.yaml").write_text(SIMULATED)
        config = read_config(there / "robot.yaml")
        frames = SourceStream.frames

        def interrupted(stream):
            for n, frame in enumerate(frames(stream)):
                if n == 90:
                    raise KeyboardInterrupt
                yield frame

        monkeypatch.setattr(SourceStream, "frames", interrupted)

        with pytest.raises(KeyboardInterrupt):
            observe_drive(config, None, Speeds(0.3, 0.0), lambda line: None)
        by_hand = observe_drive(config, None, None, lambda line: None)
        assert by_hand.n_pictures == 90  # Ctrl-C ends a drive by hand


def test_a_folder_that_is_missing_is_said_before_the_drive(there, capsys):
    (there / "robot.yaml").write_text(SIMULATED)

    code, _, error = trailmark(
        capsys, "calibrate", "ground", "robot.yaml", "--distance", "0.3", "--drive", "--out", "none/floor.yaml"
    )

    assert code == 2
    assert "there is no folder none" in error
    assert "driving" not in error


def test_why_pictures_were_lost_is_said(there, capsys):
    pictures = there / "dark"
    pictures.mkdir()
    for number in range(40):
        cv2.imwrite(str(pictures / f"{number:03d}.png"), np.full((120, 160), 3, np.uint8))
    (there / "mine.yaml").write_text("sources: {floor: {plugin: image_folder, path: dark, rate_hz: 70}}\n")

    code, _, error = trailmark(capsys, "calibrate", "ground", "mine.yaml", "--distance", "0.12")

    assert code == 2
    assert "no two of them fit together: " in error


@pytest.mark.parametrize(("window", "verb"), [("stop_s=0.6", "ends"), ("start_s=0.6", "begins")])
def test_a_move_that_is_cut_off_is_not_taken_for_a_whole_one(there, recording, capsys, window, verb):
    (there / "mine.yaml").write_text(f"sources: {{floor: {{plugin: image_folder, path: {recording}, rate_hz: 70}}}}\n")

    code, out, error = trailmark(
        capsys, "calibrate", "ground", "mine.yaml", "--distance", "0.12", "--set", f"sources.floor.{window}"
    )

    assert (code, out) == (2, "")
    assert f"the recording {verb} while the camera moves" in error
