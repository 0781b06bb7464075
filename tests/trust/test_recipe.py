"""The recipe of `make trust`: it goes on where it was, and tells everything that is kept."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

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


@pytest.mark.parametrize(("results", "code"), [(PASSED, 0), (FAILED, 1)])
def test_a_test_that_was_run_and_failed_fails_the_recipe(
    tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch, results: str, code: int
) -> None:
    file = Path(__file__)
    monkeypatch.setattr(recipe, "_test_files", lambda: iter([file]))
    monkeypatch.setattr(recipe, "_test", lambda path, folder: recipe._results_of(path, folder).write_text(results))

    assert recipe.main(["tests", "--records", str(tmp_path)]) == code

    assert ("**Failed: tests/trust/test_recipe.py.**" in capsys.readouterr().out.splitlines()) == bool(code)


@pytest.mark.parametrize("what", ["readers", "commands", "parts"])
def test_findings_fail_the_recipe_and_the_page_says_so(tmp_path: Path, capsys, what: str) -> None:
    records = Records(tmp_path / f"{what}.jsonl")
    target = "parts" if what == "parts" else "config"
    records.add(CaseRecord(target, 1, "other", 0.5, 300.0, ("a waypoint is gone",), "abc"))
    call = [what, "--cases", "1", "--minutes", "0", "--records", str(tmp_path)]

    assert recipe.main(call) == 1
    assert "**Failed: 1 findings.**" in capsys.readouterr().out.splitlines()

    records.add(CaseRecord(target, 1, "refused", 0.5, 300.0, (), "abc"))  # mended
    assert recipe.main(call) == 0
    assert "**Failed" not in capsys.readouterr().out


def test_what_left_its_records_whole_and_yet_ended_badly_fails(
    kept: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recipe.subprocess, "run", lambda *_, **__: SimpleNamespace(returncode=1))

    assert recipe.main(["readers", "--cases", "1", "--records", str(kept)]) == 1

    assert "**Failed: tests.trust.fuzz ended with code 1.**" in capsys.readouterr().out


@pytest.mark.parametrize(("what", "cases"), [("readers", 20_000), ("commands", 20_000), ("parts", 500)])
def test_each_kind_has_a_number_of_cases_of_its_own(tmp_path: Path, capsys, what: str, cases: int) -> None:
    recipe.main([what, "--minutes", "0", "--records", str(tmp_path)])

    assert f"{what} --cases {cases}`" in capsys.readouterr().out


def test_a_piece_is_done_and_not_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.trust import fuzz

    monkeypatch.setattr(fuzz, "peak_mib", lambda: 0.0)  # that of this process is of all tests before this one
    records = Records(tmp_path / "readers.jsonl")
    records.add(fuzz.try_case("trajectory", 1, "abc"))

    assert Records(tmp_path / "readers.jsonl").has_passed("trajectory", 1)
    assert fuzz.page(Records(tmp_path / "readers.jsonl"), "x").count("| trajectory | 1 |") == 1


def test_a_reader_that_holds_too_much_memory_is_a_finding_and_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.trust import fuzz

    monkeypatch.setattr(fuzz, "peak_mib", lambda: fuzz.MEMORY_MIB + 1.0)

    assert fuzz.try_case("trajectory", 1, "abc").findings == (
        f"trajectory 1: the process held {fuzz.MEMORY_MIB + 1.0:.0f} MiB",
    )
