"""Kernels that two processes keep on disk at once: none takes the code of the other's types for its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import pytest

from trailmark.kernels import kernel

PROGRAM = """
import ast
import sys
import time
from pathlib import Path

from trailmark.kernels import kernel

# Both read the index; each writes it; the first to write it is the last to write its code.
STEPS = ["3 looks", "0.5 looks", "3 lists", "0.5 lists", "0.5 keeps", "3 keeps"]


@kernel
def twice(value):
    return value + value


def in_turn(step, act, *arguments):
    place = STEPS.index(step)
    until_s = time.monotonic() + 30.0
    while place and not Path(STEPS[place - 1]).exists():
        assert time.monotonic() < until_s, step
        time.sleep(0.005)
    act(*arguments)
    Path(step).touch()


def list_in_turn(index):
    in_turn(f"{told} looks", lambda: None)
    in_turn(f"{told} lists", lists, index)


told, *others = sys.argv[1:]
if not others:
    file = twice._cache._cache_file
    lists, keeps = file._save_index, file._save_data
    file._save_index = list_in_turn
    file._save_data = lambda *code: in_turn(f"{told} keeps", keeps, *code)
print(*(twice(ast.literal_eval(value)) for value in (told, *others)))
"""


def cache_file(function: Any) -> Any:
    """Return where a kernel is kept, as another process has it: it has not looked at what is there."""
    return kernel(function)._cache._cache_file


def test_the_index_never_names_the_code_of_other_types(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))

    def function(value: float) -> float:
        return value

    here, there, later = cache_file(function), cache_file(function), cache_file(function)
    monkeypatch.setattr(there, "_load_index", dict)  # it looked before the other wrote
    keep = here._save_data

    def keep_last(name: str, code: str) -> None:
        there.save("float", "code for floats")
        keep(name, code)

    monkeypatch.setattr(here, "_save_data", keep_last)
    here.save("integer", "code for integers")

    assert later.load("float") == "code for floats"
    assert later.load("integer") in (None, "code for integers")
    later.save("integer", "code for integers")
    assert [later.load(types) for types in ("float", "integer")] == ["code for floats", "code for integers"]


@pytest.mark.slow
@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_two_processes_that_keep_a_kernel_at_once_spoil_nothing(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(PROGRAM)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kept")}

    def start(*values: str) -> subprocess.Popen[str]:
        line = [sys.executable, "program.py", *values]
        return subprocess.Popen(
            line, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )

    both = [start("3"), start("0.5")]
    assert [one.communicate(timeout=60)[0] for one in both] == ["6\n", "1.0\n"]
    assert start("3", "0.5").communicate(timeout=60)[0] == "6 1.0\n"
