"""Runs of configs: through plugins, stores and folders."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import pytest

import trailmark
from trailmark.config import load_run_config
from trailmark.errors import ConfigError, PluginLoadError, UnknownPluginError
from trailmark.pipeline import Pipeline
from trailmark.plugins import load_plugins

PLUGIN = """
import numpy as np
import trailmark
from trailmark.config import PluginConfig, Sensor, SourceConfig
from trailmark.estimates import Motion, information_from_sigmas
from trailmark.frames import Frame, Image, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import FrameSource, Localizer
from trailmark.paths import Keyframe

class BlankConfig(SourceConfig):
    n: int = 20

class Blank(FrameSource):
    def start(self, session):
        self._name = session.name
    @property
    def sensors(self):
        return {self._name: SensorInfo(self._name, "image")}
    def frames(self):
        for i in range(self.config.n):
            yield Frame(self._name, i / 10, Image(np.zeros((2, 3), np.uint8)))

class StepperConfig(PluginConfig):
    camera: Sensor["image"]
    step_m: float = 0.1

class Stepper(Localizer):
    def start(self, session):
        self.session, self.last_s = session, None
    def observe(self, frame, belief):
        last_s, self.last_s = self.last_s, frame.stamp_s
        if self.session.mode == "teach":
            arrays = {"patch": np.arange(4, dtype=np.uint8)}
            self.session.map.add(Keyframe(belief.travelled_m, frame.stamp_s, belief.pose_map_base, arrays))
        if last_s is None:
            return ()
        return (Motion(last_s, frame.stamp_s, Pose2(self.config.step_m), information_from_sigmas(0.01, 0.01, 0.01)),)
    def finish(self):
        self.session.map.save("index", {"n": np.array([len(self.session.map.keyframes())])})

class Fragile(Localizer):
    def __init__(self, config):
        raise OSError("no licence")
    def observe(self, frame, belief):
        return ()

@trailmark.hookimpl
def trailmark_register(registry):
    registry.source("blank", ":Blank", config=":BlankConfig")
    registry.localizer("stepper", ":Stepper", config=":StepperConfig", gives=["motion"])
    registry.localizer("fragile", ":Fragile")

@trailmark.hookimpl
def trailmark_run_started(run):
    raise RuntimeError("a hook that raises costs a warning")
