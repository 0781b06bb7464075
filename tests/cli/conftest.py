"""Running the command line as a user does, and a run to give it."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from trailmark.cli import main

Run = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def trailmark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Run:
    """Calls ``trailmark ARGUMENTS`` in a folder of its own, and in this process: it takes longer to start another."""

    def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
        words = [*map(str, arguments)]
        monkeypatch.setattr(sys, "argv", ["trailmark", *words])
        capfd.readouterr()
        with pytest.raises(SystemExit) as left:
            main(words)
        told = capfd.readouterr()
        return subprocess.CompletedProcess(arguments, int(left.value.code or 0), told.out, told.err)

    monkeypatch.chdir(tmp_path)
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
