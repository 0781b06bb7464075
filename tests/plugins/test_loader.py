from __future__ import annotations

import logging
from pathlib import Path

import pytest

from trailmark.errors import ConfigError, PluginLoadError
from trailmark.plugins import Plugins, Registry, Selection, discover_plugins, load_plugins

BROKEN = {
    "import": ("import not_there_at_all", "ModuleNotFoundError: No module named 'not_there_at_all'"),
    "syntax": ("def broken(:\n", "SyntaxError"),
    "exit": ("import sys\nsys.exit(3)", "SystemExit: 3"),
    "wrong_hook": (
        "from trailmark import hookimpl\n@hookimpl\ndef trailmark_registr(registry): pass",
        "unknown hook 'trailmark_registr'; did you mean 'trailmark_register'?",
    ),
    "wrong_argument": (
        "from trailmark import hookimpl\n@hookimpl\ndef trailmark_register(registry, more): pass",
        "PluginValidationError",
    ),
    "unmarked": ("def trailmark_register(registry): pass", "implements no hook: mark its functions"),
    "raises": (
        "from trailmark import hookimpl\n@hookimpl\ndef trailmark_register(registry):\n"
        "    registry.sink('half', 'a:B')\n    raise ValueError('in the middle')",
        "ValueError: in the middle",
    ),
    "bad_name": (
        "from trailmark import hookimpl\n@hookimpl\ndef trailmark_register(registry):\n"
        "    registry.sink('Not A Name', 'a:B')",
        "sink 'Not A Name': use lower-case letters",
    ),
    "bad_target": (
        "from trailmark import hookimpl\n@hookimpl\ndef trailmark_register(registry):\n    registry.sink('x', 'a.b')",
        "'a.b' is no import string; write 'package.module:Name'",
    ),
    "twice": (
        "from trailmark import hookimpl\n@hookimpl\ndef trailmark_register(registry):\n"
        "    registry.sink('x', 'a:B')\n    registry.sink('x', 'a:C')",
        "sink 'x' is registered twice by the same plugin",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_plugin_is_recorded_and_the_others_load(site, register, case, caplog):
    source, error = BROKEN[case]
    site.install("tm-broken", {"broken_one": source}, version="1.2")
    site.install("tm-aaa", {"good_before": register.format(name="before")})
    site.install("tm-zzz", {"good_after": register.format(name="after")})

    with caplog.at_level(logging.WARNING):
        plugins = site.discover()

    (record,) = plugins.failed
    assert (record.name, record.distribution, record.version) == ("broken_one", "tm-broken", "1.2")
    assert error in record.error
    assert "\n" not in record.error
    assert "Traceback" in record.traceback
    assert plugins.registry.names("localizer") == ("after", "before")
    assert plugins.registry.specs("sink") == ()
    (warning,) = caplog.messages
    assert "plugin 'broken_one' (tm-broken 1.2) did not load" in warning


def test_plugins_load_in_the_order_of_distribution_and_name(site, register):
    site.install("tm-b", {"b_two": register.format(name="x1"), "b_one": register.format(name="x2")})
    site.install("tm-a", {"z_last": register.format(name="x3")})

    records = site.discover().records

    assert [record.name for record in records] == ["z_last", "b_one", "b_two"]


def test_a_record_tells_hooks_specs_and_import_time(site, register):
    site.install("tm-one", {"plain_one": register.format(name="thing")})

    (record,) = site.discover().records

    assert record.status == "ok"
    assert record.hooks == ("trailmark_register",)
    assert [spec.name for spec in record.specs] == ["thing"]
    assert record.import_ms > 0
    assert record.specs[0].gives == {"motion"}


def test_a_broken_plugin_is_an_error_only_when_it_is_asked_for(site, register):
    site.install("tm-bad", {"needed_one": "import not_there_at_all"})
    site.install("tm-good", {"good_one": register.format(name="thing")})
    registry = site.discover().registry

    assert registry.find("localizer", "thing").name == "thing"
    with pytest.raises(PluginLoadError, match=r"needed_one.*tm-bad 0.1.*not_there_at_all.*plugins doctor"):
        registry.find("localizer", "needed_one")


def test_strict_loading_raises_for_the_first_broken_plugin(site):
    site.install("tm-bad", {"strict_one": "import not_there_at_all"})

    with pytest.raises(PluginLoadError, match="strict_one"):
        site.discover(Selection(is_strict=True))


def test_another_major_version_of_the_interfaces_is_refused(site, register):
    site.install("tm-old", {"old_one": "TRAILMARK_API = '0.9'\n" + register.format(name="old")})
    site.install("tm-new", {"new_one": "TRAILMARK_API = 1\n" + register.format(name="new")})

    plugins = site.discover()

    (record,) = plugins.failed
    assert record.needs_other_api
    assert "written for plugin API 0.9, this Trailmark has 1.0" in record.error
    assert plugins.registry.names("localizer") == ("new",)


def test_an_unknown_hook_is_accepted_when_it_is_marked_optional(site, register):
    optional = "\n@hookimpl(optionalhook=True)\ndef trailmark_of_tomorrow(x): pass\n"
    site.install("tm-ahead", {"ahead_one": register.format(name="thing") + optional})

    assert site.discover().failed == ()


def test_a_blocked_plugin_is_not_imported(site):
    site.install("tm-bad", {"blocked_one": "raise RuntimeError('imported')"})

    for name in ("blocked_one", "tm-bad", "tm-bad:blocked_one"):
        (record,) = site.discover(Selection(blocked=frozenset({name}))).records
        assert record.status == "blocked"


def test_the_allow_list_keeps_others_out_and_core_in(site, register):
    site.install("tm-a", {"allowed_one": register.format(name="a"), "left_out": "raise RuntimeError('imported')"})
    site.install("trailmark", {"core": register.format(name="c")})

    records = site.discover(Selection(allowed=frozenset({"allowed_one"}))).records
    alone = site.discover(Selection(allowed=frozenset(), blocked=frozenset({"core"}))).records

    assert {record.name: record.status for record in records} == {
        "allowed_one": "ok",
        "left_out": "disabled",
        "core": "ok",
    }
    assert [record.name for record in alone if record.status == "ok"] == ["core"]


def test_an_allow_list_that_names_nothing_installed_is_a_warning(site, caplog):
    site.discover(Selection(allowed=frozenset({"no_such_plugin"})))

    assert "TRAILMARK_PLUGINS names the plugin 'no_such_plugin', which is not installed" in caplog.text


def test_the_environment_and_the_options_make_a_selection(tmp_path):
    file = tmp_path / "mine.py"
    file.touch()
    environment = {"TRAILMARK_PLUGINS": "a, b,", "TRAILMARK_STRICT_PLUGINS": "1"}

    selection = Selection.read(["klt"], [file, str(file)], environment)

    assert selection == Selection(frozenset({"a", "b"}), frozenset({"klt"}), (file,), True)
    assert Selection.read(environment={"TRAILMARK_PLUGINS": ""}).allowed == frozenset()
    assert Selection.read(environment={"TRAILMARK_STRICT_PLUGINS": "0"}) == Selection()


def test_a_plugin_file_that_does_not_exist_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="no such file"):
        Selection.read(files=[tmp_path / "missing.py"])
    with pytest.raises(ConfigError, match=r"is a \.py file"):
        Selection.read(files=[tmp_path])


def test_a_one_file_plugin_brings_its_class_from_the_same_file(tmp_path, register, site):
    file = tmp_path / "my_localizer.py"
    file.write_text(register.format(name="mine"))

    plugins = discover_plugins(Selection(files=(file,)), [])

    spec = plugins.registry.find("localizer", "mine")
    assert spec.distribution == "my_localizer.py"
    assert spec.load().__name__ == "Thing"
    assert discover_plugins(Selection(files=(file,)), []).registry.find("localizer", "mine").load() is spec.load()


def test_two_files_of_one_name_collide_and_both_are_named(tmp_path, register, site):
    files = []
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
        files.append(tmp_path / folder / "mine.py")
        files[-1].write_text(register.format(name=folder))

    plugins = discover_plugins(Selection(files=tuple(files)), [])

    (record,) = plugins.failed
    assert str(files[0]) in record.error
    assert str(files[1]) in record.error
    assert plugins.registry.names("localizer") == ("first",)


def test_a_broken_file_leaves_no_module_behind(tmp_path, site):
    file = tmp_path / "half.py"
    file.write_text("raise ValueError('no')")

    assert discover_plugins(Selection(files=(file,)), []).failed[0].error == "ValueError: no"
    file.write_text("raise ValueError('again')")
    assert discover_plugins(Selection(files=(file,)), []).failed[0].error == "ValueError: again"


def lifecycle(site, register) -> Plugins:
    hooks = "\nstarted = []\n@hookimpl\ndef trailmark_run_started(run): {body}\n"
    site.install("tm-bad", {"bad_hook": register.format(name="a") + hooks.format(body="raise ValueError('no')")})
    site.install("tm-good", {"good_hook": register.format(name="b") + hooks.format(body="started.append(run)")})
    return site.discover()


def test_a_hook_that_raises_is_a_warning_and_the_others_are_called(site, register, caplog):
    plugins = lifecycle(site, register)

    plugins.call_isolated("trailmark_run_started", run="the run")

    import good_hook  # type: ignore[import-not-found]

    assert good_hook.started == ["the run"]
    assert "plugin 'bad_hook' (tm-bad 0.1) failed in trailmark_run_started: ValueError: no" in caplog.text


def test_a_run_may_leave_plugins_out(site, register):
    plugins = lifecycle(site, register)

    fewer = plugins.restricted(block=["bad_hook"])

    fewer.hook.trailmark_run_started(run="the run")  # would raise if the blocked plugin were called
    assert fewer.registry.names("localizer") == ("b",)
    assert [record.status for record in fewer.records] == ["blocked", "ok"]
    assert plugins.restricted(enable=["tm-bad"]).registry.names("localizer") == ("a",)
    assert plugins.registry.names("localizer") == ("a", "b")


def test_leaving_out_what_is_not_installed_is_refused_with_a_hint(site, register):
    plugins = lifecycle(site, register)

    with pytest.raises(ConfigError, match=r"no plugin named 'bad_hok' \(did you mean 'bad_hook'\?\)"):
        plugins.restricted(block=["bad_hok"])


def test_plugins_of_the_process_are_loaded_once():
    assert load_plugins() is load_plugins()
    with pytest.raises(ConfigError, match="no plugin named 'no_such_plugin'"):
        load_plugins(block=["no_such_plugin"])


def test_without_any_entry_point_the_remedy_is_named():
    registry = discover_plugins(Selection(), []).registry

    assert isinstance(registry, Registry)
    with pytest.raises(Exception, match=r"no plugins registered: run `pip install -e \.`"):
        registry.find("localizer", "ground_vo")


def test_one_unreadable_distribution_does_not_hide_the_others(site, register, monkeypatch):
    from importlib import metadata

    site.install("tm-good", {"readable_one": register.format(name="thing")})
    site.install("tm-rotten", {})
    rotten = site.folder / "tm_rotten-0.1.dist-info" / "entry_points.txt"
    rotten.write_bytes(b"[trailmark]\n\xff\xfe = nothing\n")
    monkeypatch.setattr(metadata, "distributions", lambda: metadata.Distribution.discover(path=[str(site.folder)]))

    def fail_at_once(**_: str) -> None:
        raise UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte")

    monkeypatch.setattr(metadata, "entry_points", fail_at_once)

    plugins = discover_plugins(Selection())

    assert plugins.registry.names("localizer") == ("thing",)


def test_core_registers_its_own_parts_through_the_same_door():
    registry = load_plugins().registry

    for kind, name in (("estimator", "dead_reckoning"), ("path_store", "sqlite"), ("sink", "jsonl")):
        assert registry.find(kind, name).entry_point == "core"


def test_a_plugin_file_may_be_given_as_text(tmp_path: Path) -> None:
    (tmp_path / "x.py").touch()

    assert Selection.read(files=[str(tmp_path / "x.py")]).files == ((tmp_path / "x.py").resolve(),)
