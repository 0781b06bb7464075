from __future__ import annotations

import pytest

from trailmark.config import load_run_config, refuse_duplicate_sensors, resolve_all_roles, resolve_roles
from trailmark.errors import ConfigError
from trailmark.frames import SensorInfo


def sensors(**kinds: str) -> dict[str, SensorInfo]:
    return {name: SensorInfo(name, kind) for name, kind in kinds.items()}


@pytest.fixture
def load(plugins, write):
    return lambda text: load_run_config(write(text), plugins=plugins)


def test_a_role_is_filled_with_the_only_sensor_that_fits(load):
    config = load("localizers: {a: ground_vo}")

    entry = resolve_roles(config.localizers["a"], sensors(wheels="odometry", floor="image", lamp="scalar"), config)

    assert entry.config.camera == "floor"
    assert entry.config.light is None  # optional: only when named
    assert config.localizers["a"].config.camera == ""


def test_a_sensor_that_another_role_names_is_not_taken_twice(load):
    config = load("localizers: {a: {plugin: stereo, left: one}}")

    entry = resolve_roles(config.localizers["a"], sensors(one="image", two="image"), config)

    assert (entry.config.left, entry.config.right) == ("one", "two")


def test_a_role_without_kinds_takes_any_sensor(load):
    config = load("localizers: {a: any}")

    assert resolve_roles(config.localizers["a"], sensors(radio="beacons"), config).config.sensor == "radio"


def test_the_document_of_a_resolved_run_names_every_sensor(load, plugins):
    config = load("localizers: {a: ground_vo, b: {plugin: ground_map, light: lamp}}")

    resolved = resolve_all_roles(config, sensors(floor="image", lamp="scalar"))

    assert resolved.localizers["b"].config.camera == "floor"
    assert resolved.document["localizers"]["a"]["camera"] == "floor"
    assert "camera" not in config.document["localizers"]["a"]
    again = load_run_config(resolved.document, plugins=plugins)
    assert {name: entry.config for name, entry in again.localizers.items()} == {
        name: entry.config for name, entry in resolved.localizers.items()
    }


WRONG = {
    "an unknown sensor": (
        "localizers:\n  a:\n    plugin: ground_vo\n    camera: flor\n",
        {"floor": "image"},
        "config.yaml line 4: localizers.a.camera: no sensor is called 'flor' (did you mean 'floor'?)",
    ),
    "a sensor of a wrong kind": (
        "localizers:\n  a: {plugin: klt, camera: wheels}\n",
        {"floor": "image", "wheels": "odometry"},
        "config.yaml line 2: localizers.a.camera: needs a sensor of kind image or rgbd, "
        "but 'wheels' is of kind odometry; fitting: floor",
    ),
    "a sensor of a wrong kind in an optional role": (
        "localizers:\n  a: {plugin: ground_vo, camera: floor, light: floor}\n",
        {"floor": "image"},
        "config.yaml line 2: localizers.a.light: needs a sensor of kind scalar, but 'floor' is of kind image; "
        "no sensor fits",
    ),
    "several sensors that fit": (
        "localizers:\n  a: ground_vo\n",
        {"floor": "image", "front": "image"},
        "config.yaml line 2: localizers.a: several sensors fit 'camera': floor, front; name one, as camera: floor",
    ),
    "no sensor that fits": (
        "localizers:\n  a: ground_vo\n",
        {"wheels": "odometry"},
        "config.yaml line 2: localizers.a: no sensor of kind image for 'camera'; free sensors: wheels (odometry)",
    ),
    "no sensor at all": (
        "localizers:\n  a: any\n",
        {},
        "config.yaml line 2: localizers.a: no sensor for 'sensor'; free sensors: none",
    ),
    "an override of a sensor that does not exist": (
        "sensors:\n  flor: {mounting: {x: 1}}\n",
        {"floor": "image"},
        "config.yaml line 2: sensors.flor: no sensor is called 'flor' (did you mean 'floor'?)",
    ),
    "motion of one sensor told twice": (
        "localizers:\n  a: ground_vo\n  b: klt\nestimator: kalman\n",
        {"floor": "image"},
        "config.yaml line 3: localizers.b: 'a' and 'b' both give motion of the sensor 'floor', which would count "
        "twice: say which with estimator: {use: [a, ...]}",
    ),
    "everything at once": (
        "localizers:\n  a: {plugin: klt, camera: x}\n  b: {plugin: ground_map, camera: y}\n",
        {"floor": "image"},
        "config.yaml line 2: localizers.a.camera: no sensor is called 'x'; sensors: floor\n"
        "config.yaml line 3: localizers.b.camera: no sensor is called 'y'; sensors: floor",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_role_that_cannot_be_filled_gives_one_clear_line(load, case):
    text, kinds, expected = WRONG[case]
    config = load(text)

    with pytest.raises(ConfigError) as caught:
        resolve_all_roles(config, sensors(**kinds))

    assert str(caught.value) == expected


def test_two_sources_with_a_sensor_of_one_name_are_refused(load):
    text = (
        "sources:\n  a: {plugin: image_folder, path: ., rate_hz: 1}\n  b: {plugin: image_folder, path: ., rate_hz: 1}\n"
    )
    config = load(text)

    refuse_duplicate_sensors(config, {"a": ["cam"], "b": ["scan"]})
    with pytest.raises(ConfigError) as caught:
        refuse_duplicate_sensors(config, {"a": ["cam", "scan"], "b": ["scan"]})

    assert str(caught.value) == (
        "config.yaml line 3: sources.b: duplicate sensor 'scan': the source 'a' has one of that name; "
        "write rename: {scan: b_scan}"
    )
