"""What says of the project how to build, cite and change it is whole, and says the same everywhere."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from ruamel.yaml import YAML

import trailmark

REPOSITORY = Path(__file__).parents[1]
PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))


def members_of(group: str) -> set[str]:
    """Return the requirements of a dependency group and of those that it includes."""
    found: set[str] = set()
    for item in PROJECT["dependency-groups"][group]:
        found |= members_of(item["include-group"]) if isinstance(item, dict) else {item}
    return found


def test_the_group_dev_is_the_extra_dev() -> None:
    assert members_of("dev") == set(PROJECT["project"]["optional-dependencies"]["dev"])


def test_the_citation_is_of_this_version_and_licence() -> None:
    citation = YAML(typ="safe").load((REPOSITORY / "CITATION.cff").read_text(encoding="utf-8"))

    assert citation["version"] == trailmark.__version__
    assert citation["license"] == PROJECT["project"]["license"]


def test_the_changelog_has_what_is_new_above_a_dated_section_of_this_version() -> None:
    citation = YAML(typ="safe").load((REPOSITORY / "CITATION.cff").read_text(encoding="utf-8"))
    titles = re.findall(r"^## (.+)$", (REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)

    assert titles[0] == "Unreleased"
    assert titles[1] == f"{trailmark.__version__} - {citation['date-released']}"
    assert len(set(titles)) == len(titles)


def test_hosted_ci_calls_the_script_that_everybody_runs() -> None:
    workflow = YAML(typ="safe").load((REPOSITORY / ".github/workflows/ci.yml").read_text(encoding="utf-8"))

    commands = [step["run"] for job in workflow["jobs"].values() for step in job["steps"] if "run" in step]
    assert any(command.startswith(".ci/run") for command in commands)
    assert (REPOSITORY / ".ci/run").is_file()
    assert workflow["permissions"] == {"contents": "read"}


@pytest.mark.parametrize(
    "form", sorted((REPOSITORY / ".github/ISSUE_TEMPLATE").glob("*.yml")), ids=lambda path: path.stem
)
def test_forms_are_forms(form: Path) -> None:
    document = YAML(typ="safe").load(form.read_text(encoding="utf-8"))

    assert form.stem == "config" or {"name", "description", "body"} <= set(document)


def test_the_paper_cites_what_its_bibliography_has_and_nothing_else() -> None:
    text = (REPOSITORY / "paper/paper.md").read_text(encoding="utf-8")
    known = set(
        re.findall(r"^@\w+\{(\w+),", (REPOSITORY / "paper/paper.bib").read_text(encoding="utf-8"), re.MULTILINE)
    )

    assert set(re.findall(r"@(\w+)", text.partition("# Summary")[2])) == known
    for heading in ("Summary", "Statement of need", "State of the field", "Software design", "Research impact"):
        assert f"\n# {heading}\n" in text
