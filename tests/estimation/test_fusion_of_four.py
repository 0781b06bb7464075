"""Four localizers of one robot, one of them off or lying for a fifth of the time; the benchmark renders, this draws."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from types import ModuleType

import numpy as np
import pytest

from trailmark.estimates import Estimate, Fix, Motion, PathOffset, information_from_sigmas
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.geometry import Pose2, Trajectory
from trailmark.paths import Path as TaughtPath
from trailmark.paths import Waypoint

DT_S, N = 0.05, 240
SIGMAS = {
    "floor": (2e-4, 2e-4, 2e-4),
    "wheels": (2e-3, 1e-3, 4e-3),
    "floor_map": (0.004, 0.004, 0.004),
    "omni": (0.03, 0.03, 0.01),
    "laser": (0.01, 0.01, 0.004),
    "kinect": (0.05, 0.05, 0.02),
    "streams": (math.inf, 0.03, 0.02),
}
#: Every how many steps each speaks.
EVERY = {"floor": 1, "wheels": 1, "floor_map": 2, "omni": 8, "laser": 5, "kinect": 4, "streams": 2}


@pytest.fixture(scope="module")
def four(load_script: Callable[[str], ModuleType]) -> ModuleType:
    return load_script("benchmarks/fusion_four.py")


def way() -> list[Pose2]:
    poses = [Pose2(1.0, 2.0, 0.0)]
    for i in range(N):
        poses.append(poses[-1] @ Pose2(0.02, 0.0, 0.012 * math.sin(0.03 * i)))
    return poses


def told_of(poses: list[Pose2], path: TaughtPath, seed: int) -> list[tuple[float, str, Estimate]]:
    rng = np.random.default_rng(seed)
    told: list[tuple[float, str, Estimate]] = []
    for i in range(1, N + 1):
        stamp_s = DT_S * i
        for source, every in EVERY.items():
            if i % every:
                continue
            sigmas = SIGMAS[source]
            noise = rng.normal(size=3) * np.where(np.isfinite(sigmas), sigmas, 0.0)
            information = information_from_sigmas(*sigmas)
            if source in ("floor", "wheels"):
                step = Pose2.from_array(poses[i - 1].between(poses[i]).array() + noise)
                told.append((stamp_s, source, Motion(stamp_s - DT_S, stamp_s, step, information)))
            elif source == "streams":
                on_path = path.locate(poses[i])
                lateral_m, heading_rad = on_path.lateral_m + noise[1], on_path.heading_rad + noise[2]
                told.append(
                    (stamp_s, source, PathOffset(stamp_s, on_path.station_m, lateral_m, heading_rad, information))
                )
            else:
                told.append((stamp_s, source, Fix(stamp_s, Pose2.from_array(poses[i].array() + noise), information)))
    return told


@pytest.mark.parametrize("failed", ["ground", "omni", "kinect", "streams"])
@pytest.mark.parametrize("fault", ["off", "lies"])
def test_whoever_fails_the_fused_belief_is_about_as_good_as_the_best(four: ModuleType, failed: str, fault: str) -> None:
    poses = way()
    stations = np.concatenate([[0.0], np.cumsum([a.distance_to(b) for a, b in pairwise(poses)])])
    path = TaughtPath(Waypoint(i, float(stations[i]), pose) for i, pose in enumerate(poses))
    truth = Trajectory.from_poses((DT_S * i, pose) for i, pose in enumerate(poses))
    told = told_of(poses, path, seed=11)
    faulty = list(four.with_fault(told, four.GROUPS[failed], fault, 4.0, 4.0 + 0.2 * DT_S * N))

    fused_m = four.ate(Kalman(KalmanConfig()), faulty, truth, path)
    alone_m = {group: four.ate(four._alone(), four._of(faulty, group), truth, path) for group in four.GROUPS}

    assert fused_m <= 1.1 * min(alone_m.values())
    assert fused_m <= 0.5 * alone_m[failed]


def test_a_lie_shifts_what_is_said_and_not_how_certain_it_is(four: ModuleType) -> None:
    information = information_from_sigmas(0.1, 0.1, 0.1)
    told = [
        (1.0, "omni", Fix(1.0, Pose2(0.0, 0.0, math.pi / 2), information)),
        (1.0, "floor", Motion(0.9, 1.0, Pose2(0.1), information)),
        (1.1, "floor", Motion(1.0, 1.1, Pose2(0.1), information)),
        (2.0, "floor", Motion(1.9, 2.0, Pose2(0.1), information)),
        (1.0, "streams", PathOffset(1.0, 3.0, 0.1, 0.0, information)),
    ]

    fix, begins, goes_on, ends, offset = (
        item[2] for item in four.with_fault(told, ("omni", "floor", "streams"), "lies", 1.0, 2.0)
    )

    np.testing.assert_allclose(fix.pose_map_base.array(), [-1.0, 0.0, math.pi / 2], atol=1e-12)
    assert [motion.pose_since_now.y for motion in (begins, goes_on, ends)] == [1.0, 0.0, -1.0]
    assert offset.lateral_m == pytest.approx(1.1)
    assert fix.information is information or np.array_equal(fix.information, information)
