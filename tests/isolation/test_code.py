"""Which code an answer depends on: what its process had loaded, and of core what its parts need."""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path

import pytest

import trailmark
from trailmark.isolation.calls import ANSWER_FILE, call_in_cells
from trailmark.isolation.fingerprint import code_of, source_digest
from trailmark.isolation.loaded_code import is_as_loaded, loaded_code
from trailmark.plugins import load_plugins

ROOM = "trailmark.estimation"


@pytest.fixture
def toys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Path:
    """A package with modules that are loaded and one that is not; its name is the test's own."""
    folder = tmp_path / f"toys_{request.node.name}"
    folder.mkdir()
    for name in ("__init__", "plugin", "used", "unused"):
        (folder / f"{name}.py").write_text("def mark(path):\n    open(path, 'a').write('x')\n    return 1\n")
    (folder / "weights.npy").write_bytes(b"1 2 3")
    monkeypatch.syspath_prepend(tmp_path)
    import_module(f"{folder.name}.plugin")
    return folder


def test_an_answer_is_taken_until_code_changes_that_was_loaded(toys: Path, tmp_path: Path) -> None:
    mark, calls = import_module(f"{toys.name}.used").mark, [(str(tmp_path / "marks"),)]

    def times_called() -> int:
        call_in_cells(mark, calls, tmp_path / "calls")
        return len((tmp_path / "marks").read_text())

    assert [times_called(), times_called()] == [1, 1]
    (toys / "unused.py").write_text("# better words\n")
    assert times_called() == 1
    (toys / "used.py").write_text("# other code\n")
    assert times_called() == 2
    (toys / "weights.npy").write_bytes(b"1 2 4")
    assert times_called() == 3
    (toys / "weights.npy").unlink()
    assert times_called() == 4


def test_an_answer_whose_code_nobody_knows_is_not_taken(toys: Path, tmp_path: Path) -> None:
    mark, calls = import_module(f"{toys.name}.used").mark, [(str(tmp_path / "marks"),)]
    call_in_cells(mark, calls, tmp_path / "calls")
    (place,) = (tmp_path / "calls").iterdir()
    for text in ("", "[]", '{"toys": 1}', '{"nobody": {"a.py": ""}}'):
        (place / "code.json").write_text(text)
        call_in_cells(mark, calls, tmp_path / "calls")
    (place / "code.json").unlink()
    call_in_cells(mark, calls, tmp_path / "calls")

    assert len((tmp_path / "marks").read_text()) == 6
    assert (place / ANSWER_FILE).is_file()


def test_a_plugin_of_which_only_the_doors_are_open_has_no_say(toys: Path) -> None:
    assert loaded_code([toys.name]) == {}

    import_module(f"{toys.name}.used")

    assert set(loaded_code([toys.name])[toys.name]) == {"__init__.py", "plugin.py", "used.py", "weights.npy"}
    assert is_as_loaded(loaded_code([toys.name]))


def test_a_filter_counts_where_it_is_used() -> None:
    registry = load_plugins().registry
    (wheels,) = (spec for spec in registry.specs("localizer") if spec.name == "odometry")
    kalman, smoother = (
        next(spec for spec in registry.specs("estimator") if spec.name == name) for name in ("kalman", "smoother")
    )
    alone = code_of([wheels])

    assert set(alone) == {"trailmark", "trailmark_baselines"}
    assert set(code_of([wheels, kalman])) == {*alone, f"{ROOM}.kalman"}
    assert set(code_of([wheels, smoother])) == {*alone, f"{ROOM}.kalman", f"{ROOM}.smoother"}
    assert code_of([kalman])["trailmark"] == alone["trailmark"]
    assert len({source_digest(name) for name in ("trailmark", f"{ROOM}.kalman", f"{ROOM}.smoother")}) == 3


@pytest.mark.parametrize(("room", "users"), [("kalman", ("kalman", "smoother")), ("smoother", ("smoother",))])
def test_nobody_else_imports_a_room_that_counts_apart(room: str, users: tuple[str, ...]) -> None:
    """Else a result would depend on code that its address does not know."""
    root = Path(trailmark.__file__).parent
    for file in root.rglob("*.py"):
        if not any(root / "estimation" / user in file.parents for user in users):
            nodes = ast.walk(ast.parse(file.read_text(encoding="utf-8")))
            imported = [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
            assert not [name for name in imported if f"{name}.".startswith(f"{ROOM}.{room}.")], file
