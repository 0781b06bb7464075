"""A floor camera that hangs half way while a robot steers by it and its wheels: the robot stays on its path."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark import Pipeline

START, WAY_M = (1.0, 2.0), 1.2


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_robot_stays_on_its_path_when_the_camera_hangs(seed: int) -> None:
    written = {
        "sources": {
            "robot": {
                "plugin": "sim",
                "world": "supermarket",
                "route": "round",
                "driver": "commands",
                "sensors": ["floor", "wheels"],
                "rates_hz": {"floor": 30, "wheels": 30},
                "duration_s": 8,
                "threads": 1,
                "perturb": {"sensors": ["floor"], "noise": 2, "frozen": {"from_s": 2.0}},
            }
        },
        "localizers": {"wheels": {"plugin": "odometry"}, "floor": {"plugin": "ground_vo", "camera": "floor"}},
        "estimator": {"plugin": "kalman"},
        "controller": {
            "plugin": "goal_seeking",
            "goal": [START[0] + WAY_M, START[1]],
            "way": "straight",
            "speed_mps": 0.3,
            "max_fix_age_m": None,
        },
        "control_hz": 20.0,
        "start": [*START, 0.0],
        "seed": seed,
        "pace": "step",
    }

    with Pipeline(written) as pipeline:
        for _ in pipeline:
            pass
    result = pipeline.result

    assert result is not None
    assert result.ground_truth is not None
    driven = result.ground_truth.positions - START
    assert np.abs(driven[:, 1]).max() < 0.03
    assert np.hypot(driven[-1, 0] - WAY_M, driven[-1, 1]) < 0.03
    assert result.counters["localizer.floor.accepted"] > 50
    assert result.counters["localizer.floor.lost"] > 100  # it says so, and is no reason to stop
