"""The recipe of `make trust`: it goes on where it was, and tells everything that is kept."""

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


@pytest.mark.parametrize("what", ["readers", "commands", "parts"])
def test_without_time_nothing_is_begun_and_what_is_kept_is_told(kept: Path, capsys, what: str) -> None:
    assert recipe.main([what, "--cases", "40", "--minutes", "0", "--records", str(kept)]) == 1  # 39 are left

    assert "of code abc (1)" in capsys.readouterr().out


def test_tests_that_were_not_run_and_those_that_failed_are_left_to_do(kept: Path, capsys) -> None:
    assert recipe.main(["tests", "--minutes", "0", "--records", str(kept)]) == 1

    told = capsys.readouterr()
    assert "| stores.test_b | 0 | 1 | 0 |" in told.out
    assert "tests/stores/test_kill.py" in told.err
    assert "tests/stores/test_rows.py" not in told.err


def test_a_piece_is_done_and_not_done_again(tmp_path: Path) -> None:
    from tests.trust import fuzz

    records = Records(tmp_path / "readers.jsonl")
    records.add(fuzz.try_case("trajectory", 1, "abc"))

    assert Records(tmp_path / "readers.jsonl").has_passed("trajectory", 1)
    assert fuzz.page(Records(tmp_path / "readers.jsonl"), "x").count("| trajectory | 1 |") == 1
