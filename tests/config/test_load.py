from __future__ import annotations

import math
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from trailmark.config import Document, LocalizerOptions, RunConfig, load_run_config, read_document
from trailmark.errors import ConfigError
from trailmark.frames import GroundPlane, Pinhole
from trailmark.geometry import Pose2

SHORT = """
sources: {floor: {plugin: image_folder, path: frames/, rate_hz: 70, calibration: {metres_per_pixel: 3.9e-4}}}
localizers: {floor: {plugin: ground_vo}}
"""


def test_a_short_config_is_filled_with_defaults(plugins, write, tmp_path):
    config = load_run_config(write(SHORT), plugins=plugins)

    settings = config.settings
    assert (settings.mode, settings.start, settings.control_hz, settings.pace, settings.seed) == (
        "track",
        "first",
        70,
        None,
        0,
    )
    assert config.sources["floor"].config.path == tmp_path / "frames"
    assert isinstance(config.sources["floor"].calibration, GroundPlane)
    floor = config.localizers["floor"]
    assert (floor.config.search_px, floor.options) == (8, LocalizerOptions())
    assert (config.estimator.spec.name, config.estimator.options.use) == ("dead_reckoning", None)
    assert (config.path_store, config.controller, config.sinks) == (None, None, ())
    assert (config.settings.stop_when.fix_age_m, config.settings.stop_when.motion_age_s) == (None, None)
    assert config.base_dir == tmp_path


def test_every_section_of_a_long_config_arrives(plugins, write, tmp_path):
    (tmp_path / "floor.calib.yaml").write_text("{fx: 500, fy: 500, cx: 320, cy: 240}")
    name = write("""
mode: replay
sources:
  front: {plugin: image_folder, path: frames, rate_hz: 30, calibration: floor.calib.yaml}
sensors:
  front: {mounting: {x: 0.05, yaw_deg: 180}, calibration: floor.calib.yaml}
localizers:
  map: {plugin: "tm-small:ground_map", camera: front, async: true, latency_ms: 200, on_error: disable}
  klt: klt
estimator: {plugin: kalman, use: [map]}
path_store: {spacing_m: 0.1, path: here.trail}
controller: {plugin: track, reverse: true}
sinks: [jsonl, {plugin: jsonl, to: file}]
start: [1, 2, 90]
control_hz: 20
stop_when: {fix_age_m: 1.0, motion_age_s: 0.3}
pace: step
seed: 7
""")

    config = load_run_config(name, plugins=plugins)

    assert isinstance(config.sources["front"].calibration, Pinhole)
    assert config.sensors["front"].mounting.yaw_deg == 180
    assert isinstance(config.sensors["front"].calibration, Pinhole)
    chosen = config.localizers["map"]
    options = chosen.options
    assert (options.is_async, options.latency_s, options.on_error) == (True, 0.2, "disable")
    assert chosen.config.camera == "front"
    assert list(config.localizers) == ["map", "klt"]
    assert config.estimator.options.use == ("map",)
    assert (config.path_store.options.spacing_m, config.path_store.config.path) == (0.1, tmp_path / "here.trail")
    assert config.controller.config.reverse
    assert [sink.name for sink in config.sinks] == ["jsonl", "jsonl_2"]
    assert config.settings.start_pose == Pose2(1, 2, math.pi / 2)
    assert (config.settings.pace, config.settings.seed, config.settings.control_hz) == ("step", 7, 20)
    assert config.settings.stop_when.motion_age_s == 0.3


def test_the_command_sets_the_mode_and_teaching_gets_a_store(plugins, write):
    name = write(SHORT)

    assert load_run_config(name, plugins=plugins).path_store is None
    taught = load_run_config(name, plugins=plugins, mode="teach")
    assert taught.settings.mode == "teach"
    assert (taught.path_store.spec.name, taught.path_store.options.spacing_m) == ("sqlite", 0.05)


def test_yaml_is_read_as_version_1_2(plugins, write):
    text = "localizers: {klt: {plugin: klt, gains: {a: 1e-3}}, vo: {plugin: ground_vo, method: no}}\n"
    text += "estimator: kalman\nsinks: [{plugin: jsonl, to: 2026-11-20}]\n"

    config = load_run_config(write(text), plugins=plugins)

    assert config.localizers["klt"].config.gains == {"a": 0.001}
    assert config.localizers["vo"].config.method == "no"
    assert config.sinks[0].config.to == "2026-11-20"


def test_toml_says_the_same_as_yaml(plugins, write):
    toml = "seed = 3\n[localizers.floor]\nplugin = 'ground_vo'\nsearch_px = 4\n[[sinks]]\nplugin = 'jsonl'\n"
    yaml = "seed: 3\nlocalizers: {floor: {plugin: ground_vo, search_px: 4}}\nsinks: [jsonl]\n"

    first = load_run_config(write(toml, "config.toml"), plugins=plugins)
    second = load_run_config(write(yaml), plugins=plugins)

    assert first.document == second.document


