from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest

from trailmark.config.describe import describe_part
from trailmark.config.schema import run_config_schema
from trailmark.plugins import PluginRecord, Plugins, load_plugins


@pytest.fixture(scope="module")
def schema(plugins) -> dict[str, Any]:
    return run_config_schema(plugins)


def references(node: Any) -> Iterator[str]:
    if isinstance(node, dict):
        for key, value in node.items():
            if key == "$ref":
                yield value
            yield from references(value)
    elif isinstance(node, list):
        for value in node:
            yield from references(value)


def keys_allowed(schema: dict[str, Any], kind: str, plugin: str) -> set[str]:
    """Follow the if/then rules as a validator does: the keys of every rule whose condition holds."""
    found = [
        rule["then"]["$ref"].rpartition("/")[2]
        for rule in schema["$defs"][kind]["else"]["allOf"]
        if "required" in rule["if"] and re.search(rule["if"]["properties"]["plugin"]["pattern"], plugin)
    ]
    (name,) = found
    assert schema["$defs"][name]["additionalProperties"] is False
    return set(schema["$defs"][name]["properties"])


def test_the_schema_is_json_and_every_reference_resolves(schema):
    text = json.dumps(schema)

    assert json.loads(text) == schema
    for reference in references(schema):
        assert reference.removeprefix("#/$defs/") in schema["$defs"], reference


def test_a_part_takes_the_keys_of_its_plugin_and_of_the_host(schema):
    ground = {"plugin", "camera", "light", "search_px", "method", "async", "latency_ms", "delay_ms", "keep", "on_error"}
    ground |= {"correct"}

    assert keys_allowed(schema, "localizer", "ground_vo") == ground
    assert keys_allowed(schema, "localizer", "tm-small:ground_vo") == ground
    assert keys_allowed(schema, "controller", "stand") == {"plugin"}
    assert "window_px" in keys_allowed(schema, "localizer", "klt")


def test_a_section_without_a_plugin_means_its_default(schema):
    (rule,) = (rule for rule in schema["$defs"]["path_store"]["else"]["allOf"] if "not" in rule["if"])

    assert rule["then"] == {"$ref": "#/$defs/path_store.sqlite"}
    assert schema["$defs"]["path_store"]["else"]["required"] == []
    assert schema["$defs"]["localizer"]["else"]["required"] == ["plugin"]


def test_descriptions_bounds_and_roles_are_told(schema):
    ground = schema["$defs"]["localizer.ground_vo"]

    search = ground["properties"]["search_px"]
    assert (search["description"], search["exclusiveMinimum"], search["maximum"]) == ("Search range [px].", 0, 64)
    camera = ground["properties"]["camera"]["description"]
    assert camera == "The downward camera. (a sensor of kind image; left out: the only one)"
    assert "camera" not in ground["required"]
    assert ground["description"] == "Downward camera"
    assert schema["$defs"]["source.image_folder"]["required"] == ["path", "rate_hz"]
    assert schema["properties"]["control_hz"]["description"].endswith("[Hz].")


def test_models_within_a_config_do_not_clash_between_plugins(schema):
    assert "source.image_folder.Mounting" in schema["$defs"]


def test_a_config_that_cannot_be_imported_leaves_the_part_open(plugins):
    from trailmark.plugins import Spec

    spoilt = Spec("sink", "spoilt", "a:B", config="not_there_at_all:Config", summary="Spoilt", distribution="tm-spoilt")
    record = PluginRecord("spoilt", "tm-spoilt", "1", "spoilt", "ok", specs=(spoilt,))

    schema = run_config_schema(Plugins(plugins._manager, [record]))

    assert "not_there_at_all" in schema["$defs"]["sink.spoilt"]["description"]
    assert "additionalProperties" not in schema["$defs"]["sink.spoilt"]


def test_a_name_offered_twice_is_written_with_its_distribution(plugins):
    record = plugins.records[1]
    twin = PluginRecord(
        "twin",
        "tm-twin",
        "1",
        "twin",
        "ok",
        specs=(record.specs[0].__class__("controller", "stand", "a:B", distribution="tm-twin"),),
    )

    schema = run_config_schema(Plugins(plugins._manager, [record, twin]))

    choices = schema["$defs"]["controller"]["then"]["anyOf"][0]["enum"]
    assert choices == ["tm-small:stand", "tm-twin:stand", "track"]


def test_the_schema_of_all_that_is_installed_can_be_made():
    schema = run_config_schema(load_plugins())

    assert set(references(schema)) <= {f"#/$defs/{name}" for name in schema["$defs"]}


def test_the_keys_of_a_part_are_described_in_words(plugins):
    keys = {info.key: info for info in describe_part(plugins.registry.find("source", "image_folder"))}

    assert (keys["path"].type, keys["path"].is_required) == ("path", True)
    assert keys["rate_hz"].type == "number > 0"
    assert keys["rate_hz"].description == "Images a second [Hz]."
    assert keys["on_bad_frame"].type == "error | skip"
    assert (keys["on_bad_frame"].default, keys["on_bad_frame"].is_shared) == ("error", True)
    assert keys["calibration"].type == "text | mapping"
    assert keys["mounting.yaw_deg"].description == "Turn about z [deg]."
    assert "plugin" not in keys
    assert list(keys)[:2] == ["path", "rate_hz"]


def test_the_host_options_of_a_localizer_are_described_last(plugins):
    infos = describe_part(plugins.registry.find("localizer", "ground_vo"))

    keys = [info.key for info in infos]
    assert keys[keys.index("async") :][:6] == ["async", "latency_ms", "delay_ms", "keep", "on_error", "correct"]
    assert all(key.startswith("correct.") for key in keys[keys.index("correct") + 1 :])
    assert all(info.is_shared for info in infos[-3:])
