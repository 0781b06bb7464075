from __future__ import annotations

import sys

import pytest

from trailmark.plugins import Selection, discover_plugins
from trailmark.plugins.doctor import examine, missing_requirements

EXTRA = """
from trailmark import hookimpl

@hookimpl
def trailmark_register(registry):
    registry.source("bag", "bag_source:Bag", extra="bags", summary="A bag")
"""


def test_a_healthy_installation_has_no_findings(site, register):
    site.install("tm-good", {"healthy_one": register.format(name="thing")})

    assert examine(site.discover()) == []
    assert examine(site.discover(), deep=True) == []


def test_a_broken_plugin_is_found_with_its_traceback_and_a_remedy(site):
    site.install("tm-bad", {"ill_one": "import not_there_at_all"})

    (finding,) = examine(site.discover())

    assert (finding.severity, finding.topic) == ("error", "broken")
    assert finding.subject == "plugin 'ill_one' (tm-bad 0.1)"
    assert "import not_there_at_all" in finding.traceback
    assert "--plugin no:ill_one" in finding.remedy


def test_another_api_is_a_topic_of_its_own(site):
    site.install("tm-old", {"aged_one": "TRAILMARK_API = '0'"})

    (finding,) = examine(site.discover())

    assert finding.topic == "api"
    assert "pip install --upgrade tm-old" in finding.remedy


def test_a_missing_extra_is_found_from_the_metadata_with_its_pip_line(site):
    site.install(
        "tm-bags",
        {"bags_one": EXTRA},
        requires=("pluggy", "not-there-at-all>=1; extra == 'bags'", "numpy; extra == 'x'"),
    )

    (finding,) = examine(site.discover())
    (deep,) = examine(site.discover(), deep=True)  # the extra explains the import error: said once

    assert (finding.severity, finding.topic, finding.subject) == ("warning", "extra", "source bag")
    assert "needs not-there-at-all" in finding.message
    assert finding.remedy == "pip install 'tm-bags[bags]'"
    assert deep == finding


def test_an_extra_that_is_installed_is_no_finding(site):
    site.install("tm-bags", {"bags_two": EXTRA}, requires=("pluggy; extra == 'bags'",))

    assert examine(site.discover()) == []
    assert missing_requirements("tm-bags", "bags") == []
    assert missing_requirements("not-installed-at-all", "bags") == []


def test_a_name_offered_twice_is_a_warning_that_says_how_to_choose(site, register):
    site.install("tm-one", {"first_offer": register.format(name="klt")})
    site.install("tm-two", {"second_offer": register.format(name="klt")})

    (finding,) = examine(site.discover())

    assert (finding.severity, finding.topic, finding.subject) == ("warning", "duplicate", "localizer klt")
    assert "tm-one 0.1" in finding.message
    assert "tm-two 0.1" in finding.message
    assert finding.remedy == "write plugin: tm-one:klt or tm-two:klt"


def test_only_a_deep_examination_imports_the_classes(site, register):
    source = register.format(name="thing").replace(":Thing", "rotten_target:Thing")
    site.install("tm-deep", {"deep_one": source})
    (site.folder / "rotten_target.py").write_text("raise RuntimeError('in the depths')")

    plugins = site.discover()

    assert examine(plugins) == []
    assert "rotten_target" not in sys.modules
    (finding,) = examine(plugins, deep=True)
    assert (finding.topic, finding.subject) == ("target", "localizer thing")
    assert "RuntimeError: in the depths" in finding.traceback


def test_no_plugin_at_all_is_one_finding():
    (finding,) = examine(discover_plugins(Selection(), []))

    assert (finding.topic, finding.message, finding.remedy) == (
        "none",
        "no plugins registered",
        "run `pip install -e .`",
    )


@pytest.mark.parametrize("name", ["bags", "dev"])
def test_our_own_extras_can_be_examined(name):
    assert isinstance(missing_requirements("trailmark", name), list)