def test_places_are_found_from_keys(plugins, write):
    config = load_run_config(write(SHORT), plugins=plugins, overrides=["seed=3"])

    assert config.locate("localizers", "floor") == "config.yaml line 3: localizers.floor"
    assert config.locate("localizers", "floor", "camera") == "config.yaml line 3: localizers.floor.camera"
    assert config.locate("seed") == "--set: seed"
    assert config.locate("pace") == "config.yaml: pace"
    assert load_run_config({}, plugins=plugins).locate("seed") == "config: seed"


def test_paths_start_at_the_config_not_at_the_working_folder(plugins, write, tmp_path, monkeypatch):
    write(SHORT)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")

    config = load_run_config("../config.yaml", plugins=plugins)

    assert config.sources["floor"].config.path.resolve() == tmp_path / "frames"
    with pytest.raises(ConfigError, match="no such file or folder"):
        load_run_config(read_document("../config.yaml").data, plugins=plugins)


def test_a_mapping_is_taken_as_a_config_and_left_as_it_was(plugins, tmp_path):
    written = {"localizers": {"klt": "klt"}, "estimator": None}

    config = load_run_config(written, plugins=plugins, base_dir=tmp_path, overrides=["seed=2"])

    assert config.localizers["klt"].spec.name == "klt"
    assert config.base_dir == tmp_path
    assert written == {"localizers": {"klt": "klt"}, "estimator": None}


def test_a_document_may_be_changed_before_it_is_loaded(plugins, write):
    document = read_document(write("bench: {seeds: 3}\n" + SHORT.lstrip() + "x: 1\n"))
    data = {key: value for key, value in document.data.items() if key != "bench"}
    without = Document(data, document.name, document.base_dir, document.line_of)

    with pytest.raises(ConfigError, match=r"^config.yaml line 4: x: unknown key"):
        load_run_config(without, plugins=plugins)


def test_plugins_that_a_run_may_not_use_are_not_found(plugins, write):
    with pytest.raises(ConfigError, match=r"line 2: localizers.x.plugin: no localizer named 'klt'; available: twin"):
        load_run_config(write("plugins: {block: [small]}\nlocalizers: {x: klt}"), plugins=plugins)
    kept = load_run_config(write("plugins: {enable: [other]}\nlocalizers: {x: twin}"), plugins=plugins)
    assert kept.localizers["x"].spec.distribution == "tm-other"
    assert [record.status for record in kept.plugins.records] == ["ok", "disabled", "ok", "failed"]


def test_a_distribution_picks_one_of_two_parts_of_one_name(plugins, write):
    config = load_run_config(write("localizers: {x: 'tm-other:twin'}"), plugins=plugins)

    assert config.localizers["x"].spec.distribution == "tm-other"
    assert config.document["localizers"]["x"]["plugin"] == "tm-other:twin"


def test_a_requirement_that_is_met_is_no_problem(plugins, write):
    config = load_run_config(write(f"plugins: {{require: ['pluggy>={version('pluggy')}', numpy]}}"), plugins=plugins)

    assert config.document["plugins"]["require"] == [f"pluggy>={version('pluggy')}", "numpy"]


def test_two_motions_are_allowed_when_the_config_says_so(plugins, write):
    used = "localizers: {a: ground_vo, b: klt}\nestimator: {use: [a]}\n"
    apart = "localizers: {a: {plugin: klt, camera: x}, b: {plugin: klt, camera: y}}\nestimator: kalman\n"
    meant = "localizers: {a: {plugin: klt, camera: x}, b: {plugin: klt, camera: x}}\n"
    meant += "estimator: {plugin: kalman, use: [a, b]}\n"
    fixes = "localizers: {a: ground_vo, b: ground_map}\n"

    for text in (used, apart, meant, fixes):
        assert load_run_config(write(text), plugins=plugins).localizers


def test_calibrations_that_name_files_survive_a_move(plugins, write, tmp_path):
    import numpy as np

    np.save(tmp_path / "flat.npy", np.ones((2, 3), dtype=np.float32))
    text = "sources: {floor: {plugin: image_folder, path: frames, rate_hz: 70,"
    text += " calibration: {metres_per_pixel: 3.9e-4, flat_field: flat.npy}}}\n"
    text += "sensors: {floor: {calibration: {metres_per_pixel: 3.9e-4, flat_field: flat.npy}}}\n"

    config = load_run_config(write(text), plugins=plugins)
    again = load_run_config(config.document, plugins=plugins, base_dir=Path("/"))

    assert again.sources["floor"].calibration.flat_field.shape == (2, 3)
    assert again.sensors["floor"].calibration.flat_field.shape == (2, 3)


