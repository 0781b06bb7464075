"""Running the command line as a user does, in a process of its own or in this one."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

Run = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def trailmark(tmp_path: Path) -> Run:
    """Runs ``trailmark ARGUMENTS`` in a folder of its own."""

    def run(*arguments: str | Path, timeout_s: float = 120.0) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "trailmark.cli", *map(str, arguments)]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=timeout_s, check=False)

    return run


@pytest.fixture
def wheels_config(tmp_path: Path) -> Path:
    """A config that plays wheel odometry around a circle of 2 m radius, with its true poses."""
    omega = 0.25
    rows = ["t,x,y,theta"]
    truth = []
    for i in range(400):
        t = 0.05 * i
        x, y, theta = 2 * math.sin(omega * t), 2 - 2 * math.cos(omega * t), omega * t
        rows.append(f"{t:.3f},{x:.9f},{y:.9f},{theta:.9f}")
        half = math.remainder(theta, 2 * math.pi) / 2
        truth.append(f"{t:.3f} {x:.9f} {y:.9f} 0 0 0 {math.sin(half):.9f} {math.cos(half):.9f}")
    (tmp_path / "wheels.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "truth.tum").write_text("\n".join(truth) + "\n")
    config = tmp_path / "wheels.yaml"
    config.write_text(
        "sources:\n"
        "  wheels: {plugin: csv_odometry, path: wheels.csv, ground_truth: truth.tum}\n"
        "localizers:\n"
        "  wheels: {plugin: odometry}\n"
    )
    return config
