"""Which code an answer depends on: what its process had loaded, and of core what its parts need."""

from __future__ import annotations

import ast
import os
from importlib import import_module
from pathlib import Path

import pytest

import trailmark
from trailmark.isolation.calls import ANSWER_FILE, call_in_cells
from trailmark.isolation.fingerprint import code_of, source_digest
from trailmark.isolation.loaded_code import is_as_loaded, loaded_code
from trailmark.plugins import load_plugins

ROOM = "trailmark.estimation"
MARK = "def mark(path):\n    open(path, 'a').write('x')\n    return 1\n"


def write(path: Path, text: str) -> None:
    """Write a file as if long before this process began."""
    path.write_text(text, encoding="utf-8")
    os.utime(path, (1e9, 1e9 + sum(text.encode())))


@pytest.fixture
def toys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Path:
    """A package with modules that are loaded and one that is not; its name is the test's own."""
    folder = tmp_path / f"toys_{request.node.name}"
    folder.mkdir()
    for name in ("__init__", "plugin", "used", "unused"):
        write(folder / f"{name}.py", MARK)
    write(folder / "weights.npy", "1 2 3")
    monkeypatch.syspath_prepend(tmp_path)
    import_module(f"{folder.name}.plugin")
    return folder


def test_an_answer_is_taken_until_code_changes_that_was_loaded(toys: Path, tmp_path: Path) -> None:
    mark, calls = import_module(f"{toys.name}.used").mark, [(str(tmp_path / "marks"),)]

    def times_called() -> int:
        call_in_cells(mark, calls, tmp_path / "calls")
        return len((tmp_path / "marks").read_text())

    assert [times_called(), times_called()] == [1, 1]
    write(toys / "unused.py", "# better words")
    assert times_called() == 1
    write(toys / "used.py", "# other code")
    assert [times_called(), times_called()] == [2, 2]
    write(toys / "weights.npy", "1 2 4")
    assert times_called() == 3
    write(toys / "more.npy", "1")
    assert times_called() == 4
    (toys / "weights.npy").unlink()
    assert [times_called(), times_called()] == [5, 5]


def test_code_that_changes_under_a_process_is_not_what_it_had_loaded(toys: Path, tmp_path: Path) -> None:
    mark, calls = import_module(f"{toys.name}.used").mark, [(str(tmp_path / "marks"),)]
    (toys / "used.py").write_text("# saved while a call runs")

    for _ in range(2):
        call_in_cells(mark, calls, tmp_path / "calls")

    assert len((tmp_path / "marks").read_text()) == 2


@pytest.mark.parametrize("module", ["plugin", "__init__"])
def test_the_doors_of_the_function_s_own_package_count(toys: Path, tmp_path: Path, module: str) -> None:
    mark = import_module(toys.name if module == "__init__" else f"{toys.name}.plugin").mark
    for text in (MARK, "# other code"):
        write(toys / f"{module}.py", text)
        call_in_cells(mark, [(str(tmp_path / "marks"),)], tmp_path / "calls")

    assert len((tmp_path / "marks").read_text()) == 2


def test_what_others_wrote_is_done_again_with_them(toys: Path, tmp_path: Path) -> None:
    """A repeat reads the map that a teaching left in a folder, and needs no module of the teaching."""
    mark = import_module(f"{toys.name}.used").mark
    call_in_cells(mark, [(str(tmp_path / "taught"),)], tmp_path / "calls")
    (taught,) = (tmp_path / "calls").iterdir()
    call_in_cells(mark, [(str(tmp_path / "repeated"),)], tmp_path / "calls")
    (taught / "code.json").write_text(f'{{"{toys.name}": {{"teaching.py": "0123"}}}}')

    for name in ("taught", "repeated"):
        call_in_cells(mark, [(str(tmp_path / name),)], tmp_path / "calls")

    assert [len((tmp_path / name).read_text()) for name in ("taught", "repeated")] == [2, 2]


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
    assert loaded_code("posix", [toys.name]) == {}

    import_module(f"{toys.name}.used")
    code = loaded_code("posix", [toys.name])

    assert code is not None
    assert set(code[toys.name]) == {"__init__.py", "plugin.py", "used.py", "weights.npy"}
    assert is_as_loaded(code)
    assert loaded_code("nobody", [toys.name]) is None


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
    top = Path(trailmark.__file__).parents[2]
    inside = tuple(top / "core" / "trailmark" / "estimation" / user for user in users)
    for file in (*(top / "core").rglob("*.py"), *(top / "plugins").rglob("*.py")):
        if not any(folder in file.parents for folder in inside):
            assert not [name for name in imported_by(file) if f"{name}.".startswith(f"{ROOM}.{room}.")], file


def imported_by(file: Path) -> set[str]:
    """Return the names of modules, and of what is taken from them, that a file imports, if it speaks of estimation."""
    names: set[str] = set()
    text = file.read_text(encoding="utf-8")
    for node in ast.walk(ast.parse(text)) if "estimation" in text else ():
        if isinstance(node, ast.ImportFrom):
            names |= {node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return names
