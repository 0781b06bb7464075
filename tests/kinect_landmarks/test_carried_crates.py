"""A crate that stands and is carried off before a camera of thirty pictures a second: it leads nobody along."""

from __future__ import annotations

import numpy as np
import pytest

import trailmark
from trailmark.estimates import Belief, Estimate, Fix, Motion
from trailmark.geometry import Pose2
from trailmark.interfaces import FrameSource, Session


def walk(world: str, place: int) -> FrameSource:
    """Three metres a second by ten, straight on; after 2 s the crate is carried along, faster than the robot drives."""
    source = trailmark.create(
        "source",
        "sim",
        world=world,
        route="straight",
        sensors=["rgbd"],
        world_seed=place,
        speed_mps=0.3,
        duration_s=4.0,
        options={"crate": "walks_off", "crate_s": 2, "registered": True},
        rates_hz={"rgbd": 30.0},
        threads=1,
    )
    source.start(Session(name="robot", rng=np.random.default_rng(0)))
    return source


def led_to(estimate: Estimate, before: Pose2) -> Pose2:
    if isinstance(estimate, Motion):
        return before @ estimate.pose_since_now
    return estimate.pose_map_base if isinstance(estimate, Fix) else before


@pytest.mark.slow
@pytest.mark.parametrize("plugin", ["kinect_flow", "kinect_landmarks"])
@pytest.mark.parametrize(("world", "place"), [("hallway", 6), ("lab", 4)])
def test_a_crate_that_is_carried_off_leads_nobody_along(plugin: str, world: str, place: int) -> None:
    source, localizer, pose, n_told = (
        walk(world, place),
        trailmark.create("localizer", plugin, camera="rgbd"),
        Pose2(),
        0,
    )
    start = Session(plugin, sensors=source.sensors, start_pose=pose, rng=np.random.default_rng(0))
    localizer.start(start)
    told: list[tuple[float, Pose2]] = []

    for frame in source.frames():
        for estimate in localizer.observe(frame, Belief(frame.stamp_s, pose, pose_odom_base=pose)):
            pose = led_to(estimate, pose)
            told.append((frame.stamp_s, pose))
            n_told += isinstance(estimate, Motion | Fix)

    truth = source.ground_truth()
    assert truth is not None
    begun, *true = [one for _, one in truth.at(np.array([truth.stamps_s[0], *(stamp_s for stamp_s, _ in told)]))]
    off_m = [begun.between(now).distance_to(said) for now, (_, said) in zip(true, told, strict=True)]
    assert n_told > 110
    assert max(off_m) < 0.12  # 0.4 to 1 m before
    assert off_m[-1] < 0.06
