"""The recipe of `make trust`: it goes on where it was, and its pages tell everything that is kept."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.trust import recipe
from tests.trust.records import CaseRecord, Records

PASSED = (
    '<testsuites><testsuite errors="0" failures="0"><testcase classname="tests.stores.test_a"/>'
    "</testsuite></testsuites>"
)
FAILED = (
    '<testsuites><testsuite errors="0" failures="1"><testcase classname="tests.stores.test_b"><failure/></testcase>'
    "</testsuite></testsuites>"
)


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    """A folder of what was done: a case of each kind, and two files of tests, one of which failed."""
    for name, target in (("readers", "config"), ("commands", "config"), ("parts", "parts")):
        Records(tmp_path / f"{name}.jsonl").add(CaseRecord(target, 7, "refused", 0.5, 300.0, (), "abc"))
    (tmp_path / "tests-stores-test_rows.xml").write_text(PASSED)
    (tmp_path / "tests-stores-test_kill.xml").write_text(FAILED)
    return tmp_path


def test_without_time_nothing_is_begun_and_the_pages_tell_what_is_kept(kept: Path, tmp_path: Path, capsys) -> None:
    pages = tmp_path / "pages"
    pages.mkdir()

    code = recipe.main(["--cases", "40", "--minutes", "0", "--records", str(kept), "--pages", str(pages)])

    told = capsys.readouterr().out
    assert code == 1  # a test failed
    assert "1 readers, 1 commands, 1 parts, 2 files of tests" in told
    assert "tests/stores/test_kill.py" in told
    assert "tests/stores/test_rows.py" not in told
    hostile = (pages / "hostile-input.md").read_text()
    assert hostile.count("of code abc (1)") == 3
    assert [line for line in hostile.splitlines() if line.startswith("#")] == [
        *("# Hostile input", "## Readers", "## Whole commands", "## Parts that misbehave")
    ]
    assert "| stores.test_b | 0 | 1 | 0 |" in (pages / "trust.md").read_text()


def test_a_piece_is_done_and_not_done_again(tmp_path: Path) -> None:
    from tests.trust import fuzz

    records = Records(tmp_path / "readers.jsonl")
    records.add(fuzz.try_case("trajectory", 1, "abc"))

    assert Records(tmp_path / "readers.jsonl").has_passed("trajectory", 1)
    assert fuzz.page(Records(tmp_path / "readers.jsonl"), "x").count("| trajectory | 1 |") == 1