def test_a_calibration_file_that_is_wrong_is_named(plugins, write, tmp_path):
    (tmp_path / "bad.yaml").write_text("metres_per_pixl: 1")
    text = "sensors:\n  floor:\n    calibration: bad.yaml\n"

    with pytest.raises(
        ConfigError, match=r"config.yaml line 3: sensors.floor.calibration: .*bad.yaml: .*metres_per_pixl"
    ):
        load_run_config(write(text), plugins=plugins)


def positive(limit: float = 1e6) -> st.SearchStrategy[float]:
    return st.floats(1e-3, limit, allow_nan=False)


LOCALIZERS = st.one_of(
    st.sampled_from(["ground_map", "stereo", "any"]),
    st.fixed_dictionaries(
        {"plugin": st.sampled_from(["ground_map", "tm-small:ground_map"])},
        optional={
            "camera": st.just("floor"),
            "light": st.none() | st.just("lamp"),
            "search_px": st.integers(1, 64),
            "method": st.text(max_size=5),
            "async": st.booleans(),
            "latency_ms": st.none() | positive(),
            "on_error": st.sampled_from(["fail", "disable"]),
        },
    ),
)
NAMES = st.from_regex(r"[a-z][a-z0-9_]{0,5}", fullmatch=True).filter(lambda name: name != "fused")
CONFIGS: st.SearchStrategy[dict[str, Any]] = st.fixed_dictionaries(
    {"localizers": st.dictionaries(NAMES, LOCALIZERS, max_size=3)},
    optional={
        "mode": st.sampled_from(["track", "teach", "replay"]),
        "sources": st.dictionaries(
            NAMES,
            st.fixed_dictionaries(
                {"plugin": st.just("image_folder"), "path": st.just("."), "rate_hz": positive()},
                optional={
                    "mounting": st.fixed_dictionaries(
                        {}, optional={"x": st.floats(-9, 9), "yaw_deg": st.floats(-9, 9)}
                    ),
                    "calibration": st.just({"metres_per_pixel": 4e-4}),
                    "rename": st.just({"a": "b"}),
                    "start_s": st.none() | positive(),
                },
            ),
            max_size=2,
        ),
        "estimator": st.sampled_from(["kalman", {"plugin": "kalman", "use": []}]),
        "path_store": st.fixed_dictionaries({}, optional={"spacing_m": positive(9), "path": st.just("a/b.trail")}),
        "controller": st.sampled_from(["track", {"plugin": "track", "reverse": True}, None]),
        "sinks": st.lists(st.sampled_from(["jsonl", {"plugin": "jsonl", "to": "x: y"}]), max_size=2),
        "sensors": st.dictionaries(NAMES, st.sampled_from([{}, {"mounting": {"z": 1.5}}]), max_size=2),
        "start": st.sampled_from(["first", "last", "unknown"])
        | st.tuples(st.floats(-9, 9), st.floats(-9, 9), st.floats(-360, 360)).map(list),
        "control_hz": positive(),
        "stop_when": st.fixed_dictionaries(
            {}, optional={"fix_age_m": positive(), "motion_age_s": st.none() | positive()}
        ),
        "pace": st.sampled_from(["step", "realtime", None]),
        "seed": st.integers(0, 2**62),
    },
)


def told(config: RunConfig) -> dict[str, Any]:
    """All of a run that can be compared."""
    same = {name: getattr(config, name) for name in ("estimator", "path_store", "controller", "sinks")}
    same["settings"] = config.settings.model_dump(include={"mode", "start", "control_hz", "stop_when", "pace", "seed"})
    sources = {name: (entry.spec, entry.config) for name, entry in config.sources.items()}
    return same | {"sources": sources, "sensors": dict(config.sensors), "localizers": dict(config.localizers)}


@settings(max_examples=60, deadline=None)
@given(written=CONFIGS)
@example(written={"localizers": {"a": {"plugin": "ground_map", "method": "\x85"}}})
@example(written={"localizers": {"a": {"plugin": "ground_map", "method": "a\u2028b\u2029"}}})
def test_the_resolved_document_loads_again_as_the_same_run(written, plugins, tmp_path_factory):
    folder = tmp_path_factory.mktemp("resolved")

    config = load_run_config(written, plugins=plugins)
    (folder / "config.yaml").write_text(config.yaml())
    again = load_run_config(folder / "config.yaml", plugins=plugins)

    assert told(again) == told(config)
    assert again.document == config.document
    assert again.yaml() == config.yaml()
