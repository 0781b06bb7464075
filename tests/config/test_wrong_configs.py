"""Wrong configs: each gives one clear line that names file, line and the nearest right name."""

from __future__ import annotations

from importlib.metadata import version

import pytest

from trailmark.config import load_run_config
from trailmark.errors import ConfigError

SOURCES = "sources:\n  floor: {plugin: image_folder, path: frames, rate_hz: 70}\n"

WRONG = {
    "a typo in a key": (
        SOURCES + "localizers:\n  floor:\n    plugin: ground_vo\n    serch_px: 9\n",
        "config.yaml line 6: localizers.floor.serch_px: unknown key (did you mean 'search_px'?)",
    ),
    "a typo in an option of the host": (
        SOURCES + "localizers:\n  floor: {plugin: ground_vo, latency_m: 9}\n",
        "config.yaml line 4: localizers.floor.latency_m: unknown key (did you mean 'latency_ms'?)",
    ),
    "a typo in a section": (
        SOURCES + "contrl_hz: 30\n",
        "config.yaml line 3: contrl_hz: unknown key (did you mean 'control_hz'?)",
    ),
    "a key that resembles nothing": (
        SOURCES + "stop_when: {zzz: 30}\n",
        "config.yaml line 3: stop_when.zzz: unknown key; keys: fix_age_m, motion_age_s, stall_s",
    ),
    "a wrong type": (
        SOURCES + "localizers:\n  floor: {plugin: ground_vo, search_px: wide}\n",
        "config.yaml line 4: localizers.floor.search_px: must be a valid integer, not 'wide'",
    ),
    "a wrong type deep inside": (
        SOURCES + "localizers:\n  floor:\n    plugin: klt\n    gains:\n      x: 1e-3\n      y: no\n",
        "config.yaml line 8: localizers.floor.gains.y: must be a valid number, not 'no'",
    ),
    "a boolean for a number": (
        SOURCES + "localizers:\n  floor:\n    plugin: klt\n    gains:\n      x: true\n",
        "config.yaml line 7: localizers.floor.gains.x: must be a valid number, not true",
    ),
    "a boolean for a whole number": (
        SOURCES + "localizers:\n  floor: {plugin: ground_vo, search_px: false}\n",
        "config.yaml line 4: localizers.floor.search_px: must be a valid integer, not false",
    ),
    "a boolean for a number of the host": (
        SOURCES + "control_hz: true\n",
        "config.yaml line 3: control_hz: must be a valid number, not true",
    ),
    "an unknown plugin": (
        SOURCES + "localizers:\n  floor: {plugin: ground-vo}\n",
        "config.yaml line 4: localizers.floor.plugin: no localizer named 'ground-vo' (did you mean 'ground_vo'?); "
        "available: any, broken, ground_map, ground_vo, klt, stereo, twin, wrong_kind. "
        "Did not load: plugin 'spoilt' (tm-spoilt 0.3). Run 'trailmark plugins' to see what is installed",
    ),
    "a missing file": (
        "sources:\n  floor: {plugin: image_folder, path: frmes, rate_hz: 70}\n",
        "config.yaml line 2: sources.floor.path: no such file or folder: {tmp}/frmes (did you mean 'frames'?)",
    ),
    "a missing ground truth": (
        "sources:\n  floor:\n    plugin: image_folder\n    path: frames\n    rate_hz: 7\n    ground_truth: a/b/t.tum\n",
        "config.yaml line 6: sources.floor.ground_truth: no such file or folder: {tmp}/a/b/t.tum "
        "({tmp} is the last folder of it that exists)",
    ),
    "a folder for a file": (
        "sources:\n  floor: {plugin: image_folder, path: frames, rate_hz: 70, ground_truth: frames}\n",
        "config.yaml line 2: sources.floor.ground_truth: is a folder, not a file: {tmp}/frames",
    ),
    "a negative rate": (
        "sources:\n  floor:\n    plugin: image_folder\n    path: frames\n    rate_hz: -70\n",
        "config.yaml line 5: sources.floor.rate_hz: must be greater than 0, not -70",
    ),
    "a duplicate sensor": (
        SOURCES + "  floor: {plugin: image_folder, path: frames, rate_hz: 30}\n",
        "config.yaml line 3: duplicate key 'floor': it stands on line 2 already",
    ),
    "a duplicate sensor of a mapping in braces": (
        "sources: {floor: {plugin: sim}, floor: {plugin: sim}}\n",
        'config.yaml line 1, column 33: YAML syntax: while constructing a mapping, found duplicate key "floor"',
    ),
    "YAML syntax": (
        SOURCES + "localizers: {floor: {plugin: klt}\nseed: 1\n",
        "config.yaml line 4, column 1: YAML syntax: while parsing a flow mapping, "
        "expected ',' or '}', but got '<scalar>'",
    ),
    "a plugin that fails to import": (
        SOURCES + "localizers:\n  floor: broken\n",
        "config.yaml line 4: localizers.floor.plugin: localizer 'broken' of plugin 'small' (tm-small 1.0) "
        "cannot be imported: ModuleNotFoundError: No module named 'not_there_at_all'. "
        "Run 'trailmark plugins doctor --deep' for the traceback",
    ),
    "a plugin that did not load": (
        SOURCES + "localizers:\n  floor: {plugin: spoilt}\n",
        "config.yaml line 4: localizers.floor.plugin: localizer 'spoilt' is not available: plugin 'spoilt' "
        "(tm-spoilt 0.3) did not load: ImportError: no. Run 'trailmark plugins doctor' for the traceback",
    ),
    "a range violated": (
        SOURCES + "localizers:\n  floor: {plugin: ground_vo, search_px: 65}\n",
        "config.yaml line 4: localizers.floor.search_px: must be less than or equal to 64, not 65",
    ),
    "a class of another kind": (
        SOURCES + "localizers:\n  floor: wrong_kind\n",
        "config.yaml line 4: localizers.floor.plugin: {here}:Unmoved of plugin 'small' (tm-small 1.0) is no Localizer",
    ),
    "no plugin": (
        "sources:\n  floor: {path: frames}\n",
        "config.yaml line 2: sources.floor: missing key 'plugin'; sources: image_folder",
    ),
    "a missing key": (
        "sources:\n  floor: {plugin: image_folder, path: frames}\n",
        "config.yaml line 2: sources.floor: missing key 'rate_hz'",
    ),
    "a typo in a key that must be there": (
        "sources:\n  floor: {plugin: image_folder, path: frames, rate_hx: 70}\n",
        "config.yaml line 2: sources.floor.rate_hx: unknown key (did you mean 'rate_hz'?)",
    ),
    "a part that is a number": (
        "sources:\n  floor: 3\n",
        "config.yaml line 2: sources.floor: must be a mapping with the key 'plugin', or the name of a plugin",
    ),
    "a plugin that is no name": (
        "sources:\n  floor: {plugin: [a]}\n",
        "config.yaml line 2: sources.floor.plugin: must be the name of a plugin, not ['a']",
    ),
    "a section that is a list": (
        "sources: [image_folder]\n",
        "config.yaml line 1: sources: must be a mapping, not ['image_folder']",
    ),
    "neither of two types": (
        SOURCES + "sensors: {floor: {calibration: 4}}\n",
        "config.yaml line 3: sensors.floor.calibration: must be text or a mapping, not 4",
    ),
    "a fraction for a count": ("seed: 1.5\n", "config.yaml line 1: seed: must be a valid integer, not 1.5"),
    "a key that is a number": ("1: 2\n", "config.yaml line 1: 1: a key must be text"),
    "a typo in a model within a config": (
        SOURCES + "sensors:\n  floor:\n    mounting:\n      yaw_dg: 90\n",
        "config.yaml line 6: sensors.floor.mounting.yaw_dg: unknown key (did you mean 'yaw_deg'?)",
    ),
    "two distributions with one name": (
        "localizers:\n  a: twin\n",
        "config.yaml line 2: localizers.a.plugin: localizer 'twin' is offered by plugin 'small' (tm-small 1.0) and "
        "plugin 'other' (tm-other 2.0): write tm-other:twin or tm-small:twin",
    ),
    "a name that a file could not have": (
        SOURCES + "localizers:\n  Floor cam: klt\n",
        "config.yaml line 4: localizers.Floor cam: the name 'Floor cam' must be lower-case letters, digits and _, "
        "a letter first",
    ),
    "a reserved name": (
        SOURCES + "localizers:\n  fused: klt\n",
        "config.yaml line 4: localizers.fused: the name 'fused' is reserved: a run's files use it",
    ),
    "a start that is a word of its own": (
        "start: frist\n",
        "config.yaml line 1: start: must be first, last, unknown or [x m, y m, heading deg], not 'frist' "
        "(did you mean 'first'?)",
    ),
    "a start of two numbers": (
        "start: [1, 2]\n",
        "config.yaml line 1: start: must be first, last, unknown or [x m, y m, heading deg], not [1, 2]",
    ),
    "a localizer that is used and does not exist": (
        "localizers:\n  floor: klt\nestimator:\n  use:\n    - floor\n    - flor\n",
        "config.yaml line 6: estimator.use.1: no localizer is called 'flor' (did you mean 'floor'?)",
    ),
    "a calibration with a wrong key": (
        SOURCES + "sensors:\n  floor: {calibration: {metres_per_pixl: 1}}\n",
        "config.yaml line 4: sensors.floor.calibration: calibration has an unknown key 'metres_per_pixl'; "
        "did you mean 'metres_per_pixel'?",
    ),
    "a key that a controller does not have": (
        "controller: {plugin: stand, reverse: true}\n",
        "config.yaml line 1: controller.reverse: unknown key; keys: plugin",
    ),
    "a distribution that is required and missing": (
        "plugins:\n  require:\n    - trailmark-not-there>=0.1\n",
        "config.yaml line 3: plugins.require.0: trailmark-not-there is not installed: "
        "pip install 'trailmark-not-there>=0.1'",
    ),
    "a distribution that is too old": (
        "plugins: {require: ['pluggy>=999']}\n",
        "config.yaml line 1: plugins.require.0: pluggy {pluggy} is installed, >=999 is required: "
        "install such a version, if there is one, or change the requirement",
    ),
    "a requirement that is none": (
        "plugins: {require: ['>=1']}\n",
        "config.yaml line 1: plugins.require.0: '>=1' is no requirement (Expected package name at the start of "
        "dependency specifier); write for example 'trailmark-mrclam>=0.1'",
    ),
    "a plugin to block that is not installed": (
        "plugins: {block: [smal]}\n",
        "config.yaml line 1: plugins: no plugin named 'smal' (did you mean 'small'?); "
        "installed: core, other, small, spoilt",
    ),
    "two motions under dead reckoning": (
        "localizers:\n  a: ground_vo\n  b: klt\n",
        "config.yaml line 3: localizers.b: 'a' and 'b' both give motion, and dead_reckoning takes it from one: "
        "say which with estimator: {use: [a]}, or choose an estimator that weighs them",
    ),
    "two motions of one sensor": (
        "localizers:\n  a: {plugin: ground_vo, camera: floor}\n  b: {plugin: klt, camera: floor}\nestimator: kalman\n",
        "config.yaml line 3: localizers.b: 'a' and 'b' both give motion of the sensor 'floor', which would count "
        "twice: say which with estimator: {use: [a, ...]}",
    ),
    "a tag that would build an object": (
        "seed: !!python/object:os.system 1\n",
        "config.yaml line 1, column 7: YAML syntax: could not determine a constructor for the tag "
        "'tag:yaml.org,2002:python/object:os.system'",
    ),
    "an alias within its anchor": ("sources: &a [*a]\n", "config.yaml line 1: an alias stands within its own anchor"),
    "a character that is no text": (
        "seed: 1\nmode: \x01\n",
        "config.yaml line 2: YAML syntax: the character '\\x01' is not allowed",
    ),
    "an empty file": ("", "config.yaml: the file is empty"),
    "a list": ("- 1\n", "config.yaml: a config is a mapping (key: value), not a list"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_config_gives_one_clear_line(case, plugins, write, tmp_path):
    text, expected = WRONG[case]
    here = plugins.registry.find("localizer", "wrong_kind").target.partition(":")[0]

    with pytest.raises(ConfigError) as caught:
        load_run_config(write(text), plugins=plugins)

    for name, value in (("{tmp}", tmp_path), ("{pluggy}", version("pluggy")), ("{here}", here)):
        expected = expected.replace(name, str(value))
    assert str(caught.value) == expected


def test_everything_wrong_is_said_at_once_in_the_order_of_the_lines(plugins, write):
    text = "seed: -1\n" + SOURCES + "localizers:\n  a: {plugin: klt, x: 1}\n  b: kltt\nmode: tracking\n"

    with pytest.raises(ConfigError) as caught:
        load_run_config(write(text), plugins=plugins)

    lines = [line.split(":")[0] for line in str(caught.value).splitlines()]
    assert lines == ["config.yaml line 1", "config.yaml line 5", "config.yaml line 6", "config.yaml line 7"]


def test_a_missing_config_names_the_nearest_file(plugins, write):
    write("seed: 1", "confg.yaml")

    with pytest.raises(ConfigError, match=r"no config file 'config.yaml' \(did you mean 'confg.yaml'\?\)"):
        load_run_config("config.yaml", plugins=plugins)


def test_a_config_that_is_a_folder_or_no_text_is_refused(plugins, write, tmp_path):
    (tmp_path / "x.yaml").mkdir()
    (tmp_path / "y.yaml").write_bytes(b"\xff\xfe\x00")
    write("")

    with pytest.raises(ConfigError, match=r"x.yaml: Is a directory"):
        load_run_config("x.yaml", plugins=plugins)
    with pytest.raises(ConfigError, match=r"y.yaml: not UTF-8 text \(byte 0\)"):
        load_run_config("y.yaml", plugins=plugins)


TOML = {
    "syntax": ("seed = \n", "config.toml line 1, column 8: TOML syntax: Invalid value"),
    "a key of a table": (
        "[localizers.floor]\nplugin = 'klt'\nwindow = 3\n",
        "config.toml line 3: localizers.floor.window: unknown key (did you mean 'window_px'?)",
    ),
    "a key of an inline table": (
        "[localizers]\nfloor = {plugin = 'klt', window = 3}\n",
        "config.toml line 2: localizers.floor.window: unknown key (did you mean 'window_px'?)",
    ),
    "an item of a list of tables": (
        "[[sinks]]\nplugin = 'jsonl'\n[[sinks]]\nplugin = 'jsonl'\nt = 1\n",
        "config.toml line 5: sinks.1.t: unknown key (did you mean 'to'?)",
    ),
    "a dotted key": (
        "localizers.floor.plugin = 'kl'\n",
        "config.toml line 1: localizers.floor.plugin: no localizer named 'kl' (did you mean 'klt'?)",
    ),
    "a duplicate": ("seed = 1\nseed = 2\n", "config.toml line 2, column 9: TOML syntax: Cannot overwrite a value"),
    "an unfinished text": ("a = '''", "config.toml: TOML syntax: Expected"),
}


@pytest.mark.parametrize("case", TOML)
def test_a_wrong_toml_config_names_the_line_too(case, plugins, write):
    text, expected = TOML[case]

    with pytest.raises(ConfigError) as caught:
        load_run_config(write(text, "config.toml"), plugins=plugins)

    assert str(caught.value).startswith(expected)
