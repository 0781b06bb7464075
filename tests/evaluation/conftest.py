"""Trajectories and run folders that the tests of the metrics share."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from trailmark.geometry import Trajectory, write_tum

COLUMNS = (
    "arrived_s,source,kind,since_s,stamp_s,x,y,theta,info_xx,info_xy,info_xt,info_yy,info_yt,info_tt,"
    "status,nis,dof,reason,details"
)


def _way(x: np.ndarray, y: np.ndarray, rate_hz: float) -> Trajectory:
    headings = np.arctan2(np.gradient(y), np.gradient(x))
    return Trajectory(np.arange(len(x)) / rate_hz, np.column_stack([x, y, headings]))


@pytest.fixture
def figure_eight() -> Trajectory:
    """Two loops of 3 m by 2 m in 20 s, 401 poses."""
    phase = np.linspace(0.0, 2.0 * np.pi, 401)
    return _way(3.0 * np.sin(phase), 1.0 * np.sin(2.0 * phase), 20.0)


@pytest.fixture
def straight() -> Trajectory:
    """10 m along x in 10 s, 101 poses."""
    x = np.linspace(0.0, 10.0, 101)
    return _way(x, np.zeros_like(x), 10.0)


@pytest.fixture
def static() -> Trajectory:
    """10 s at one place, 101 poses."""
    return Trajectory(np.arange(101) / 10.0, np.tile([2.0, -1.0, 0.5], (101, 1)))


@pytest.fixture
def noisy() -> Callable[..., Trajectory]:
    """Return a trajectory with normal noise added, the same for the same seed."""

    def add(trajectory: Trajectory, sigma_m: float, sigma_rad: float = 0.0, seed: int = 7) -> Trajectory:
        noise = np.random.default_rng(seed).normal(size=trajectory.poses.shape) * [sigma_m, sigma_m, sigma_rad]
        return Trajectory(trajectory.stamps_s, trajectory.poses + noise)

    return add


@pytest.fixture
def write_run(tmp_path: Path) -> Callable[..., Path]:
    """Write the folder of a run from trajectories, truth and rows of ``estimates.csv``."""

    def write(
        trajectories: Mapping[str, Trajectory],
        truth: Trajectory | None = None,
        estimates: Sequence[str] | None = None,
        config: str = "",
        name: str = "run",
    ) -> Path:
        folder = tmp_path / name
        (folder / "trajectories").mkdir(parents=True)
        for stem, trajectory in {**trajectories, **({"groundtruth": truth} if truth else {})}.items():
            write_tum(folder / "trajectories" / f"{stem}.tum", trajectory)
        (folder / "run.json").write_text(json.dumps({"status": "done"}))
        (folder / "config.yaml").write_text(config)
        if estimates is not None:
            (folder / "estimates.csv").write_text("\n".join([COLUMNS, *estimates]) + "\n")
        return folder

    return write
