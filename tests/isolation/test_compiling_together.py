"""Two processes that compile a list of kernels: who takes what, who waits for whom, and what is left behind."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from trailmark.isolation import compiling
from trailmark.isolation.compiling import CompilingProcess, compile_offered, compile_together

LIST = "some_kernels.FIRST"


class Kernel:
    """Only notes for what it was compiled."""

    def __init__(self, error: Exception | None = None) -> None:
        self.compiled: list[tuple[str, ...]] = []
        self.error = error
        self.__name__ = "some_kernel"

    def compile(self, types: tuple[str, ...]) -> None:
        if self.error is not None:
            raise self.error
        self.compiled.append(types)


@pytest.fixture
def kernels(monkeypatch: pytest.MonkeyPatch) -> tuple[Kernel, ...]:
    """Three kernels that a module lists."""
    module, listed = ModuleType("some_kernels"), (Kernel(), Kernel(), Kernel())
    vars(module)["FIRST"] = [(kernel, (f"type {i}",)) for i, kernel in enumerate(listed)]
    monkeypatch.setitem(sys.modules, "some_kernels", module)
    return listed


@pytest.fixture
def beside(kernels: tuple[Kernel, ...]) -> Iterator[CompilingProcess]:
    """A process beside that lives for a while and takes nothing."""
    process = CompilingProcess([sys.executable, "-c", "import sys; sys.stdin.read()"])
    yield process
    process.close()


def compiled(kernels: tuple[Kernel, ...]) -> list[int]:
    return [len(kernel.compiled) for kernel in kernels]


def test_without_a_process_beside_nothing_is_compiled_ahead(kernels: tuple[Kernel, ...]) -> None:
    compile_together(LIST)

    assert compiled(kernels) == [0, 0, 0]


def test_what_the_other_has_not_taken_is_compiled_here_and_once(
    beside: CompilingProcess, kernels: tuple[Kernel, ...]
) -> None:
    for note in ("taken", "done"):
        (beside._folder / f"{LIST}.1.{note}").touch()

    compile_together(LIST)
    compile_together(LIST)  # as a second localizer does

    assert compiled(kernels) == [1, 0, 1]
    assert kernels[2].compiled == [("type 2",)]


def test_a_kernel_that_the_other_compiles_is_waited_for(beside: CompilingProcess, kernels: tuple[Kernel, ...]) -> None:
    (beside._folder / f"{LIST}.0.taken").touch()
    timer = threading.Timer(0.2, (beside._folder / f"{LIST}.0.done").touch)
    began_s = time.monotonic()
    timer.start()

    compile_together(LIST)

    assert time.monotonic() - began_s >= 0.2
    assert compiled(kernels) == [0, 1, 1]


def test_one_that_is_gone_or_hangs_is_not_waited_for(
    beside: CompilingProcess,
    kernels: tuple[Kernel, ...],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    (beside._folder / f"{LIST}.0.taken").touch()
    monkeypatch.setattr(compiling, "_PATIENCE_S", 0.1)

    compile_together(LIST)
    assert "are not done in 0.1 s" in caplog.text

    caplog.clear()
    beside._process.kill()
    beside._process.wait()
    compile_together(LIST)
    assert not caplog.records


def test_the_process_takes_what_is_offered_and_left(beside: CompilingProcess, kernels: tuple[Kernel, ...]) -> None:
    (beside._folder / LIST).touch()
    (beside._folder / f"{LIST}.0.taken").touch()

    compile_offered(beside._folder)

    assert compiled(kernels) == [0, 1, 1]


def test_a_kernel_that_does_not_compile_is_left_to_its_caller(
    beside: CompilingProcess, kernels: tuple[Kernel, ...], caplog: pytest.LogCaptureFixture
) -> None:
    kernels[0].error = ValueError("no such vectors")

    with caplog.at_level("INFO"):
        compile_together(LIST)

    assert compiled(kernels) == [0, 1, 1]
    assert "no such vectors" in caplog.text


def test_nothing_is_left_behind(beside: CompilingProcess, kernels: tuple[Kernel, ...]) -> None:
    compile_together(LIST)
    folder, process = beside._folder, beside._process
    beside.close()
    beside.close()
    compile_together(LIST)

    assert process.poll() is not None
    assert not folder.exists()
    assert compiled(kernels) == [1, 1, 1]


def test_where_no_process_starts_no_folder_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    with pytest.raises(OSError, match="nowhere"):
        CompilingProcess([str(tmp_path / "nowhere")])

    assert not list(tmp_path.iterdir())
    assert not compiling._running
