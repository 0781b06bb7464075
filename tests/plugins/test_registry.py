from __future__ import annotations

import pytest

from trailmark.errors import PluginError, PluginLoadError, UnknownPluginError
from trailmark.plugins import KINDS, Registry, Spec
from trailmark.plugins.registry import Owner


def registry_with(*specs: Spec) -> Registry:
    return Registry(specs=specs)


def klt(distribution: str, entry_point: str = "klt") -> Spec:
    return Spec("localizer", "klt", "a:B", distribution=distribution, version="1.0", entry_point=entry_point)


def test_every_kind_has_a_method_that_registers_it():
    registry = Registry(Owner("mine", "tm-mine", "2.0"))

    for kind in KINDS:
        config = {} if kind == "dataset" else {"config": "package.config:Config"}
        getattr(registry, kind)("thing", "package.module:Thing", **config, extra="bags")

    assert [spec.kind for spec in registry.specs()] == list(KINDS)
    spec = registry.find("metric", "thing")
    assert (spec.target, spec.config, spec.extra) == ("package.module:Thing", "package.config:Config", "bags")
    assert (spec.entry_point, spec.distribution, spec.version) == ("mine", "tm-mine", "2.0")


def test_a_class_may_be_given_instead_of_its_import_string():
    registry = Registry()

    registry.sink("ordinary", Registry)

    assert registry.find("sink", "ordinary").target == "trailmark.plugins.registry:Registry"
    assert registry.find("sink", "ordinary").load() is Registry


def test_a_misspelt_name_gets_the_nearest_right_one():
    registry = registry_with(klt("a"), Spec("localizer", "ground_vo", "a:B"), Spec("sink", "ground_vos", "a:B"))

    with pytest.raises(UnknownPluginError, match=r"no localizer named 'ground-vo' \(did you mean 'ground_vo'\?\)") as e:
        registry.find("localizer", "ground-vo")
    assert e.value.available == ("ground_vo", "klt")


def test_a_misspelt_kind_lists_the_kinds():
    with pytest.raises(UnknownPluginError, match="no kind of part is called 'localiser'; kinds: source, localizer"):
        Registry().find("localiser", "klt")


def test_two_distributions_with_one_name_are_both_named_and_one_can_be_picked():
    registry = registry_with(klt("trailmark"), klt("tm-klt"))

    with pytest.raises(PluginError, match=r"\(trailmark 1.0\) and .*\(tm-klt 1.0\): write tm-klt:klt or trailmark:klt"):
        registry.find("localizer", "klt")
    assert registry.find("localizer", "TM_klt:klt").distribution == "tm-klt"
    with pytest.raises(UnknownPluginError, match="no localizer named 'tm-other:klt'"):
        registry.find("localizer", "tm-other:klt")


def test_two_plugins_of_one_distribution_with_one_name_are_told_apart_by_blocking():
    registry = registry_with(klt("tm-klt", "one"), klt("tm-klt", "two"))

    with pytest.raises(PluginError, match=r"plugin 'one' .* and plugin 'two' .*: block one of them"):
        registry.find("localizer", "klt")


def test_estimates_that_do_not_exist_are_refused():
    with pytest.raises(ValueError, match=r"gives \['pose'\]; choose of \['fix', 'motion', 'path_offset'\]"):
        Registry().localizer("klt", "a:B", gives=["pose"])


def test_what_cannot_be_told_of_a_part_is_named_with_what_can():
    with pytest.raises(TypeError, match=r"sink 'sonar': nothing called sumary can be told; known: summary, reference"):
        Registry().sink("sonar", ":Sonar", sumary="Reads a ring of sonars")


def test_a_missing_extra_is_named_with_its_pip_line():
    spec = Spec("source", "rosbag", "not_there_at_all:Bag", extra="bags", distribution="trailmark", entry_point="data")

    with pytest.raises(PluginLoadError, match=r"not_there_at_all.*pip install 'trailmark\[bags\]'"):
        spec.load()


def test_a_target_without_its_class_is_a_load_error():
    spec = Spec("source", "x", "trailmark.errors:NoSuchName", distribution="tm-x", version="3", entry_point="e")

    with pytest.raises(PluginLoadError, match=r"source 'x' of plugin 'e' \(tm-x 3\).*NoSuchName.*plugins doctor"):
        spec.load()


def test_a_config_that_is_no_plugin_config_is_a_load_error():
    with pytest.raises(PluginLoadError, match=r"trailmark\.errors:ConfigError is no PluginConfig"):
        Spec("sink", "x", "a:B", config="trailmark.errors:ConfigError").load_config()


def test_a_part_without_a_config_has_no_keys():
    assert Spec("sink", "x", "a:B").load_config().model_fields == {}