"""

CONFIG = """
sources: {floor: {plugin: blank}}
localizers: {vo: {plugin: stepper}}
"""


@pytest.fixture(scope="module")
def plugins(tmp_path_factory):
    path = tmp_path_factory.mktemp("plugins") / "toys.py"
    path.write_text(PLUGIN)
    return load_plugins(files=[path])


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "config.yaml"
    path.write_text(CONFIG)
    return path


def test_a_config_runs_to_a_complete_folder(config: Path, plugins, tmp_path: Path) -> None:
    result = trailmark.run(config, tmp_path / "run", plugins=plugins, report=False)

    assert result.status == "done"
    assert result.trajectories["fused"].poses[-1, 0] == pytest.approx(1.9)
    assert {"config.yaml", "run.json", "timing.json", "estimates.csv", "metrics.json"} <= {
        path.name for path in (tmp_path / "run").iterdir()
    }
    assert json.loads((tmp_path / "run/run.json").read_text())["plugins"]["trailmark:core"] == trailmark.__version__


def test_a_run_has_a_report(config: Path, plugins, tmp_path: Path) -> None:
    result = trailmark.run(config, tmp_path / "run", plugins=plugins)

    assert (tmp_path / "run/report.html").stat().st_size > 1000
    assert "fused" in result.metrics["trajectories"]


def test_the_config_of_a_run_gives_the_same_run(config: Path, plugins, tmp_path: Path) -> None:
    trailmark.run(config, tmp_path / "a", plugins=plugins, report=False, overrides=["localizers.vo.step_m=0.2"])
    trailmark.run(tmp_path / "a/config.yaml", tmp_path / "b", plugins=plugins, report=False)

    for name in ("config.yaml", "estimates.csv", "trajectories/fused.tum"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert "camera: floor" in (tmp_path / "a/config.yaml").read_text()  # the role is filled in


@pytest.mark.parametrize("n_steps", [0, 5])
def test_ctrl_c_keeps_what_is_done(config: Path, plugins, tmp_path: Path, n_steps: int) -> None:
    def on_step(pipeline, step):
        if step.stamp_s >= 0.1 * n_steps:
            raise KeyboardInterrupt

    result = trailmark.run(config, tmp_path / "run", plugins=plugins, report=False, on_step=on_step)

    assert result.status == "interrupted"
    assert result.counters["frames"] == n_steps + 1
    assert json.loads((tmp_path / "run/run.json").read_text())["reason"] == "interrupted by the user"


def test_without_a_folder_a_new_one_is_made_and_linked(config: Path, plugins, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)

    result = trailmark.run(config, plugins=plugins, report=False)

    assert result.folder is not None
    assert result.folder.parent == tmp_path / "runs"
    assert (tmp_path / "runs/latest").resolve() == result.folder


def test_a_hook_that_raises_costs_a_warning(config: Path, plugins, caplog) -> None:
    *_, last = Pipeline(config, plugins=plugins)

    assert last.belief.travelled_m == pytest.approx(1.9)
    assert "failed in trailmark_run_started: RuntimeError: a hook that raises costs a warning" in caplog.text


def test_a_place_is_taught_and_replayed(config: Path, plugins, tmp_path: Path) -> None:
    store = tmp_path / "office.trail"

    with Pipeline(config, mode="teach", store=store, plugins=plugins) as teaching:
        n_waypoints = [teaching.n_waypoints for _ in teaching][-1]
    with Pipeline(config, mode="replay", store=store, plugins=plugins, overrides=["start=last"]) as replay:
        path = replay.path
        first = next(replay)

    assert n_waypoints == 20
    assert path is not None
    assert len(path) == 20
    assert first.belief.pose_map_base.x == pytest.approx(1.9)
    assert first.belief.on_path.station_m == pytest.approx(1.9)
    with pytest.raises(trailmark.errors.TrailmarkError, match="exists"):
        list(Pipeline(config, mode="teach", store=store, plugins=plugins))
    list(Pipeline(config, mode="teach", store=store, plugins=plugins, access="append", overrides=["start=last"]))
    with Pipeline(config, mode="track", store=store, plugins=plugins) as again:
        assert len(again.path) == 39


def test_a_config_that_is_loaded_already_takes_a_store_too(config: Path, plugins, tmp_path: Path) -> None:
    loaded = load_run_config(config, plugins=plugins)

    list(Pipeline(loaded, mode="teach", store=tmp_path / "a.trail", plugins=plugins))

    assert (tmp_path / "a.trail").is_file()


def test_teaching_without_a_store_says_how_to_name_one(config: Path, plugins) -> None:
    with pytest.raises(ConfigError, match=r"mode teach needs a path store: give one with --store"):
        list(Pipeline(config, mode="teach", plugins=plugins))


def test_a_sensor_that_no_source_has_is_refused_before_the_first_frame(config: Path, plugins) -> None:
    pipeline = Pipeline(config, plugins=plugins, overrides=["localizers.vo.camera=roof"])

    with pytest.raises(ConfigError, match="no sensor is called 'roof'"):
        next(pipeline)


def test_two_sources_with_a_sensor_of_one_name_are_refused(config: Path, plugins) -> None:
    overrides = ["sources.roof.plugin=blank", "sources.roof.rename={roof: floor}"]

    with pytest.raises(ConfigError, match="duplicate sensor 'floor'"):
        next(Pipeline(config, plugins=plugins, overrides=overrides))


def test_a_part_that_cannot_be_constructed_is_named(config: Path, plugins) -> None:
    pipeline = Pipeline(config, plugins=plugins, overrides=["localizers.vo={plugin: fragile}"])

    with pytest.raises(PluginLoadError, match=r"localizer 'fragile' of plugin 'toys'.*OSError: no licence"):
        next(pipeline)


class TestJsonl:
    def lines(self, config, plugins, monkeypatch, **options) -> list[dict]:
        out = io.StringIO()
        monkeypatch.setattr(sys, "stdout", out)
        sink = {"plugin": "jsonl", **options}
        list(Pipeline(config, plugins=plugins, overrides=[("sinks", [sink])]))
        return [json.loads(line) for line in out.getvalue().splitlines()]

    def test_beliefs_are_lines(self, config: Path, plugins, monkeypatch) -> None:
        lines = self.lines(config, plugins, monkeypatch)

        assert [line["type"] for line in lines] == ["belief"] * 20 + ["end"]
        assert lines[-2]["pose_map_base"] == pytest.approx([1.9, 0.0, 0.0])
        assert lines[0]["motion_age_s"] is None  # JSON knows no infinity
        assert lines[-1] == {"type": "end", "status": "done", "reason": ""}

    def test_estimates_are_lines_when_wanted(self, config: Path, plugins, monkeypatch) -> None:
        lines = self.lines(config, plugins, monkeypatch, beliefs=False, estimates=True)

        assert len(lines) == 20
        assert lines[0]["kind"] == "Motion"
        assert lines[0]["status"] == "accepted"
        assert lines[0]["pose_since_now"] == [0.1, 0.0, 0.0]

    def test_a_file_starts_at_the_folder_of_the_config(self, config: Path, plugins, monkeypatch) -> None:
        assert self.lines(config, plugins, monkeypatch, to="beliefs.jsonl") == []

        assert len((config.parent / "beliefs.jsonl").read_text().splitlines()) == 21


class TestCreate:
    def test_one_part_alone(self, plugins) -> None:
        localizer = trailmark.create("localizer", "stepper", plugins=plugins, camera="floor", step_m=0.3)

        localizer.start(trailmark.Session(name="stepper"))
        assert localizer.config.step_m == 0.3

    def test_a_wrong_key_is_named(self, plugins) -> None:
        with pytest.raises(ConfigError, match=r"localizer 'stepper': stpe_m: unknown key.*step_m"):
            trailmark.create("localizer", "stepper", plugins=plugins, stpe_m=0.3)

    def test_a_wrong_name_is_told_with_the_right_ones(self, plugins) -> None:
        with pytest.raises(UnknownPluginError, match="stepper"):
            trailmark.create("localizer", "steper", plugins=plugins)

    def test_what_cannot_be_constructed_is_named(self, plugins) -> None:
        with pytest.raises(PluginLoadError, match="OSError: no licence"):
            trailmark.create("localizer", "fragile", plugins=plugins)


@pytest.mark.parametrize("plugins", [["nobody"], "sim", [], 3])
def test_plugins_that_are_none_are_refused_by_name(plugins: object) -> None:
    with pytest.raises(ConfigError, match=r"plugins: takes what trailmark.plugins.load_plugins.* returns, not"):
        Pipeline({"sources": {"robot": {"plugin": "nobody"}}}, plugins=plugins)


@pytest.mark.parametrize(("key", "value"), [("latency_ms", 100), ("keep", "all")])
@pytest.mark.parametrize("is_async", [False, True])
def test_what_has_no_effect_without_async_is_said(plugins, key, value, is_async, caplog) -> None:
    stepper = {"plugin": "stepper", key: value, "async": is_async}

    with Pipeline({"sources": {"floor": {"plugin": "blank"}}, "localizers": {"vo": stepper}}, plugins=plugins):
        pass

    assert (f"localizers.vo.{key} has no effect without async: true" in caplog.text) != is_async
