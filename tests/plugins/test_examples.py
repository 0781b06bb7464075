"""Distributions that live in `examples`, each with tests of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_beliefs_reach_an_autopilot() -> None:
    pytest.importorskip("pymavlink", reason="pymavlink is not installed")
    folder = ROOT / "examples" / "mavlink_sink"
    environment = os.environ | {"PYTHONPATH": str(folder / "src")}
    environment.pop("PYTEST_ADDOPTS", None)

    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests"]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)

    assert done.returncode == 0, done.stdout
