"""Maps as ROS keeps them: what each pixel means, which way is up, and what is wrong said with its key."""

from __future__ import annotations

import math
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from trailmark.errors import ConfigError, ShapeError
from trailmark.geometry import Pose2
from trailmark_laser_maps.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from trailmark_laser_maps.map_yaml import cells_of_picture, read_map, write_map


def write_files(folder: Path, picture: np.ndarray | bytes, suffix: str = "png", **keys: object) -> Path:
    name = f"plan.{suffix}"
    if isinstance(picture, bytes):
        (folder / name).write_bytes(picture)
    else:
        cv2.imwrite(str(folder / name), picture)
    document = {"image": name, "resolution": 0.1, "origin": [0.0, 0.0, 0.0], **keys}
    path = folder / "map.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in document.items() if value is not None))
    return path


def trinary_of_map_server(grey: int, negate: bool, free: float, occupied: float) -> int:
    """What map_server's own lines make of a grey pixel (image_loader.cpp), one at a time."""
    shade = (255 - grey) if negate else grey
    occ = (255 - shade) / 255.0
    if occ > occupied:
        return 100
    return 0 if occ < free else -1


@pytest.mark.parametrize("negates", [False, True])
@pytest.mark.parametrize("thresholds", [(0.196, 0.65), (0.25, 0.65), (0.1, 0.9)])
def test_every_grey_means_what_map_server_says(negates: bool, thresholds: tuple[float, float]) -> None:
    greys = np.arange(256, dtype=np.uint8)[np.newaxis]
    cells = cells_of_picture(greys, negates=negates, thresholds=thresholds)
    assert cells[0].tolist() == [trinary_of_map_server(grey, negates, *thresholds) for grey in range(256)]


def test_the_first_row_of_the_picture_is_the_top_of_the_map(tmp_path: Path) -> None:
    picture = np.full((3, 5), 254, np.uint8)
    picture[0, 4] = 0  # upper right
    grid = read_map(write_files(tmp_path, picture, origin=[-1.0, 2.0, 0.0]))

    assert grid.cells.tolist() == [[0] * 5, [0] * 5, [0, 0, 0, 0, OCCUPIED]]
    middle = grid.pose_map_grid @ grid.centres(grid.is_occupied)[0]
    np.testing.assert_allclose(middle, [-1.0 + 0.45, 2.0 + 0.25])


def test_the_origin_may_be_turned(tmp_path: Path) -> None:
    grid = read_map(write_files(tmp_path, np.zeros((1, 1), np.uint8), origin=[1.0, 2.0, math.pi / 2]))
    np.testing.assert_allclose(grid.pose_map_grid @ np.array([0.1, 0.0]), [1.0, 2.1], atol=1e-12)


def test_colours_are_averaged_and_alpha_counts_as_ros_counts_it(tmp_path: Path) -> None:
    clear_white = np.full((1, 1, 4), 255, np.uint8)
    clear_white[..., 3] = 0
    assert cells_of_picture(clear_white, mode="trinary", thresholds=(0.2, 0.65))[0, 0] == UNKNOWN  # a mean of 3/4
    for colour in (255, 128, 0):  # what is not opaque is unknown, whatever its colour
        clear = np.full((1, 1, 4), colour, np.uint8)
        clear[..., 3] = 254
        assert cells_of_picture(clear, mode="scale")[0, 0] == UNKNOWN
    coloured = np.array([[[0, 0, 255]]], np.uint8)
    assert cells_of_picture(coloured)[0, 0] == OCCUPIED  # darkness 2/3
    assert read_map(write_files(tmp_path, coloured)).cells[0, 0] == OCCUPIED


def test_scale_and_raw_modes_are_those_of_nav2() -> None:
    greys = np.array([[254, 140, 0]], np.uint8)
    share = (1 - 140 / 255 - 0.25) / 0.4
    assert cells_of_picture(greys, mode="scale").tolist() == [[0, round(share * 100), 100]]
    raw = np.array([[0, 57, 100, 101, 255]], np.uint8)
    for negates in (False, True):
        assert cells_of_picture(raw, mode="raw", negates=negates).tolist() == [[0, 57, 100, -1, -1]]


def test_thresholds_the_wrong_way_round_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"free_thresh is 0\.7 and occupied_thresh 0\.65"):
        read_map(write_files(tmp_path, np.zeros((1, 1), np.uint8), free_thresh=0.7))


@pytest.mark.parametrize("suffix", ["pgm", "png"])
def test_sixteen_bits_are_read(tmp_path: Path, suffix: str) -> None:
    picture = np.array([[65535, 0, 52685]], np.uint16)
    assert read_map(write_files(tmp_path, picture, suffix, free_thresh=0.196)).cells.tolist() == [[0, 100, -1]]


