"""What is said before a live robot is driven by a controller that does not look how old its belief is."""

from __future__ import annotations

from typing import Any

import pytest

from trailmark.cli.run import _unwatched
from trailmark.pipeline import read_config

SAID = "drives on when nothing measures the motion any more"


@pytest.mark.parametrize(
    ("controller", "keys", "is_said"),
    [
        ("path_tracking_4ws", {}, True),
        ("drift_steering", {}, True),
        ("path_tracking_4ws", {"stop_when": {"motion_age_s": 0.5}}, False),
        ("path_tracking_4ws", {"mode": "teach"}, False),
        ("path_tracking", {}, False),
        ("goal_seeking", {}, False),
    ],
)
def test_a_live_robot_that_nobody_would_stop_is_warned_of(controller: str, keys: dict[str, Any], is_said: bool) -> None:
    robot = {"plugin": "lines", "sensors": {"wheels": "odometry"}, "command": "steer_4ws"}
    parts = {"sources": {"robot": robot}, "localizers": {"wheels": {"plugin": "odometry"}}}

    goal = {"goal": [1.0, 0.0]} if controller == "goal_seeking" else {}
    said = list(_unwatched(read_config(parts | {"controller": {"plugin": controller, **goal}} | keys)))

    assert [SAID in line for line in said] == [True] * is_said


def test_a_simulated_robot_is_not() -> None:
    sim = {"plugin": "sim", "world": "ground_course", "sensors": ["wheels"], "driver": "commands"}
    parts = {"sources": {"robot": sim}, "localizers": {"wheels": {"plugin": "odometry"}}}

    assert not list(_unwatched(read_config(parts | {"controller": {"plugin": "path_tracking_4ws"}})))
