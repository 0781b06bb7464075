"""Compiling kernels: what the decorators promise, also where nothing can be kept."""

from __future__ import annotations

import doctest
import gc
import math
import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core import event

from trailmark import kernels
from trailmark.kernels import float_kernel, inlined_kernel, inner_kernel, kernel

SQUARES = """
import logging, sys
import numpy as np
from trailmark.kernels import kernel

logging.basicConfig(level=logging.INFO, stream=sys.stdout, format="%(message)s")


@kernel
def sum_of_squares(values):
    total = 0.0
    for value in values:
        total += value * value
    return total


print(sum_of_squares(np.arange(4.0)))
"""


@kernel
def ratio(above: float, below: float) -> float:
    return above / below


@kernel(error_model="numpy")
def unchecked_ratio(above: float, below: float) -> float:
    return above / below


@float_kernel
def largest_of_sum(values: np.ndarray) -> float:
    total, largest = 0.0, -math.inf
    for value in values:
        total += value
        if not math.isnan(value) and value > largest:
            largest = value
    return total if math.isinf(total) else largest


@inlined_kernel
def doubled(value: float) -> float:
    return 2.0 * value


@kernel
def doubled_ratio(above: float, below: float) -> float:
    return doubled(above) / below


@kernel(error_model="numpy")
def unchecked_doubled_ratio(above: float, below: float) -> float:
    return doubled(above) / below


@inner_kernel
def halved(value: float) -> float:
    return value / 2.0


@kernel
def quartered(value: float) -> float:
    return halved(halved(value))


def test_an_inner_kernel_works_in_kernels_and_refuses_python():
    for _ in ("before it is compiled", "after"):
        if not numba.config.DISABLE_JIT:
            with pytest.raises(TypeError, match="halved has no entry for Python"):
                halved(1.0)
        assert quartered(8.0) == 2.0


INNER = """
import sys
from trailmark.kernels import inner_kernel, kernel


@inner_kernel
def halved(value):
    return value / 2.0


@kernel
def quartered(value):
    return halved(halved(value))


@kernel
def halved_again(value):
    return halved(value)


print({"quarter": quartered, "half": halved_again}[sys.argv[1]](8.0))
"""


def test_an_inner_kernel_is_kept_for_the_kernels_of_another_process(tmp_path: Path) -> None:
    program = tmp_path / "inner.py"
    program.write_text(INNER)
    surroundings = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kept")}

    said = [
        subprocess.run(
            [sys.executable, program, which], env=surroundings, capture_output=True, text=True, check=True
        ).stdout
        for which in ("quarter", "half", "half")
    ]

    assert said == ["2.0\n", "4.0\n", "4.0\n"]


def test_a_division_by_zero_raises_unless_the_kernel_says_otherwise():
    for checked in (ratio, doubled_ratio):
        with pytest.raises(ZeroDivisionError):
            checked(1.0, 0.0)

    assert unchecked_ratio(1.0, 0.0) == unchecked_doubled_ratio(1.0, 0.0) == math.inf
    assert math.isnan(unchecked_ratio(0.0, 0.0))


def test_infinities_and_nan_keep_their_meaning_where_sums_may_be_reordered():
    assert largest_of_sum(np.array([1.0, math.inf])) == math.inf
    assert largest_of_sum(np.array([1.0, math.nan, 3.0])) == 3.0


def test_the_example_of_the_documentation_holds():
    results = doctest.testmod(kernels)

    assert (results.failed, results.attempted) == (0, 3)


def sum_in_another_process(module: Path, home: Path) -> tuple[str, str]:
    """Return what a module printed, log first, in a process that may write to `home` and beside the module alone."""
    homes = dict.fromkeys(("HOME", "USERPROFILE", "LOCALAPPDATA", "XDG_CACHE_HOME"), str(home))
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"} | homes
    done = subprocess.run([sys.executable, "-B", module], env=environment, capture_output=True, text=True, check=True)
    *log, total = done.stdout.splitlines()
    return "\n".join(log), total


