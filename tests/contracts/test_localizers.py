"""Every localizer that comes with Trailmark passes the checks that the authors of others are given."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from trailmark.plugins import load_plugins
from trailmark.testing import (
    AnyRun,
    SyntheticRun,
    circle,
    ground_run,
    imu_run,
    landmark_run,
    localizer_checks,
    odometry_run,
    pose_run,
    room_run,
    straight,
    uneven,
)
from trailmark.testing.checks.parametrize import parametrize

REGISTRY = load_plugins().registry
BUILT_IN = {spec.name for spec in REGISTRY.specs("localizer") if spec.distribution == "trailmark"}

#: Late stamps show on drives whose speed changes alone.
UNEVEN = uneven(circle(0.3, 1.0))
AHEAD = partial(room_run, "image", uneven(straight(0.3)), 40)
RGBD = partial(room_run, "rgbd", UNEVEN, 20)


def over_ground() -> AnyRun:
    """A camera over a floor; rendered once, not in each check."""
    run = ground_run(uneven(circle(0.26, 1.0), period_s=0.3), 30)
    return SyntheticRun(tuple(run.frames), run.sensors, run.truth)


#: A run that each localizer understands, and the keys that its config needs.
CASES: dict[str, tuple[Callable[[], AnyRun], dict[str, Any]]] = {
    "column_ncc": (AHEAD, {}),
    "constant_speed": (AHEAD, {"speed_mps": 0.3}),
    "divs": (AHEAD, {}),
    "ground_map": (over_ground, {}),
    "ground_vo": (over_ground, {}),
    "imu": (partial(imu_run, UNEVEN), {}),
    "kinect_flow": (RGBD, {}),
    "kinect_landmarks": (RGBD, {}),
    "kinect_motion": (RGBD, {}),
    "klt": (over_ground, {}),
    "known_landmarks": (partial(landmark_run, UNEVEN), {}),
    "grid_mcl": (partial(room_run, "scan", UNEVEN, 30), {"n_start": 20_000, "n_search": 3000}),
    "laser_icp": (partial(room_run, "scan", UNEVEN, 30), {}),
    "odometry": (partial(odometry_run, UNEVEN), {}),
    "omni_surf": (partial(room_run, "omni", uneven(circle(0.5, 1.0)), 40), {}),
    "orb": (over_ground, {}),
    "orb_rgbd": (RGBD, {}),
    "patch_ncc": (AHEAD, {}),
    "phase_correlation": (over_ground, {}),
    "phase_shift": (AHEAD, {}),
    "pose_fixes": (partial(pose_run, UNEVEN), {}),
    "scan_odometry": (partial(room_run, "scan", UNEVEN, 30), {}),
}

#: What is known not to pass, and why.
EXPECTED_FAILURES = {
    "constant_speed-black_frames_are_no_answer": "it drives on at a known speed, whatever it sees",
    "constant_speed-white_frames_are_no_answer": "it drives on at a known speed, whatever it sees",
    "divs-finish_works_from_the_map_alone": "looks are written in rows of many: a kill loses the row not yet full",
    "divs-black_frames_are_no_answer": "its window of 25 pictures outlasts five black ones",
    "divs-white_frames_are_no_answer": "its window of 25 pictures outlasts five white ones",
}


def checks_of(names: set[str], memory_frames: int) -> dict[str, Callable[[], None]]:
    """Return the checks of localizers, by ``localizer-check``."""
    found: dict[str, Callable[[], None]] = {}
    for name in sorted(names & CASES.keys()):
        run, keys = CASES[name]
        spec = REGISTRY.find("localizer", name)
        checks = localizer_checks(spec.load(), spec.load_config().model_validate(keys), run, memory_frames)
        found |= {f"{name}-{check}": call for check, call in checks.items()}
    return found


def test_every_built_in_is_checked() -> None:
    assert CASES.keys() == BUILT_IN


@parametrize(checks_of(BUILT_IN, memory_frames=100), EXPECTED_FAILURES)
def test_contract(check: Callable[[], None]) -> None:
    check()


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(BUILT_IN))
def test_memory_is_bounded_over_10000_frames(name: str) -> None:
    checks_of({name}, memory_frames=10_000)[f"{name}-memory_is_bounded"]()
