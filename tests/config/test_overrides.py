from __future__ import annotations

import pytest

from trailmark.config import load_run_config
from trailmark.errors import ConfigError

TEXT = """
localizers:
  floor: {plugin: ground_vo, search_px: 5, camera: floor, async: true}
  map: ground_map
sinks: [jsonl]
"""


@pytest.fixture
def load(plugins, write):
    name = write(TEXT)
    return lambda *overrides: load_run_config(name, plugins=plugins, overrides=overrides)


def test_values_are_read_as_yaml(load):
    config = load("localizers.floor.search_px=9", "start=[1, 2, 0]", "stop_when.fix_age_m=1e-1", "pace=step")

    assert config.localizers["floor"].config.search_px == 9
    assert config.settings.start[:2] == (1, 2)
    assert config.settings.stop_when.fix_age_m == 0.1
    assert config.settings.pace == "step"


def test_items_of_lists_and_parts_given_by_name_have_keys(load):
    config = load("sinks.0.to=a=b", "localizers.map.search_px=3", "path_store.spacing_m=1")

    assert config.sinks[0].config.to == "a=b"
    assert config.localizers["map"].config.search_px == 3
    assert config.path_store.options.spacing_m == 1


def test_a_value_may_be_given_as_it_is(load):
    config = load(("sinks.0.to", "a: b"), ("localizers.map", {"plugin": "ground_map", "search_px": 2}))

    assert config.sinks[0].config.to == "a: b"
    assert config.localizers["map"].config.search_px == 2


def test_another_plugin_drops_the_keys_that_only_the_old_one_knew(load):
    config = load("localizers.floor.plugin=klt")

    floor = config.localizers["floor"]
    assert (floor.spec.name, floor.config.camera, floor.options.is_async) == ("klt", "floor", True)
    assert config.notices == ("localizers.floor: dropped search_px, which 'klt' does not know",)


def test_a_key_that_neither_plugin_knows_stays_wrong(load):
    with pytest.raises(ConfigError, match=r"--set: localizers.floor.serch_px: unknown key"):
        load("localizers.floor.serch_px=9", "localizers.floor.plugin=klt")


def test_another_plugin_of_the_same_keys_drops_nothing(load):
    config = load("localizers.floor.plugin=ground_map")

    assert config.localizers["floor"].config.search_px == 5
    assert config.notices == ()


def test_a_default_part_can_be_swapped(load):
    config = load("estimator.plugin=kalman", "estimator.use=[floor]")

    assert (config.estimator.spec.name, config.estimator.options.use) == ("kalman", ("floor",))


def test_null_takes_a_section_away(load):
    assert load("sinks=null").sinks == ()


WRONG = {
    "localizers.floor": r"--set localizers.floor: write KEY=VALUE",
    "=3": "--set =3: write KEY=VALUE",
    "a..b=3": "--set a..b=3: write KEY=VALUE",
    "seed=[1": r"--set seed=\[1: YAML syntax",
    "sinks.1.to=x": r"--set sinks.1.to=x: sinks is a list of 1; its items are 0 to 0, not 1",
    "sinks.first.to=x": r"sinks is a list of 1; its items are 0 to 0, not first",
    "localizers.floor.search_px.deep=1": r"localizers.floor.search_px is 5, which has no keys",
    "localizers.floor.plugin=kltt": r"--set: localizers.floor.plugin: no localizer named 'kltt' \(did",
    "sed=1": r"--set: sed: unknown key \(did you mean 'seed'\?\)",
    "seed=-1": r"--set: seed: must be greater than or equal to 0, not -1",
}


@pytest.mark.parametrize("override", WRONG)
def test_a_wrong_override_says_so(load, override):
    with pytest.raises(ConfigError, match=WRONG[override]):
        load(override)
