"""``trailmark plugins`` and ``trailmark schema``, run as a user runs them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

GOOD = """
from pydantic import Field
from trailmark import hookimpl
from trailmark.config import PluginConfig

@hookimpl
def trailmark_register(registry):
    registry.localizer("thing", ":Thing", config=":ThingConfig", summary="A thing", reference="Doe 2020", extra="more")

class ThingConfig(PluginConfig):
    size_px: int = Field(default=3, gt=0)
    '''Size [px].'''
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for the import path with a good plugin and a broken one."""
    folder = tmp_path_factory.mktemp("site")
    for distribution, module, source in (
        ("tm-good", "good_cli", GOOD),
        ("tm-bad", "bad_cli", "import not_there_at_all"),
    ):
        info = folder / f"{distribution.replace('-', '_')}-0.1.dist-info"
        info.mkdir()
        requires = 'Requires-Dist: not-there-at-all; extra == "more"\n'
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 0.1\n{requires}\n")
        (info / "entry_points.txt").write_text(f"[trailmark]\n{module} = {module}\n")
        (folder / f"{module}.py").write_text(source)
    return folder


def trailmark(site: Path, *arguments: str, code: int = 0, **environment: str) -> subprocess.CompletedProcess[str]:
    program = "from trailmark.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": str(site), "TRAILMARK_PLUGINS": "good_cli,bad_cli"} | environment,
    )
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    return done


def test_listing_names_the_parts_and_what_is_broken(site):
    done = trailmark(site, "plugins")

    assert "thing" in done.stdout
    assert "A thing" in done.stdout
    assert "dead_reckoning" in done.stdout
    assert (
        "broken: plugin 'bad_cli' (tm-bad 0.1): ModuleNotFoundError: No module named 'not_there_at_all'" in done.stdout
    )
    assert done.stderr == ""  # said once


def test_listing_as_json_has_a_record_for_every_plugin(site):
    records = {record["name"]: record for record in json.loads(trailmark(site, "plugins", "--json").stdout)}

    assert records["bad_cli"]["status"] == "failed"
    good = records["good_cli"]
    assert (good["distribution"], good["version"], good["status"]) == ("tm-good", "0.1", "ok")
    assert good["hooks"] == ["trailmark_register"]
    assert good["parts"][0]["name"] == "thing"
    assert good["import_ms"] > 0
    assert json.loads(trailmark(site, "plugins", "list", "--json").stdout)


def test_blocked_plugins_are_listed_as_such(site):
    done = trailmark(site, "--plugin", "no:bad_cli", "plugins")

    assert "blocked: plugin 'bad_cli' (tm-bad 0.1)" in done.stdout
    assert done.stderr == ""


def test_showing_a_part_tells_its_keys(site):
    done = trailmark(site, "plugins", "show", "thing")

    assert "localizer thing  A thing" in done.stdout
    assert "follows Doe 2020" in done.stdout
    assert "pip install 'tm-good[more]'" in done.stdout
    (row,) = (line.split() for line in done.stdout.splitlines() if line.startswith("size_px"))
    assert row == ["size_px", "integer", ">", "0", "3", "Size", "[px]."]


def test_showing_a_part_as_json_tells_the_same(site):
    (part,) = json.loads(trailmark(site, "plugins", "show", "thing", "--json").stdout)

    assert part["reference"] == "Doe 2020"
    assert part["keys"][0] == {
        "key": "size_px",
        "type": "integer > 0",
        "is_required": False,
        "default": 3,
        "description": "Size [px].",
        "is_shared": False,
    }


def test_showing_what_does_not_exist_names_the_nearest(site):
    done = trailmark(site, "plugins", "show", "thng", code=2)

    assert "no part or plugin is called 'thng' (did you mean 'thing'?)" in done.stderr


def test_showing_what_is_not_installed_names_what_is_about_it(site):
    done = trailmark(site, "plugins", "show", "my_thing_mark", code=2)

    assert "no part or plugin is called 'my_thing_mark'; about that: thing" in done.stderr
    assert "'trailmark plugins' lists all" in done.stderr


def test_the_doctor_shows_tracebacks_extras_and_remedies(site):
    done = trailmark(site, "plugins", "doctor")

    assert "error: plugin 'bad_cli' (tm-bad 0.1)" in done.stdout
    assert "| Traceback (most recent call last):" in done.stdout
    assert "import not_there_at_all" in done.stdout
    assert "-> pip install 'tm-good[more]'" in done.stdout
    assert "2 of" in done.stdout.splitlines()[-1]
    assert done.stdout.splitlines()[-1].endswith("1 error, 1 warning")


def test_the_doctor_speaks_json(site):
    findings = json.loads(trailmark(site, "plugins", "doctor", "--json").stdout)

    assert {finding["topic"] for finding in findings} == {"broken", "extra"}


def test_strict_loading_ends_the_program(site):
    done = trailmark(site, "plugins", code=2, TRAILMARK_STRICT_PLUGINS="1")

    assert "plugin 'bad_cli' (tm-bad 0.1) did not load" in done.stderr


def test_the_schema_is_printed_with_what_is_installed(site):
    schema = json.loads(trailmark(site, "schema").stdout)

    size = schema["$defs"]["localizer.thing"]["properties"]["size_px"]
    assert (size["default"], size["description"]) == (3, "Size [px].")


def test_help_tells_how_editors_use_the_schema(site):
    assert "yaml-language-server" in trailmark(site, "schema", "--help").stdout
