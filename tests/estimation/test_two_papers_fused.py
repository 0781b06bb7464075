"""Methods of two papers on one robot, fused: the ground camera's motion (Nagai) and depth landmarks (Toth)."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark import Pipeline
from trailmark.geometry import Trajectory
from trailmark.pipeline import RunResult

pytestmark = pytest.mark.slow

START = (1.0, 2.0)
_DURATION_S = 2.0


@pytest.fixture(scope="module")
def fused() -> RunResult:
    """Drive along a wall, with both cameras."""
    robot = {
        "plugin": "sim",
        "world": "supermarket",
        "route": "wall",
        "sensors": ["floor", "rgbd"],
        "rates_hz": {"floor": 30, "rgbd": 5},
        "duration_s": _DURATION_S,
        "threads": 1,
    }
    written = {
        "sources": {"robot": robot},
        "localizers": {
            "floor": {"plugin": "ground_vo", "camera": "floor"},
            "kinect": {"plugin": "kinect_landmarks", "camera": "rgbd"},
        },
        "estimator": {"plugin": "kalman"},
        "start": [*START, 0.0],
        "seed": 5,
        "pace": "step",
    }
    with Pipeline(written) as pipeline:
        for _ in pipeline:
            pass
    assert pipeline.result is not None
    return pipeline.result


def worst_m(result: RunResult, name: str) -> float:
    found, truth = result.trajectories[name], result.ground_truth
    assert truth is not None
    at = truth.at(np.clip(found.stamps_s, truth.stamps_s[0], truth.stamps_s[-1]))
    assert isinstance(at, Trajectory)
    return float(np.hypot(*(found.positions - at.positions).T).max())


def test_both_are_believed(fused: RunResult) -> None:
    assert fused.counters["localizer.floor.accepted"] > 0.8 * 30 * _DURATION_S
    assert fused.counters["localizer.kinect.accepted"] >= 5


def test_together_they_are_more_exact_than_the_landmarks_alone(fused: RunResult) -> None:
    assert worst_m(fused, "fused") < 0.01
    assert worst_m(fused, "fused") < worst_m(fused, "kinect")
