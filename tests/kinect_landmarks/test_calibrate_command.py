"""``trailmark calibrate rgbd``, end to end in the simulator, where the true cameras are known."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import trailmark
from trailmark.cli import main
from trailmark.config import load_run_config, read_calibration
from trailmark.errors import ConfigError
from trailmark.frames import RGBD, DepthCamera, Pinhole
from trailmark.geometry import Pose3
from trailmark.interfaces import Session
from trailmark.plugins import load_plugins
from trailmark.recording import write_png
from trailmark_kinect_landmarks.calibrating.board import BoardView, find_board
from trailmark_kinect_landmarks.calibrating.crop_ratios import fit_crop
from trailmark_kinect_landmarks.calibrating.lenses import fit_lenses
from trailmark_kinect_landmarks.calibration import Crop, depth_pixels, optical_transform

TRUE = DepthCamera(
    Pinhole(525.0, 525.0, 319.5, 239.5), Pinhole(585.0, 585.0, 319.5, 239.5), Pose3(y=0.025), depth_kind="z"
)
CONFIG = """
sources:
  rgbd:
    plugin: sim
    world: target
    sensors: [rgbd]
    rates_hz: {rgbd: 1}
    duration_s: 40.5
"""


def _run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as end:
        main(["calibrate", "rgbd", *(str(argument) for argument in arguments)])
    said = capsys.readouterr()
    return int(end.value.code or 0), said.out, said.err


def _colour_uv(camera: DepthCamera, depth_uv: np.ndarray, z_m: float) -> np.ndarray:
    """Return where pixels of the depth camera are in colour, at a depth."""
    assert camera.depth is not None
    depth, colour = camera.depth, camera.colour
    rays = (depth_uv - (depth.cx, depth.cy)) / (depth.fx, depth.fy)
    T = optical_transform(camera.pose_colour_depth)
    points = np.column_stack([rays * z_m, np.full(len(rays), z_m)]) @ T[:3, :3].T + T[:3, 3]
    return points[:, :2] / points[:, 2:] * (colour.fx, colour.fy) + (colour.cx, colour.cy)


def _off_px(camera: DepthCamera, z_m: float) -> float:
    """Return by how much depth pixels all over the picture are put wrong, rms [px]."""
    grid = np.stack(np.meshgrid(np.linspace(20, 620, 13), np.linspace(20, 460, 10)), axis=-1).reshape(-1, 2)
    misses = _colour_uv(camera, grid, z_m) - _colour_uv(TRUE, grid, z_m)
    return float(np.sqrt((misses**2).sum(axis=1).mean()))


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("target") / "target.yaml"
    path.write_text(CONFIG, encoding="utf-8")
    return path


def test_lenses_and_pose_follow_from_a_board_of_known_size(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "kinect.calib.yaml"

    code, told, _ = _run(capsys, config, "--board", "0.60x0.45", "--out", out)

    assert code == 0
    assert "miss by" in told
    found = read_calibration(out)
    assert isinstance(found, DepthCamera)
    assert found.depth is not None
    assert found.colour.fx == pytest.approx(525.0, rel=0.01)
    assert found.depth.fx == pytest.approx(585.0, rel=0.01)
    assert found.pose_colour_depth.y == pytest.approx(0.025, abs=0.005)
    # At the distances at which the board was, and beyond: depth is on the right pixel.
    assert max(_off_px(found, z_m) for z_m in (1.0, 1.5, 2.0)) < 1.0
    assert _off_px(found, 4.0) < 1.5
    run = tmp_path / "run.yaml"
    run.write_text(
        CONFIG + f"sensors:\n  rgbd: {{calibration: {out.name}}}\nlocalizers: {{flow: {{plugin: kinect_flow}}}}\n",
        encoding="utf-8",
    )
    given = load_run_config(run, plugins=load_plugins()).sensors["rgbd"].calibration
    assert given == found


def test_the_crop_is_right_at_the_board_s_distance(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "crop.calib.yaml"

    code, told, _ = _run(capsys, config, "--out", out)

    assert code == 0
    numbers = [int(text) for text in re.findall(r"(?:left|right|top|bottom) (\d+)", told)]
    crop = Crop(*numbers)
    assert sum(numbers[:2]) == pytest.approx(66, abs=3)  # 640 - 640 * 525 / 585
    assert sum(numbers[2:]) == pytest.approx(49, abs=3)
    assert 4 <= numbers[1] - numbers[0] <= 28  # 25 mm to the side are 9 px at 1.5 m, twice that between both borders
    centres = np.array([[100.0, 100.0], [320.0, 240.0], [540.0, 400.0]])
    pixels, exists = depth_pixels(centres, crop, (640, 480), (640, 480))
    assert exists.all()
    off = _colour_uv(TRUE, pixels.astype(float), 1.45) - centres
    assert np.abs(off).max() < 4.0
    # The file says the same as the ratios do.
    found = read_calibration(out)
    assert isinstance(found, DepthCamera)
    np.testing.assert_allclose(_colour_uv(found, pixels.astype(float), 1.45), centres, atol=0.6)


def test_the_paper_s_way_by_hand(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "hand.calib.yaml"

    code, told, _ = _run(capsys, "--edges", "33,606,25,454", "--out", out)

    assert code == 0
    assert "crop           left 33, right 33, top 25, bottom 25 px" in told
    assert "R_x 1.1150, R_y 1.1163" in told
    found = read_calibration(out)
    assert isinstance(found, DepthCamera)
    assert found.pose_colour_depth == Pose3()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "give a recording, or --edges, and not both"),
        (("--edges", "33,606,25"), "--edges takes LEFT,RIGHT,TOP,BOTTOM"),
        (("--edges", "606,33,25,454"), "left before right"),
        (("--edges", "33,34,25,26"), "leaves 2 x 2 px of 640 x 480: give the columns and rows"),
        (("--edges", "33,606,25,454", "--size", "640"), "--size takes WIDTHxHEIGHT"),
        (("nowhere/",), "no file or folder nowhere/"),
        (("--edges", "33,606,25,454", "--board", "0.6x0.45"), "--board has no effect here"),
        (("nowhere/", "--size", "640x480"), "--size has no effect here: a recording tells the sizes"),
    ],
)
def test_wrong_requests_are_told_in_one_line(
    arguments: tuple[str, ...], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, error = _run(capsys, *arguments, "--out", tmp_path / "x.yaml")

    assert code == 2
    assert message in error
    assert len(error.strip().splitlines()) == 1


def test_a_file_that_is_there_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "old.yaml"
    out.write_text("mine")

    code, _, error = _run(capsys, "--edges", "33,606,25,454", "--out", out)

    assert code == 2
    assert "--overwrite" in error
    assert out.read_text() == "mine"


def test_a_lens_of_another_size_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lens = tmp_path / "lens.yaml"
    lens.write_text("fx: 1180\nfy: 1180\ncx: 640\ncy: 480\n", encoding="utf-8")
    out = tmp_path / "hand.calib.yaml"

    code, _, error = _run(capsys, "--edges", "33,606,25,454", "--colour", lens, "--out", out)

    assert code == 2
    assert "far from the middle of the pictures of 640 x 480 px; calibrate it at their size" in error
    assert not out.exists()
    whole = ("--edges", "66,1212,50,908", "--size", "1280x960", "--colour", lens, "--out", out)
    assert _run(capsys, *whole)[0] == 0


def test_too_few_views_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    short = tmp_path / "short.yaml"
    short.write_text(CONFIG.replace("40.5", "2.5"), encoding="utf-8")

    code, _, error = _run(capsys, short, "--board", "0.60x0.45", "--out", tmp_path / "x.yaml")

    assert code == 2
    assert "lenses need 8: show it more often" in error


def test_two_recordings_do_as_well_as_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = trailmark.create("source", "sim", world="target", sensors=["rgbd"], rates_hz={"rgbd": 1.0}, duration_s=9.5)
    source.start(Session(name="rgbd", rng=np.random.default_rng(0)))
    for k, frame in enumerate(source.frames()):
        assert isinstance(frame.payload, RGBD)
        write_png(tmp_path / "colour" / f"{k:03d}.png", frame.payload.bgr)
        depth = np.nan_to_num(frame.payload.depth_m * 1000.0).round().astype(np.uint16)
        write_png(tmp_path / "depth" / f"{k:03d}.png", depth)
    (tmp_path / "two.yaml").write_text(
        "sources:\n"
        "  colour: {plugin: image_folder, path: colour/, rate_hz: 1}\n"
        "  depth: {plugin: image_folder, path: depth/, rate_hz: 1, time_offset_s: 0.01}\n",
        encoding="utf-8",
    )
    two = tmp_path / "two.yaml"

    code, told, _ = _run(capsys, two, "--sensor", "colour", "--depth", "depth", "--out", tmp_path / "x.yaml")
    assert code == 0
    assert "Eqs. (3), (4)  R_x 1.1" in told

    code, _, error = _run(capsys, two, "--out", tmp_path / "y.yaml")
    assert code == 2
    assert "name the depth camera with --depth" in error


def test_views_at_one_distance_cannot_tell_parallax_from_the_lens() -> None:
    square = np.array([[100.0, 100.0], [200.0, 100.0], [200.0, 200.0], [100.0, 200.0]])
    views = [BoardView(square + 20.0 * i, square + 20.0 * i, np.full(4, 1.5)) for i in range(10)]

    with pytest.raises(ConfigError, match=r"was at 1\.50 to 1\.50 m: show it nearer"):
        fit_lenses(views, (0.3, 0.3), (640, 480), (640, 480))


def test_a_board_in_the_middle_alone_tells_no_borders() -> None:
    square = np.array([[300.0, 200.0], [340.0, 200.0], [340.0, 240.0], [300.0, 240.0]])

    with pytest.raises(ConfigError, match="6 % of the picture's width and 8 % of its height"):
        fit_crop([BoardView(square, square, np.full(4, 1.5))] * 3, (640, 480), (640, 480))


def test_no_board_is_no_view() -> None:
    rng = np.random.default_rng(7)

    assert find_board(rng.integers(0, 255, (480, 640, 3), np.uint8), np.full((480, 640), 2.0, np.float32)) is None
