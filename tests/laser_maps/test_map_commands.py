"""``trailmark map``: from a taught place to files of ROS, and what they hold."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from trailmark.arrays import Floats
from trailmark.errors import ConfigError
from trailmark.frames import SensorInfo
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Session
from trailmark.paths import Keyframe, Waypoint
from trailmark.stores import SqlitePathStore, SqliteStoreConfig
from trailmark_laser_maps.commands import map_group
from trailmark_laser_maps.map_yaml import read_map

LASER_AT = Pose2(0.2, 0.0, 0.0)


@pytest.fixture(scope="module")
def taught(tmp_path_factory: pytest.TempPathFactory, walls: Floats, look: Callable[..., Floats]) -> Path:
    """A store with a drive through the room, the laser 0.2 m before the middle of the robot."""
    path = tmp_path_factory.mktemp("taught") / "room.trail"
    store = SqlitePathStore(SqliteStoreConfig(path=str(path), access="create"))
    store.start(Session())
    store.set_sensors({"laser": SensorInfo("laser", "scan", pose_base_sensor=Pose3.from_planar(LASER_AT))})
    for name in ("laser", "other"):
        for index, x in enumerate(np.arange(1.0, 7.0, 0.25).tolist()):
            pose = Pose2(x, 1.5, 0.3)
            points = LASER_AT @ look(walls, pose @ LASER_AT)
            key = "points" if name == "laser" else "descriptors"
            store.localizer_map(name).add(Keyframe(0.25 * index, float(index), pose, {key: points.astype(np.float32)}))
    store.append(Waypoint(0, 0.0, Pose2(1.0, 1.5, 0.3)))
    store.append(Waypoint(1, 5.75, Pose2(6.75, 1.5, 0.3)))
    store.commit()
    store.close()
    return path


def run(*arguments: str | Path) -> str:
    result = CliRunner().invoke(map_group, [str(argument) for argument in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_a_taught_place_becomes_a_map_whose_walls_stand_where_they_stand(
    taught: Path, tmp_path: Path, walls: Floats
) -> None:
    out = tmp_path / "room.yaml"
    told = json.loads(run("export", taught, "--out", out, "--json"))

    grid = read_map(out)
    assert told["scans"] == 24
    assert told["image"] == str(tmp_path / "room.pgm")
    assert told["free_m2"] == pytest.approx(grid.free_m2, abs=1e-3)
    occupied = grid.pose_map_grid @ grid.centres(grid.is_occupied)
    on_south_wall = occupied[(np.abs(occupied[:, 1]) < 0.2) & (np.abs(occupied[:, 0] - 4.0) < 3.8)]
    assert len(on_south_wall) > 100
    assert np.abs(on_south_wall[:, 1]).max() < 0.05
    inside = (grid.pose_map_grid @ grid.centres(grid.is_free)) - [4.0, 2.5]
    assert (np.abs(inside).max(axis=0) < [4.05, 2.55]).all()


def test_show_says_size_and_place_and_draws_it(taught: Path, tmp_path: Path) -> None:
    out = tmp_path / "room.yaml"
    assert "grid_mcl, map:" in run("export", taught, "--out", out, "--resolution", "0.1")
    text = run("show", out, "--width", "60")
    assert "cells of 0.1 m" in text
    sketch = text.splitlines()[2:]
    assert max(map(len, sketch)) <= 60
    assert any("#" in line and "." in line for line in sketch)
    assert json.loads(run("show", out, "--json"))["resolution_m"] == 0.1


def test_files_that_stand_there_stay(taught: Path, tmp_path: Path) -> None:
    out = tmp_path / "room.yaml"
    out.with_suffix(".pgm").write_text("mine")
    with pytest.raises(ConfigError, match="--overwrite"):
        run("export", taught, "--out", out)
    assert out.with_suffix(".pgm").read_text() == "mine"
    run("export", taught, "--out", out, "--overwrite")
    assert read_map(out).free_m2 > 20


def test_what_cannot_be_exported_is_said(taught: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no localizer 'other' that remembers scans"):
        run("export", taught, "--out", tmp_path / "a.yaml", "--localizer", "other")
    bare = SqlitePathStore(SqliteStoreConfig(path=str(tmp_path / "bare.trail"), access="create"))
    bare.start(Session())
    bare.append(Waypoint(0, 0.0, Pose2()))
    bare.commit()
    bare.close()
    with pytest.raises(ConfigError, match="holds nothing of a localizer that remembers scans"):
        run("export", tmp_path / "bare.trail", "--out", tmp_path / "a.yaml")
    with pytest.raises(ConfigError, match=r"a map is a \.yaml"):
        run("export", taught, "--out", tmp_path / "a.pgm")
    assert list(tmp_path.iterdir()) == [tmp_path / "bare.trail"]


def test_scans_of_several_lasers_are_not_drawn_from_the_wrong_place(tmp_path: Path, walls: Floats) -> None:
    path = tmp_path / "two.trail"
    store = SqlitePathStore(SqliteStoreConfig(path=str(path), access="create"))
    store.start(Session())
    places = {"front": LASER_AT, "rear": Pose2(-0.3, 0.0, 3.1)}
    store.set_sensors(
        {name: SensorInfo(name, "scan", pose_base_sensor=Pose3.from_planar(at)) for name, at in places.items()}
    )
    store.localizer_map("laser").add(Keyframe(0.0, 0.0, Pose2(), {"points": walls[:2].astype(np.float32)}))
    store.append(Waypoint(0, 0.0, Pose2()))
    store.commit()
    store.close()

    with pytest.raises(ConfigError, match=r"several lasers \(front, rear\)"):
        run("export", path, "--out", tmp_path / "two.yaml")
