"""Fixtures that all tests share."""

from __future__ import annotations

import gc
import importlib.util
import os
import signal
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import settings

# How long an example takes says more about the machine than about the code; CI tries the same examples each time.
settings.register_profile("trailmark", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("trailmark")

REPOSITORY = Path(__file__).parents[1]


def pytest_configure() -> None:
    """Hear signals also under ``nohup`` or in a shell's background, where they are ignored, by children too."""
    defaults = {signal.SIGINT: signal.default_int_handler}
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, defaults.get(number, signal.SIG_DFL))


#: Files whose tests take seconds each: CI runs them in its second stage, and a contributor by `make test`.
SLOW = frozenset(
    {
        "baselines/test_ground_peers.py",
        "bench/test_cells.py",
        "bench/test_executors.py",
        "bench/test_frames.py",
        "bench/test_limits.py",
        "calibration/test_commands.py",
        "divs/test_closed_loop.py",
        "divs/test_place_fit.py",
        "docs/test_pages.py",
        "estimation/test_correlated_fixes.py",
        "estimation/test_kalman.py",
        "estimation/test_kalman_consistency.py",
        "ground_vo/test_calibrate_command.py",
        "ground_vo/test_map_localizer.py",
        "ground_vo/test_teach_and_replay.py",
        "kinect_landmarks/test_calibrate_command.py",
        "kinect_landmarks/test_localizer.py",
        "papers/test_nagai2015.py",
        "pipeline/loops/test_rooms_alike.py",
        "signals/test_endings.py",
        "signals/test_report.py",
        "signals/test_watch.py",
        "sim/test_shutter.py",
        "sim/test_worlds_forward.py",
        "trust/test_kills.py",
    }
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of slow files."""
    tests = Path(__file__).parent
    for item in items:
        if item.path.is_relative_to(tests) and item.path.relative_to(tests).as_posix() in SLOW:
            item.add_marker("slow")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Look for no garbage while tests are collected, nor ever in what is there then: modules and 8000 tests stay."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.fixture(scope="session")
def load_script() -> Callable[[str], ModuleType]:
    """Return what imports a script, named by its path in the checkout, as a module."""

    def load(path: str) -> ModuleType:
        spec = importlib.util.spec_from_file_location(f"script_{Path(path).stem}", REPOSITORY / path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module  # its dataclasses look their annotations up there
        sys.path.insert(0, str((REPOSITORY / path).parent))  # where a program finds those beside it
        try:
            spec.loader.exec_module(module)
        finally:
            sys.path.pop(0)
        return module

    return load


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Recordings that are not shipped: ``TRAILMARK_DATA``, or ``../shared/data`` beside the checkout."""
    folder = Path(os.environ.get("TRAILMARK_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no recordings at {folder}; set TRAILMARK_DATA to their folder")
    return folder


@pytest.fixture(scope="session")
def endless_program() -> str:
    """Return a program that runs until it is told to end, and notes into the file that it is given by which signal."""
    return """
import pathlib, signal, sys, time
def end(number, frame):
    pathlib.Path(sys.argv[1]).write_text(str(number))
    sys.exit(130)
signal.signal(signal.SIGINT, end)
pathlib.Path(sys.argv[1]).write_text("runs")
time.sleep(60)
"""
