"""Goal seeking: arrives from anywhere, stands while lost."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trailmark.commands import Stop, Velocity
from trailmark.estimates import Belief
from trailmark.geometry import Pose2, Twist2, wrap_angle
from trailmark.interfaces import Session
from trailmark.paths import Path, Waypoint
from trailmark_controllers.goal_seeking import GoalSeeking
from trailmark_controllers.goal_seeking_config import GoalSeekingConfig

GOAL = (5.55, 3.11)  # of the paper's Table 2


def started(goal: tuple[float, ...] = GOAL, **config: object) -> GoalSeeking:
    controller = GoalSeeking(GoalSeekingConfig.model_validate({"goal": goal, **config}))
    controller.start(Session())
    return controller


def belief(pose: Pose2 | None, fix_age_m: float = 0.0, sigma_m: float | None = None) -> Belief:
    covariance = None if sigma_m is None else np.diag([sigma_m**2, sigma_m**2, 0.01])
    return Belief(0.0, pose, covariance, fix_age_m=fix_age_m)


def drive(
    controller: GoalSeeking,
    pose: Pose2,
    noise_m: float = 0.0,
    dt_s: float = 0.05,
    steps: int = 4000,
    seen: list[Pose2] | None = None,
) -> tuple[Pose2, list[Velocity]]:
    """Drive with perfect wheels until done; return where the robot stands and what it was told."""
    rng = np.random.default_rng(4)
    told: list[Velocity] = []
    for _ in range(steps):
        if seen is not None:
            seen.append(pose)
        command = controller.step(
            belief(Pose2(pose.x + rng.normal(0, noise_m), pose.y + rng.normal(0, noise_m), pose.theta))
        )
        if isinstance(command, Stop):
            if command.done:
                return pose, told
            continue
        assert isinstance(command, Velocity)
        told.append(command)
        pose = pose @ Twist2(command.forward_mps, command.left_mps, command.yaw_radps).after(dt_s)
    raise AssertionError("the controller never finished")


@settings(max_examples=40, deadline=None)
@given(
    x=st.floats(0, 10), y=st.floats(0, 10), theta=st.floats(-3.1, 3.1),
    kind=st.sampled_from(["differential", "holonomic"]),
)  # fmt: skip
def test_the_goal_is_reached_from_anywhere(x: float, y: float, theta: float, kind: str) -> None:
    end, told = drive(started(drive=kind), Pose2(x, y, theta))

    assert math.hypot(end.x - GOAL[0], end.y - GOAL[1]) <= 0.04
    assert all(math.hypot(command.forward_mps, command.left_mps) <= 0.5 + 1e-9 for command in told)
    assert all(abs(command.yaw_radps) <= math.radians(45) + 1e-9 for command in told)


@pytest.mark.parametrize("kind", ["differential", "holonomic"])
@pytest.mark.parametrize("heading_deg", [0.0, 90.0, -170.0])
def test_a_goal_with_a_heading_ends_with_it(kind: str, heading_deg: float) -> None:
    end, _ = drive(started((1.0, -1.0, heading_deg), drive=kind), Pose2())

    assert abs(wrap_angle(end.theta - math.radians(heading_deg))) <= math.radians(2.0)
    assert math.hypot(end.x - 1.0, end.y + 1.0) <= 0.04


def test_a_differential_robot_never_drives_sideways() -> None:
    _, told = drive(started(), Pose2(0.0, 6.0, 2.0))

    assert all(command.left_mps == 0.0 for command in told)


def test_it_turns_on_the_spot_before_it_drives() -> None:
    command = started((0.0, 3.0)).step(belief(Pose2()))

    assert command == Velocity(0.0, 0.0, math.radians(45))


def test_a_near_goal_behind_is_reached_backwards() -> None:
    command = started((-0.2, 0.0)).step(belief(Pose2()))

    assert isinstance(command, Velocity)
    assert command.forward_mps < 0.0
    assert command.yaw_radps == pytest.approx(0.0)


def test_it_slows_down_before_the_goal() -> None:
    controller = started((1.0, 0.0))

    speeds = [controller.step(belief(Pose2(x, 0.0, 0.0))).forward_mps for x in (0.0, 0.7, 0.97)]  # type: ignore[union-attr]

    assert speeds == pytest.approx([0.5, 0.25, 0.03])


def test_a_noisy_pose_still_arrives() -> None:
    end, _ = drive(started(arrive_m=0.03), Pose2(1.0, 1.0, 0.0), noise_m=0.005)

    assert math.hypot(end.x - GOAL[0], end.y - GOAL[1]) <= 0.06


def test_it_stands_until_it_knows_where_it_is_and_the_run_goes_on() -> None:
    assert started().step(belief(None)) == Stop("the pose is not known yet", done=False)


def test_it_looks_around_on_the_spot_when_asked_to() -> None:
    controller = started(search_dps=20.0)

    assert controller.step(Belief(3.0)) == Velocity(0.0, 0.0, math.radians(20.0))
    assert controller.step(Belief(38.0)) == Velocity(0.0, 0.0, math.radians(20.0))
    assert controller.step(Belief(39.1)) == Stop("the pose is not known yet")
    assert controller.step(belief(Pose2(), fix_age_m=2.5)) == Stop("lost: 2.50 m without a fix", done=False)


def test_it_stands_and_looks_before_it_turns() -> None:
    controller = started(search_dps=20.0, search_wait_s=5.0)

    assert controller.step(Belief(3.0)) == Stop("looking around")
    assert controller.step(Belief(7.9)) == Stop("looking around")
    assert controller.step(Belief(8.0)) == Velocity(0.0, 0.0, math.radians(20.0))
    assert controller.step(Belief(43.9)) == Velocity(0.0, 0.0, math.radians(20.0))
    assert controller.step(Belief(44.1)) == Stop("the pose is not known yet")


@pytest.mark.parametrize(
    ("believed", "reason"),
    [
        (belief(Pose2(), fix_age_m=math.inf), "lost: no fix yet"),
        (belief(Pose2(), fix_age_m=2.5), "lost: 2.50 m without a fix"),
        (belief(Pose2(), sigma_m=0.8), "lost: the position is known to 0.80 m only"),
    ],
)
def test_it_stops_when_lost_and_says_why(believed: Belief, reason: str) -> None:
    controller = started()
    assert isinstance(controller.step(belief(Pose2())), Velocity)

    assert controller.step(believed) == Stop(reason, done=False)
    assert isinstance(controller.step(belief(Pose2(), sigma_m=0.1)), Velocity)


def test_odometry_alone_is_enough_when_asked_for() -> None:
    controller = started(max_fix_age_m=None)

    assert isinstance(controller.step(belief(Pose2(), fix_age_m=math.inf)), Velocity)


def test_arrival_is_believed_only_when_it_stays_true() -> None:
    controller = started((1.0, 0.0), settle_steps=3)
    there, away = belief(Pose2(1.0, 0.0, 0.0)), belief(Pose2(0.8, 0.0, 0.0))

    assert controller.step(there) == Stop("at the goal, making sure")
    assert isinstance(controller.step(away), Velocity)
    stops = [controller.step(there) for _ in range(3)]

    assert [stop.done for stop in stops] == [False, False, True]  # type: ignore[union-attr]


def test_starting_again_is_as_new() -> None:
    controller = started((1.0, 0.0), settle_steps=2)
    controller.step(belief(Pose2(1.0, 0.0, 0.0)))

    controller.start(Session())

    assert controller.step(belief(Pose2(1.0, 0.0, 0.0))) == Stop("at the goal, making sure")


def corner() -> Path:
    """Return a path of two legs around a corner: 4 m along x, then 4 m along y."""
    points = [(0.1 * k, 0.0, 0.0) for k in range(41)] + [(4.0, 0.1 * k, math.pi / 2) for k in range(1, 41)]
    return Path(Waypoint(k, 0.1 * k, Pose2(*point)) for k, point in enumerate(points))


@pytest.mark.parametrize("kind", ["differential", "holonomic"])
@pytest.mark.parametrize(("goal", "start"), [((4.4, 3.0), Pose2(0.5, 0.3, 2.0)), ((0.5, -0.3), Pose2(3.8, 3.5, -1.0))])
def test_the_taught_path_leads_around_the_corner(kind: str, goal: tuple[float, float], start: Pose2) -> None:
    controller = GoalSeeking(GoalSeekingConfig.model_validate({"goal": goal, "drive": kind}))
    controller.start(Session(mode="replay", path=corner()))
    places: list[Pose2] = []

    end, _ = drive(controller, start, seen=places)

    assert math.hypot(end.x - goal[0], end.y - goal[1]) <= 0.04
    assert all(abs(corner().locate(place).lateral_m) <= 0.5 for place in places)


def test_the_straight_way_cuts_the_corner_when_asked_for() -> None:
    controller = GoalSeeking(GoalSeekingConfig.model_validate({"goal": (4.0, 3.0), "way": "straight"}))
    controller.start(Session(mode="replay", path=corner()))

    command = controller.step(belief(Pose2(0.0, 0.0, math.atan2(3.0, 4.0))))

    assert isinstance(command, Velocity)
    assert (command.forward_mps, command.yaw_radps) == pytest.approx((0.5, 0.0))


@pytest.mark.parametrize(
    ("config", "match"),
    [
        ({"goal": (1.0,)}, "goal"),
        ({"creep_mps": 2.0}, "faster than speed_mps"),
        ({"speed": 1.0}, "Extra inputs"),
    ],
)
def test_impossible_configs_are_refused(config: dict[str, object], match: str) -> None:
    with pytest.raises(ValueError, match=match):
        GoalSeekingConfig.model_validate({"goal": GOAL, **config})