def test_a_pgm_of_text_with_a_comment_is_read(tmp_path: Path) -> None:
    path = write_files(tmp_path, b"P2\n# CREATOR: by hand\n2 1\n255\n0 254\n", "pgm", free_thresh=None)
    assert read_map(path).cells.tolist() == [[100, 0]]


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    cells = rng.choice(np.array([FREE, OCCUPIED, UNKNOWN], np.int8), (23, 17))
    grid = OccupancyGrid(cells, 0.025, Pose2(-3.5, 1.25, 0.3))

    picture = write_map(tmp_path / "office.yaml", grid)
    back = read_map(tmp_path / "office.yaml")

    assert picture == tmp_path / "office.pgm"
    assert picture.read_bytes().startswith(b"P5\n17 23\n255\n")
    np.testing.assert_array_equal(back.cells, cells)
    assert back.resolution_m == 0.025
    np.testing.assert_allclose(back.pose_map_grid.array(), grid.pose_map_grid.array(), atol=1e-6)


def test_what_is_written_means_the_same_with_the_thresholds_of_ros_1() -> None:
    painted = np.array([[0, 254, 205]], np.uint8)
    assert cells_of_picture(painted, thresholds=(0.196, 0.65)).tolist() == [[OCCUPIED, FREE, UNKNOWN]]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"resolution": None}, "resolution is missing"),
        ({"resolution": -0.05}, "resolution is -0.05"),
        ({"resolution": ".nan"}, "resolution is nan"),
        ({"origin": "[0, 0]"}, "origin is"),
        ({"origin": "[0, 0, .inf]"}, "origin is"),
        ({"origin": "here"}, "origin is 'here'"),
        ({"mode": "colour"}, "mode is 'colour'"),
        ({"negate": 2}, "negate is 2"),
        ({"free_thresh": "low"}, "free_thresh is 'low'"),
        ({"image": "none.pgm"}, "its image .*none.pgm: cannot be read"),
        ({"image": None}, "image is None"),
        ({"image": "map.yaml"}, "its image .*unreadable picture"),
    ],
)
def test_what_is_wrong_is_said_with_its_key(tmp_path: Path, keys: dict[str, object], message: str) -> None:
    path = write_files(tmp_path, np.zeros((2, 2), np.uint8), **keys)
    with pytest.raises(ConfigError, match=message):
        read_map(path)


@pytest.mark.parametrize("text", ["", "[1, 2]", "image: [", "\x00"])
def test_what_is_no_map_is_said(tmp_path: Path, text: str) -> None:
    path = tmp_path / "map.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"map\.yaml"):
        read_map(path)


def test_bytes_that_are_no_text_are_said_so(tmp_path: Path) -> None:
    path = tmp_path / "film.avi"
    path.write_bytes(b"RIFF\xd8\xff")
    with pytest.raises(ConfigError, match="not UTF-8 text"):
        read_map(path)


def test_a_bomb_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    path.write_text("image: " + "[" * 5000)
    with pytest.raises(ConfigError, match=r"map\.yaml"):
        read_map(path)


def test_a_pipe_in_place_of_the_picture_is_not_waited_for(tmp_path: Path) -> None:
    path = write_files(tmp_path, np.zeros((2, 2), np.uint8), image="pipe.pgm")
    os.mkfifo(tmp_path / "pipe.pgm")
    with pytest.raises(ConfigError, match="is no file"):
        read_map(path)


def test_a_grid_has_cells_and_a_size() -> None:
    with pytest.raises(ShapeError, match="cells must be"):
        OccupancyGrid(np.zeros((0, 3), np.int8), 0.05)
    with pytest.raises(ShapeError, match="resolution"):
        OccupancyGrid(np.zeros((2, 3), np.int8), 0.0)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"origin": [0.0, 0.0, 90.0]}, "radians"),
        ({"occupied_thresh": 65, "free_thresh": 20}, "percentage"),
        ({"resolution": 1e-9}, "resolution"),
        ({"resolution": 1e9}, "resolution"),
    ],
)
def test_numbers_in_another_unit_are_refused(tmp_path, keys, words):
    path = write_files(tmp_path, np.full((3, 4), 254, np.uint8), **keys)
    with pytest.raises(ConfigError, match=words):
        read_map(path)


@pytest.mark.parametrize(("white", "kind"), [(100, "u1"), (1000, ">u2")])
def test_white_of_a_binary_pgm_is_what_its_header_says(tmp_path, white, kind):
    pixels = np.array([[0, white, white // 2]], dtype=kind)
    path = write_files(tmp_path, f"P5\n# by hand\n3 1\n{white}\n".encode() + pixels.tobytes(), "pgm", free_thresh=0.1)
    np.testing.assert_array_equal(read_map(path).cells, [[OCCUPIED, FREE, UNKNOWN]])


def test_a_raw_map_of_greys_is_said_to_have_nothing_occupied(tmp_path, caplog):
    read_map(write_files(tmp_path, np.array([[0, 205, 254]], np.uint8), mode="raw"))
    assert "trinary" in caplog.text


def test_a_corrupt_picture_is_told_once(tmp_path, capfd):
    path = write_files(tmp_path, b"P5\n100 60\n255\n" + bytes(20), "pgm")
    with pytest.raises(ConfigError, match=r"plan\.pgm"):
        read_map(path)
    assert "ERROR" not in capfd.readouterr().err