def test_a_kernel_is_kept_beside_its_file(tmp_path):
    module = tmp_path / "squares.py"
    module.write_text(SQUARES)

    log, total = sum_in_another_process(module, tmp_path)

    assert (log, total) == ("", "14.0")
    assert list((tmp_path / "__pycache__").glob("squares.sum_of_squares*.nbi"))


def test_a_kernel_runs_where_no_folder_can_be_written(tmp_path):
    module, nowhere = tmp_path / "squares.py", tmp_path / "file"
    module.write_text(SQUARES)
    for no_folder in (nowhere, tmp_path / "__pycache__"):  # holds for root too, unlike permissions
        no_folder.write_text("")

    log, total = sum_in_another_process(module, nowhere)

    assert "kernel sum_of_squares cannot be cached" in log
    assert total == "14.0"
    assert not list(tmp_path.rglob("*.nb*"))


RECORD = """
from typing import NamedTuple

import numpy as np


class {name}(NamedTuple):
    values: np.ndarray
"""

TOTAL = """
import numpy as np
from record import {name}
from trailmark.kernels import kernel


@kernel
def total(record):
    return record.values.sum()


print(total({name}(np.arange(4.0))))
"""


def test_a_record_may_be_renamed_after_its_kernel_was_kept(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    printed = []

    for name in ("Readings", "Levels"):
        (tmp_path / "record.py").write_text(RECORD.format(name=name))
        (tmp_path / "total.py").write_text(TOTAL.format(name=name))
        done = subprocess.run(
            [sys.executable, "total.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        printed.append(done.stdout.strip() or done.stderr)

    assert printed == ["6.0", "6.0"]


VARIANTS = """
import sys
import numpy as np
from trailmark.kernels import kernel


def repeated(n):
    @kernel
    def repeat(value):
        out = np.empty(n, np.int64)
        for i in range(n):
            out[i] = value * n
        return out

    return repeat


print(*(repeated(int(n))(10) for n in sys.argv[1:]))
"""


def test_variants_that_several_processes_compiled_are_told_apart(tmp_path: Path) -> None:
    program = tmp_path / "variants.py"
    program.write_text(VARIANTS)
    surroundings = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kept")}

    for order in (["2"], ["2", "3"], ["4", "3"]):  # in the last one a new kernel has the count of a kept one
        line = [sys.executable, str(program), *order]
        said = subprocess.run(line, env=surroundings, capture_output=True, text=True, check=True).stdout

    assert said == "[40 40 40 40] [30 30 30]\n"


@pytest.mark.parametrize("held", [np.int64(3), None, True, 0.5, "a/b"])
def test_a_kernel_may_hold_a_number_or_a_word(held: object) -> None:
    @kernel
    def is_held() -> bool:
        return held is not None

    assert is_held() == (held is not None)


def test_a_kernel_that_holds_a_table_or_a_kernel_is_compiled_in_every_run(caplog: pytest.LogCaptureFixture) -> None:
    table, twice = np.arange(3.0), doubled

    with caplog.at_level("INFO"):

        @kernel
        def last() -> float:
            return twice(table[2])

    assert last() == 4.0
    assert "not kept on disk" in caplog.text


def test_the_search_for_garbage_rests_while_kernels_are_compiled_and_goes_on_after() -> None:
    @kernel
    def inner(value: float) -> float:
        return 2.0 * value

    @kernel
    def outer(value: float) -> float:
        return inner(value) + 1.0

    passes: list[bool] = []

    class Watch(event.Listener):
        def on_start(self, event: event.Event) -> None:
            passes.append(gc.isenabled())

        def on_end(self, event: event.Event) -> None:
            passes.append(gc.isenabled())

    with event.install_listener("numba:run_pass", Watch()):
        assert outer(2.0) == 5.0

    assert passes
    assert not any(passes)
    assert gc.isenabled()
    gc.disable()
    try:
        assert outer(2) == 5.0
        assert not gc.isenabled()  # who switched it off wants it off
    finally:
        gc.enable()
