"""Odometry that has no reading for seconds, and a pose that was restated behind the gap."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Belief, Estimate, Fix, Lost, Motion, information_from_sigmas
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.frames import Frame, Odometry
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import Session
from trailmark_baselines.config import OdometryConfig
from trailmark_baselines.odometry import OdometryLocalizer

from .test_odometry import at, localizer, observed, sigmas


def even_drive(duration_s: float, twist: Twist2, period_s: float = 0.05) -> list[Frame]:
    return [at(period_s * i, twist.after(period_s * i)) for i in range(round(duration_s / period_s) + 1)]


def after_gap(made: OdometryLocalizer, twist: Twist2, gap_s: float, step: Pose2) -> Estimate:
    """Return what is said of a step across a gap, behind 3 s of an even drive."""
    frames = even_drive(3.0, twist)
    observed(made, *frames)
    (answer,) = observed(made, at(3.0 + gap_s, twist.after(3.0) @ step))
    return answer


_TWISTS = [Twist2(0.1), Twist2(0.5), Twist2(2.0), Twist2(-0.5), Twist2(0.0, 0.0, 0.3)]
_GAPS = [(gap_s, twist) for gap_s in (2.0, 6.0, 20.0) for twist in _TWISTS] + [(0.5, Twist2(0.5)), (0.5, Twist2(2.0))]


@pytest.mark.parametrize(("gap_s", "twist"), _GAPS)
def test_a_step_that_may_miss_the_way_of_a_gap_covers_it_and_is_said_once(
    gap_s: float, twist: Twist2, caplog: pytest.LogCaptureFixture
) -> None:
    """The robot may have stood: the step is kept. Or it went on: that is one standard deviation, at most."""
    made = localizer()

    answer = after_gap(made, twist, gap_s, Pose2())

    assert isinstance(answer, Motion)
    assert answer.is_guess
    np.testing.assert_allclose(answer.pose_since_now.array(), 0.0, atol=1e-9)
    assert sigmas(answer)[:2].min() >= max(abs(twist.forward_mps), 0.5) * gap_s - 1e-6
    assert sigmas(answer)[2] >= min(max(twist.yaw_radps, math.radians(30.0)) * gap_s, math.pi) - 1e-6
    assert "missing" in made.health()
    assert len(caplog.records) == 1


@pytest.mark.parametrize("turn_deg", [60.0, 180.0])
def test_a_sharp_turn_in_a_gap_is_kept_and_as_uncertain_as_going_straight(turn_deg: float) -> None:
    turn_rad = math.radians(turn_deg)

    answer = after_gap(localizer(), Twist2(0.3), 1.2, Pose2(0.03, 0.0, turn_rad - 1e-3))

    assert isinstance(answer, Motion)
    assert answer.pose_since_now.theta == pytest.approx(turn_rad, abs=0.01)
    assert sigmas(answer)[2] >= 0.99 * turn_rad


def test_a_pose_at_zero_behind_a_gap_is_a_restart() -> None:
    """It is no farther away than the robot drives in that time."""
    made = localizer()
    observed(made, *even_drive(3.0, Twist2(0.5)))

    (answer,) = observed(made, at(9.0, Pose2()))

    assert isinstance(answer, Lost)


def test_a_distance_at_zero_behind_a_gap_is_a_restart() -> None:
    made = localizer()
    observed(made, *[at(0.05 * i, distance_m=0.05 * i) for i in range(61)])

    (answer,) = observed(made, at(9.0, distance_m=0.0))

    assert isinstance(answer, Lost)


def test_a_speed_told_behind_a_gap_is_covered() -> None:
    """It crawled before, and may have begun to drive as fast at the beginning of the gap."""
    made = localizer()
    observed(made, *even_drive(3.0, Twist2(0.1)))

    (answer,) = observed(made, Frame("wheels", 9.0, Odometry(Pose2(0.3), None, Twist2(3.0))))

    assert isinstance(answer, Motion)
    assert sigmas(answer)[:2].min() > 0.99 * 18.0


@pytest.mark.parametrize("gap_s", [0.5, 2.0, 6.0])
def test_wheels_that_count_on_while_messages_are_lost_are_believed(gap_s: float) -> None:
    made, twist = localizer(), Twist2(0.5, 0.0, 0.1)

    answer = after_gap(made, twist, gap_s, twist.after(gap_s))

    assert isinstance(answer, Motion)
    assert not made.health()
    np.testing.assert_allclose(answer.pose_since_now.array(), twist.after(gap_s).array(), atol=1e-9)
    assert sigmas(answer)[0] < 0.1 * 0.5 * gap_s


def test_a_step_that_may_hold_a_part_of_the_way_covers_all_of_it() -> None:
    """Wheels count for 4 s of 6."""
    answer = after_gap(localizer(), Twist2(0.5), 6.0, Pose2(2.0))

    assert isinstance(answer, Motion)
    assert sigmas(answer)[0] == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize("restated", [Pose2(), Pose2(4.0, -7.0, 1.0)])
def test_a_pose_that_was_restated_in_a_gap_is_no_motion(restated: Pose2) -> None:
    made, frames = localizer(), even_drive(8.0, Twist2(0.5))
    observed(made, *frames)

    (answer,) = observed(made, at(9.0, restated))

    assert isinstance(answer, Lost)


def test_odometry_that_begins_at_zero_again_without_a_gap_is_lost_once() -> None:
    made = localizer()
    observed(made, *even_drive(0.8, Twist2(0.5)))

    answers = observed(made, *[at(0.85 + 0.05 * i, Pose2(0.025 * i)) for i in range(3)])

    assert [type(answer) for answer in answers] == [Lost, Motion, Motion]
    assert "restarted" in answers[0].reason


def test_velocities_say_nothing_of_a_long_gap() -> None:
    made = localizer(reads="velocity")
    twist = Twist2(0.5)
    frames = [Frame("wheels", stamp_s, Odometry(Pose2(), twist=twist)) for stamp_s in (0.0, 0.1, 0.2, 0.3, 4.0)]

    *_, last = observed(made, *frames)

    assert isinstance(last, Lost)


def test_who_stood_before_a_gap_may_have_driven_meanwhile() -> None:
    """It drove at 1 m/s before; that is 3.3 standard deviations, and of long it is two."""
    frames = [*even_drive(3.0, Twist2(1.0)), *[at(3.05 + 0.05 * i, Pose2(3.0)) for i in range(60)]]
    made = localizer()
    observed(made, *frames)
    rested_s = frames[-1].stamp_s

    short, long = observed(made, at(rested_s + 1.0, Pose2(3.0)), at(rested_s + 7.0, Pose2(3.0)))

    assert isinstance(short, Motion)
    np.testing.assert_allclose(sigmas(short)[:2], 0.3, rtol=0.02)
    assert isinstance(long, Motion)
    np.testing.assert_allclose(sigmas(long)[:2], 3.0, rtol=0.02)


@pytest.mark.parametrize("period_s", [2.05, 5.0, 40.0])
@pytest.mark.parametrize("speed_mps", [0.0, 0.2])
def test_readings_that_always_come_seldom_are_motions_as_wide_as_what_may_have_happened(
    period_s: float, speed_mps: float, caplog: pytest.LogCaptureFixture
) -> None:
    """Steady for half of the way, then twice as fast: that step is as uncertain as it differs from going on."""
    ways_m = [speed_mps * period_s * (i + max(i - 10, 0)) for i in range(20)]

    first, second, *answers = observed(localizer(), *[at(period_s * i, Pose2(x)) for i, x in enumerate(ways_m)])

    assert isinstance(first, Lost)
    assert len(caplog.records) == 1
    assert all(isinstance(answer, Motion) for answer in answers)
    assert sigmas(second)[0] > 0.4 * period_s
    if speed_mps:
        assert sigmas(answers[5])[0] < 0.1 * speed_mps * period_s
        assert sigmas(answers[8])[0] > 0.9 * speed_mps * period_s


def test_of_readings_that_come_seldom_several_in_a_row_are_a_gap() -> None:
    made = localizer()
    observed(made, *[at(5.0 * i, Pose2(1.0 * i)) for i in range(8)])

    (missing,) = observed(made, at(60.0, Pose2(7.0)))

    assert isinstance(missing, Motion)
    assert sigmas(missing)[0] >= 0.5 * 25.0
    assert "missing" in made.health()


def test_velocities_that_come_seldom_are_warned_of_once(caplog: pytest.LogCaptureFixture) -> None:
    frames = [Frame("wheels", 5.0 * i, Odometry(Pose2(), twist=Twist2(0.5))) for i in range(10)]

    answers = observed(localizer(reads="velocity"), *frames)

    assert all(isinstance(answer, Lost) for answer in answers)
    assert len(caplog.records) == 1


@pytest.mark.parametrize("is_first", [True, False])
def test_a_reading_that_was_held_back_does_not_hide_a_restart(is_first: bool) -> None:
    """It comes 1 ms after another, behind the start or a gap of which the way is missing."""
    made = localizer()
    if not is_first:
        observed(made, *even_drive(4.95, Twist2(0.5)))
    burst = [at(8.0, Pose2(2.5)), at(8.001, Pose2(2.509, 0.0, 0.1))]
    back = [at(8.05 + 0.05 * i, Pose2(2.5 - 0.025 * i)) for i in range(85)]
    observed(made, *burst, *back)

    (restart,) = observed(made, at(back[-1].stamp_s + 0.05, Pose2()))

    assert isinstance(restart, Lost)
    assert "restarted" in restart.reason


@pytest.mark.parametrize("speed_mps", [0.0, 0.5])
def test_readings_that_come_more_seldom_from_now_on_are_believed_again(speed_mps: float) -> None:
    """From 20 Hz to a reading in 1.5 s, while it stands or drives; before that a restart."""
    made, twist = localizer(), Twist2(speed_mps)
    observed(made, *even_drive(3.0, Twist2(0.5)), at(3.05, Pose2(50.0)))

    answers = observed(made, *[at(4.55 + 1.5 * i, Pose2(50.0) @ twist.after(1.5 * i)) for i in range(30)])

    assert all(isinstance(answer, Motion) for answer in answers[10:])


def test_a_lost_reading_and_stamps_of_arrival_change_nothing() -> None:
    """One, two or three in a row are lost; a sigma is that of the same way in one step, to the lag of its stamps."""
    frames = even_drive(6.0, Twist2(0.8, 0.0, 0.2))
    kept = [frame for i, frame in enumerate(frames) if i % 10 not in (4, 5, 6) or i < 20]

    steps = observed(localizer(), *kept)
    whole = observed(localizer(), *frames)

    assert all(isinstance(step, Motion) for step in steps)
    assert sum(sigmas(step)[0] ** 2 for step in steps) == pytest.approx(
        sum(sigmas(step)[0] ** 2 for step in whole), rel=0.02
    )


def test_a_distance_across_a_gap_is_held_against_the_speed_too() -> None:
    frames = [at(0.1 * i, distance_m=0.05 * i) for i in range(31)]
    made = localizer(unmeasured_turn_deg=None)
    observed(made, *frames)

    (counted,) = observed(made, at(7.0, distance_m=3.4))
    (missing,) = observed(made, at(11.0, distance_m=3.41))

    assert not counted.is_guess
    assert missing.is_guess
    assert counted.information[0, 0] == pytest.approx(1.0 / 0.1**2, rel=0.5)
    assert missing.information[0, 0] < 1.0 / 1.9**2


@pytest.mark.parametrize("kind", ["misses", "restarts"])
@pytest.mark.parametrize("speed_mps", [0.5, 2.0])
@pytest.mark.parametrize("gap_s", [0.5, 1.9, 6.0])
def test_a_belief_behind_a_gap_is_never_sure_and_a_laser_that_saw_it_is_heard(
    kind: str, speed_mps: float, gap_s: float
) -> None:
    for with_laser in (False, True):
        worst, sigma_m, error_m = _drive_with_gap(kind, speed_mps, gap_s, with_laser=with_laser)

        assert worst < 4.0
        if with_laser:
            way_m = speed_mps * (8.0 + gap_s)
            assert error_m < 0.03 * way_m
            assert sigma_m < 0.04 * way_m


def _drive_with_gap(kind: str, speed_mps: float, gap_s: float, *, with_laser: bool) -> tuple[float, float, float]:
    """Return the largest error in sigmas, and sigma and error of the position at the end of 4 s, a gap and 4 s."""
    rng, made, kalman = np.random.default_rng(4), localizer(), Kalman(KalmanConfig())
    kalman.start(Session(start_pose=Pose2()))
    twist, dt_s, worst = Twist2(speed_mps, 0.0, 0.1), 0.05, 0.0
    pose, sigma_m, error_m = Pose2(), 0.0, 0.0
    last = round((8.0 + gap_s) / dt_s)
    observed(made, at(0.0, pose))
    for i in range(1, last + 1):
        stamp_s, truth = round(i * dt_s, 9), twist.after(i * dt_s)
        is_heard = not 4.0 < stamp_s < 4.0 + gap_s - 1e-9
        is_first = is_heard and abs(stamp_s - 4.0 - gap_s) < 1e-6
        if is_first and kind == "restarts":
            pose = Pose2()
        elif is_heard and not is_first:
            pose = pose @ Pose2.from_array(twist.after(dt_s).array() + rng.normal(0.0, (1e-3, 5e-4, 1e-3)))
        if is_heard:
            for answer in observed(made, at(stamp_s, pose)):
                kalman.apply("wheels", answer)
        if with_laser and i % 4 == 0:
            way = Pose2.from_array(twist.after(4 * dt_s).array() + rng.normal(0.0, (3e-3, 3e-3, 2e-3)))
            laser = Motion(round((i - 4) * dt_s, 9), stamp_s, way, information_from_sigmas(3e-3, 3e-3, 2e-3))
            kalman.apply("laser", laser)
        belief = kalman.belief(stamp_s)
        assert belief.pose_map_base is not None
        assert belief.covariance is not None
        error_m = math.hypot(belief.pose_map_base.x - truth.x, belief.pose_map_base.y - truth.y)
        sigma_m = math.sqrt((belief.covariance[0, 0] + belief.covariance[1, 1]) / 2.0)
        worst = max(worst, error_m / sigma_m if error_m > 0.02 else 0.0)
    return worst, sigma_m, error_m


def test_a_heartbeat_is_no_gap() -> None:
    """Robots that log a reading a second while nothing changes."""
    beats = observed(localizer(), *[at(float(i), Pose2(0.1 * i)) for i in range(4)])

    assert all(sigmas(motion).max() < 0.05 for motion in beats)


def test_fixes_after_a_gap_in_which_the_robot_turned_are_believed() -> None:
    """The robot turns by 85 deg while no odometry comes; the next pose is restated as if it had turned by 4."""
    kalman = Kalman(KalmanConfig())
    kalman.start(Session(start_pose=Pose2()))
    made = OdometryLocalizer(OdometryConfig(wheels="wheels"))
    made.start(Session())
    poses = [*((0.1 * i, Pose2(0.05 * i)) for i in range(21)), (5.2, Pose2(1.0, 0.0, math.radians(-4.0)))]
    for stamp_s, pose in poses:
        for motion in made.observe(Frame("wheels", stamp_s, Odometry(pose)), Belief(stamp_s)):
            kalman.apply("wheels", motion)
    truth = Pose2(1.0, 0.0, math.radians(85.0))

    statuses = [
        kalman.apply("laser", Fix(5.2, truth, information_from_sigmas(0.02, 0.02, 0.01 * (1 + k)))).status
        for k in range(2)
    ]

    belief = kalman.belief(5.2).pose_map_base
    assert belief is not None
    assert statuses == ["accepted", "accepted"]
    assert abs(belief.theta - truth.theta) < 0.02
