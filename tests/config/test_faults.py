"""Faults in a config: keys of the default one, others by name, and what is wrong with them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

import trailmark.config
from trailmark.config import load_run_config
from trailmark.config.schema import run_config_schema
from trailmark.errors import ConfigError
from trailmark.plugins import Plugins, load_plugins

REAL = load_plugins()


def read(perturb: Any, plugins: Plugins = REAL, **more: Any) -> Any:
    source = {"plugin": "sim", "world": "ground_course", "perturb": perturb}
    return load_run_config({"sources": {"robot": source}, **more}, plugins=plugins)


def problems(perturb: Any, **more: Any) -> str:
    with pytest.raises(ConfigError) as raised:
        read(perturb, **more)
    return str(raised.value)


def order(perturb: Mapping[str, Any]) -> list[str]:
    return [fault.name for fault in read(perturb).sources["robot"].faults]


def test_nothing_is_no_fault() -> None:
    assert read(None).sources["robot"].faults == ()
    assert read({}).sources["robot"].faults == ()
    assert read({"sensors": ["floor"]}).sources["robot"].perturbed == ("floor",)


def test_the_keys_of_the_default_fault_stand_directly_under_perturb() -> None:
    (fault,) = read({"noise": 3.0, "dropped": 0.1}).sources["robot"].faults

    assert (fault.name, fault.config.noise, fault.config.dropped) == ("basic", 3.0, 0.1)
    assert fault.keys == ("sources", "robot", "perturb")


def test_faults_stand_in_the_order_of_the_config() -> None:
    assert order({"vignette": {}, "noise": 2.0, "cover": {}, "dropped": 0.1}) == ["vignette", "basic", "cover"]
    assert order({"cover": {}, "vignette": {}}) == ["cover", "vignette"]


def test_null_leaves_a_fault_out() -> None:
    assert order({"vignette": None, "cover": {}}) == ["cover"]


def test_the_order_is_kept_when_a_config_is_written_out() -> None:
    first = read({"vignette": {"fall": 0.3}, "noise": 2.0, "cover": {}})

    again = load_run_config(json.loads(json.dumps(first.document)), plugins=REAL)

    assert again.sources["robot"].faults == first.sources["robot"].faults
    assert again.document == first.document


def test_what_is_wrong_with_a_named_fault_is_told_at_its_keys() -> None:
    told = problems({"vignet": {}, "cover": 3, "lens_marks": {"shar": 0.1}, "mains": {"hz": 50}})

    assert "perturb.vignet: unknown key (did you mean 'vignette'?)" in told
    assert "perturb.cover: must be a mapping of its keys, {} for its defaults, not 3" in told
    assert "perturb.lens_marks.shar: unknown key (did you mean 'share'?)" in told
    assert "perturb.mains.hz: must be 100 or 120, not 50" in told


def test_a_config_that_is_written_out_gives_the_same_faults() -> None:
    first = read({"noise": 3.0, "occluders": {"n": 1}, "sensors": ["floor"]})

    again = load_run_config(json.loads(json.dumps(first.document)), plugins=REAL)

    assert again.document == first.document
    assert list(first.document["sources"]["robot"]["perturb"]) == [
        "sensors", "noise", "blur_px", "exposure", "flicker", "speckle", "range_noise_m", "occluders", "dropped",
        "dropped_in_a_row", "missing_s", "late_s", "wrong",
    ]  # fmt: skip
    assert again.sources["robot"].faults == first.sources["robot"].faults
    assert again.sources["robot"].perturbed == ("floor",)


def test_wrong_keys_and_values_are_told_with_the_nearest_name_and_the_line(tmp_path: Path) -> None:
    path = tmp_path / "run.yaml"
    path.write_text(
        "sources:\n"
        "  robot:\n"
        "    plugin: sim\n"
        "    world: ground_course\n"
        "    perturb:\n"
        "      nois: 10\n"
        "      dropped: 1.5\n"
        "      occluders: {siz: 0.2}\n"
        "      sensors: 5\n"
    )

    with pytest.raises(ConfigError) as raised:
        load_run_config(path, plugins=REAL)

    assert str(raised.value).splitlines() == [
        f"{path} line 6: sources.robot.perturb.nois: unknown key (did you mean 'noise'?)",
        f"{path} line 7: sources.robot.perturb.dropped: must be less than 1, not 1.5",
        f"{path} line 8: sources.robot.perturb.occluders.siz: unknown key (did you mean 'size'?)",
        f"{path} line 9: sources.robot.perturb.sensors: must be a list, not 5",
    ]


def test_what_is_no_mapping_is_told() -> None:
    assert "sources.robot.perturb: must be a mapping, not 5" in problems(5)


def test_the_default_fault_is_not_named() -> None:
    assert "perturb.basic: the keys of 'basic' stand directly under perturb" in problems({"basic": {"noise": 1.0}})


def test_without_the_plugin_its_keys_are_missed_aloud() -> None:
    told = problems({"noise": 1.0}, plugins=load_plugins().restricted(block=["faults"]))

    assert "perturb.noise: unknown key; keys and faults: sensors (no plugin in use has 'basic', whose keys" in told


def test_the_old_names_of_the_config_are_still_there() -> None:
    with pytest.warns(DeprecationWarning, match=r"trailmark.config.Perturbation is trailmark_faults.basic.BasicConfig"):
        assert trailmark.config.Perturbation(noise=2.0).noise == 2.0
    with pytest.raises(AttributeError, match="no attribute 'Perturbations'"):
        trailmark.config.Perturbations


def test_an_editor_knows_the_keys_and_the_faults() -> None:
    schema = run_config_schema(REAL)

    perturb = schema["$defs"]["perturb"]
    assert schema["$defs"]["source.sim"]["properties"]["perturb"]["anyOf"][0] == {"$ref": "#/$defs/perturb"}
    assert {"sensors", "noise", "wrong", "lens_marks"} <= set(perturb["properties"])
    assert perturb["properties"]["lens_marks"]["anyOf"][0] == {"$ref": "#/$defs/fault.lens_marks"}
    assert perturb["additionalProperties"] is False
    assert "plugin" not in schema["$defs"]["fault.basic"]["properties"]
