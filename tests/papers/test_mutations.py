"""The rules of the papers that are turned round: they are still there, and what a test says of one is noted."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

REPOSITORY = Path(__file__).parents[2]
#: So many rules are turned round at least.
_FEWEST = 60

RULE = "def larger(a, b):\n    return a if a > b else b\n"
TESTS = {
    "test_first.py": "from trailmark_room.rule import larger\n\ndef test_same():\n    assert larger(2, 2) == 2\n",
    "test_second.py": "from trailmark_room.rule import larger\n\ndef test_larger():\n    assert larger(3, 2) == 3\n",
}


@pytest.fixture(scope="module")
def mutations(load_script: Callable[[str], ModuleType]) -> ModuleType:
    """`benchmarks/mutations.py` as a module."""
    return load_script("benchmarks/mutations.py")


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A checkout with one room, one rule and two files of tests."""
    top = tmp_path / "top"
    package = top / "plugins" / "room" / "trailmark_room"
    for folder in (package, top / "core", top / "tests", top / "examples"):
        folder.mkdir(parents=True)
    (top / "pyproject.toml").write_text("")
    (package / "__init__.py").write_text("")
    (package / "rule.py").write_text(RULE)
    for name, text in TESTS.items():
        (top / "tests" / name).write_text(text)
    return top


def mutation(mutations: ModuleType, old: str, new: str):
    return mutations.Mutation("room", "rule.py", "the smaller", old, new, tuple(f"tests/{name}" for name in TESTS))


def test_the_rules_of_the_list_are_still_where_it_says(mutations: ModuleType) -> None:
    listed = mutations.mutations_of(mutations.LIST.read_text(encoding="utf-8"))

    assert len({one.name for one in listed}) == len(listed)
    assert len(listed) >= _FEWEST
    assert [one.name for one in listed if not mutations.is_there(one, REPOSITORY)] == []
    assert all((REPOSITORY / test).is_file() for one in listed for test in one.tests)
    assert [one.name for one in listed if not has_test(one)] == []


def has_test(one: Any) -> bool:
    """Return whether the test that is expected to notice is one of the mutation's files, where one is named."""
    file, _, name = one.test.partition("::")
    return any(f"def {name}(" in (REPOSITORY / test).read_text() for test in one.tests if test.endswith(file))


def test_the_test_that_kills_a_mutation_is_named_and_the_text_put_back(
    mutations: ModuleType, checkout: Path, tmp_path: Path
) -> None:
    workshop = mutations.Workshop(checkout, tmp_path / "copy", 60.0)

    killed = workshop.judge(mutation(mutations, "a > b", "a < b"))
    survived = workshop.judge(mutation(mutations, "a > b", "a >= b"))
    gone = workshop.judge(mutation(mutations, "a == b", "a != b"))

    assert (killed.verdict, killed.by) == ("killed", "tests/test_second.py::test_larger")
    assert (survived.verdict, gone.verdict) == ("survived", "gone")
    assert (tmp_path / "copy" / "plugins" / "room" / "trailmark_room" / "rule.py").read_text() == RULE


def test_a_folder_may_be_named_relative_to_where_one_stands(
    mutations: ModuleType, checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    survived = mutations.Workshop(checkout, Path("copy"), 60.0).judge(mutation(mutations, "a > b", "a >= b"))

    assert survived.verdict == "survived"  # the tests were those of the copy, and found it


def test_a_verdict_holds_until_its_file_or_a_test_of_it_changes(mutations: ModuleType, checkout: Path) -> None:
    one, by = mutation(mutations, "a > b", "a < b"), "tests/test_second.py::test_larger"
    killed, survived = (mutations.fingerprint(one, checkout, test) for test in (by, ""))

    (checkout / "tests" / "test_first.py").write_text("")
    assert mutations.fingerprint(one, checkout, by) == killed
    assert mutations.fingerprint(one, checkout, "") != survived
    (checkout / "tests" / "test_second.py").write_text("")
    assert mutations.fingerprint(one, checkout, by) != killed
    assert mutations.fingerprint(mutation(mutations, "a > b", "a <= b"), checkout, by) != killed


def test_the_table_counts_by_room_what_was_killed_and_what_nobody_judged(mutations: ModuleType) -> None:
    chosen = [mutation(mutations, "a > b", "a < b"), mutations.Mutation("other", "x.py", "y", "o", "n", ())]
    known = {chosen[0].name: mutations.Verdict("room", "rule.py", "the smaller", "killed", "tests/t.py::t", 1.0, "f")}

    lines = list(mutations.table_of(chosen, known))

    assert lines[2:5] == ["| room | 1 | 1 |", "| other | 1 | 0 |", "| all | 2 | 1 |"]
    assert lines[-2:] == ["| room/rule.py | the smaller | killed | t.py::t |", "| other/x.py | y | not judged |  |"]
