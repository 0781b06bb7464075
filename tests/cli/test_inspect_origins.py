"""Which mounting and calibration is used is said: that of the recording, or that of the config."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from trailmark.cli import main

PLUGIN = """
from trailmark import hookimpl
from trailmark.config import SourceConfig
from trailmark.frames import Frame, Odometry, SensorInfo, SensorOrigin
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import FrameSource

class Mounted(FrameSource):
    def __init__(self, config):
        super().__init__(config)

    @property
    def sensors(self):
        return {"wheels": SensorInfo("wheels", "odometry", pose_base_sensor=Pose3(x=0.25))}

    def frames(self):
        for index in range(20):
            yield Frame("wheels", 0.1 * index, Odometry(Pose2(0.01 * index)))

    def origins(self):
        return {"wheels": SensorOrigin("/tf_static (base_link -> wheels: x: 0.25)")}

class MountedConfig(SourceConfig):
    pass

class Long(Mounted):
    sensors = {"a" * 90: SensorInfo("a" * 90, "odometry", rate_hz=12.5)}

    def frames(self):
        yield Frame("a" * 90, 0.0, Odometry(Pose2()))

    def origins(self):
        return {}

    def unread(self):
        return {"/chatter": "not understood"}

@hookimpl
def trailmark_register(registry):
    registry.source("long", Long, config=MountedConfig, summary="A source whose sensor has a long name")
    registry.source("mounted", Mounted, config=MountedConfig, summary="A source that says where its sensor is")
"""
CONFIG = "sources: {robot: {plugin: mounted}}\nlocalizers: {wheels: {plugin: odometry}}\n"
OVERRIDE = "sensors: {wheels: {mounting: {x: 0.5}}}\n"
TOLD = "/tf_static (base_link -> wheels: x: 0.25)"


@pytest.fixture(scope="module")
def plugin(tmp_path_factory: pytest.TempPathFactory) -> str:
    """One file for all tests here: a plugin's file is a module, and a module is loaded from one place."""
    file = tmp_path_factory.mktemp("plugin") / "mounted.py"
    file.write_text(PLUGIN)
    return str(file)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("more", "line", "x"),
    [
        ("", f"wheels: mounting of {TOLD}", 0.25),
        (OVERRIDE, f"wheels: mounting of the config, not of {TOLD}", 0.5),
    ],
)
def test_inspect_and_run_say_which_mounting_is_used(
    folder: Path, plugin: str, capsys, more: str, line: str, x: float
) -> None:
    (folder / "c.yaml").write_text(CONFIG + more)

    with pytest.raises(SystemExit):
        main(["--plugin", plugin, "inspect", "c.yaml"])
    shown = capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["--plugin", plugin, "inspect", "c.yaml", "--json"])
    (row,) = json.loads(capsys.readouterr().out)
    with pytest.raises(SystemExit):
        main(["--plugin", plugin, "run", "c.yaml", "--no-report", "--out", "out"])
    said = capsys.readouterr().err

    assert line in shown.splitlines()
    assert row["mounting"]["x"] == x
    assert said.splitlines().count(line) == 1


def test_a_long_name_costs_no_column(folder, plugin, capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    (folder / "c.yaml").write_text("sources: {robot: {plugin: long}}\n")

    with pytest.raises(SystemExit):
        main(["--plugin", plugin, "inspect", "c.yaml"])

    shown = capsys.readouterr().out
    assert "a" * 90 in shown
    assert "odometry" in shown
    assert "12.5 Hz" in shown
    assert "not read: /chatter (not understood)" in shown


def test_what_is_not_read_stands_beside_the_json(folder, plugin, capsys) -> None:
    (folder / "c.yaml").write_text("sources: {robot: {plugin: long}}\n")

    with pytest.raises(SystemExit):
        main(["--plugin", plugin, "inspect", "c.yaml", "--json"])

    out, err = capsys.readouterr()
    assert len(json.loads(out)) == 1
    assert "not read: /chatter (not understood)" in err
