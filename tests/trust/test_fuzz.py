"""A share of the hostile input in each run of the tests; the whole by `make trust`."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

N_CASES = 25


@pytest.fixture(scope="module")
def fuzz() -> ModuleType:
    spec = importlib.util.spec_from_file_location("fuzz", Path(__file__).with_name("fuzz.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["fuzz"] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return module


TARGETS = (
    *("bag", "calibration", "carmen", "command_line", "config", "kitti"),
    *("picture", "rgbd", "store", "table", "trajectory"),
)


def test_every_target_is_tried(fuzz: ModuleType) -> None:
    assert sorted(fuzz.TARGETS) == sorted(TARGETS)


@pytest.mark.parametrize("target", [name for name in TARGETS if name not in ("command_line", "picture")])
def test_what_is_not_spoilt_is_accepted(fuzz: ModuleType, target: str, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(fuzz, "spoilt", lambda data, rng: data)
    monkeypatch.setattr(fuzz, "mutated", lambda data, rng: data)

    class Lucky(np.random.Generator):
        """Never makes a file of another kind."""

        def random(self, *arguments, **keys):
            return 0.5

    fuzz.TARGETS[target](Lucky(np.random.PCG64(0)), tmp_path)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("target", TARGETS)
def test_hostile_input_is_answered(fuzz: ModuleType, target: str) -> None:
    fuzz.run(target, range(1))  # imports what is imported on first use
    tally = fuzz.run(target, range(N_CASES))

    assert not tally.findings, "\n".join(tally.findings)
    assert tally.n == N_CASES


def test_a_hang_and_a_bug_are_found(fuzz: ModuleType, monkeypatch) -> None:
    monkeypatch.setattr(fuzz, "PATIENCE_S", 0.05)

    def hang(rng, folder):
        while True:
            pass

    monkeypatch.setitem(fuzz.TARGETS, "hang", hang)
    monkeypatch.setitem(fuzz.TARGETS, "bug", lambda rng, folder: [][0])

    assert "still at it" in fuzz.run("hang", range(1)).findings[-1]
    assert "IndexError" in fuzz.run("bug", range(1)).findings[0]
