"""The guard stops a robot that nothing tells where it is."""

from __future__ import annotations

import math

from trailmark.commands import Stop, Velocity
from trailmark.config import StopWhen
from trailmark.estimates import Belief, Fix
from trailmark.geometry import Pose2
from trailmark.pipeline import Pipeline
from trailmark.pipeline.control import Guard


def test_no_limit_no_guard() -> None:
    assert not StopWhen().limits_belief
    assert StopWhen(fix_age_m=1.0).limits_belief
    assert StopWhen(motion_age_s=1.0).limits_belief
    assert Guard(StopWhen()).check(Belief(0.0)) is None


def test_a_fix_that_is_too_far_back_stops() -> None:
    guard = Guard(StopWhen(fix_age_m=1.0))

    assert guard.check(Belief(0.0, fix_age_m=1.0)) is None
    assert guard.check(Belief(0.0, fix_age_m=1.1)) == Stop("no absolute estimate for 1.10 m (stop_when.fix_age_m: 1)")


def test_motion_that_is_too_old_stops_until_it_is_back() -> None:
    guard = Guard(StopWhen(motion_age_s=0.3), give_up_s=1.0)

    assert guard.check(Belief(1.0, motion_age_s=0.4)) == Stop("no motion for 0.40 s (stop_when.motion_age_s: 0.3)")
    assert guard.check(Belief(1.5, motion_age_s=0.0)) is None
    assert not guard.has_given_up(9.0)


def test_before_the_first_fix_and_motion_way_and_time_count_from_the_start() -> None:
    guard = Guard(StopWhen(fix_age_m=1.0, motion_age_s=0.3))

    assert guard.check(Belief(10.0, fix_age_m=math.inf, motion_age_s=math.inf)) is None
    assert guard.check(Belief(10.2, travelled_m=0.9, fix_age_m=math.inf, motion_age_s=math.inf)) is None
    assert guard.check(Belief(10.4, travelled_m=0.9, fix_age_m=math.inf, motion_age_s=math.inf)) is not None
    assert guard.check(Belief(10.2, travelled_m=1.1, fix_age_m=math.inf, motion_age_s=0.0)) is not None


def test_a_live_robot_waits_for_motion_where_nobody_wrote_a_limit(caplog) -> None:
    guard = Guard(StopWhen(), give_up_s=1.0, is_live=True)

    assert guard.check(Belief(0.0, motion_age_s=0.5)) is None
    assert guard.check(Belief(1.0, motion_age_s=0.6)) == Stop("no motion for 0.60 s")
    assert guard.check(Belief(9.0, motion_age_s=8.6)) == Stop("no motion for 8.60 s")
    assert not guard.has_given_up(9.0)  # the camera may be plugged in again
    assert guard.check(Belief(9.1, motion_age_s=0.0)) is None
    assert [record.message for record in caplog.records] == [
        "no motion for 0.60 s: the robot stands until one is measured again; for another limit than 0.5 s, or null for"
        " none, write stop_when: {motion_age_s: ...}"
    ]


def test_a_live_robot_that_is_led_by_fixes_alone_or_as_the_config_says_does_not_wait() -> None:
    assert Guard(StopWhen(), is_live=True).check(Belief(9.0, motion_age_s=math.inf)) is None
    assert Guard(StopWhen(motion_age_s=None), is_live=True).check(Belief(9.0, motion_age_s=8.0)) is None
    assert Guard(StopWhen(motion_age_s=9.0), is_live=True).check(Belief(9.0, motion_age_s=8.0)) is None
    assert Guard(StopWhen()).check(Belief(9.0, motion_age_s=8.0)) is None


def test_the_guard_overrules_the_controller_and_lets_it_go_on(fakes) -> None:
    def say(frame, belief):  # motion pauses between 0.5 s and 1.5 s
        return () if 0.5 < frame.stamp_s < 1.5 else mover.observe(frame, belief)

    mover = fakes.Mover(Pose2(0.1))
    source = fakes.Recording(fakes.image_frames("cam", [i / 10 for i in range(21)]))
    chaser = fakes.Chaser(1e9)
    pipeline = Pipeline(
        fakes.parts(
            {"cam": source}, {"vo": fakes.Scripted(say)}, controller=chaser, stop_when=StopWhen(motion_age_s=0.3)
        )
    )

    commands = {round(step.stamp_s, 1): step.command for step in pipeline}

    assert commands[0.8] == Velocity(1.0)
    assert isinstance(commands[0.9], Stop)
    assert isinstance(commands[1.4], Stop)
    assert commands[1.5] == Velocity(1.0)
    assert pipeline.result.status == "done"
    assert pipeline.result.counters["control.guard_stops"] == 6


def test_a_robot_that_stays_stopped_ends_the_run(fakes) -> None:
    robot = fakes.ToyRobot(1000)
    fix_once = fakes.Scripted(lambda frame, belief: () if frame.stamp_s else (Fix(0.0, Pose2(), fakes.GOOD),))
    parts = fakes.parts(
        {"robot": robot},
        {"vo": fakes.Mover(Pose2(0.1)), "map": fix_once},
        controller=fakes.Chaser(1e9),
        stop_when=StopWhen(fix_age_m=0.55),
    )
    pipeline = Pipeline(parts)

    steps = list(pipeline)

    assert pipeline.result.status == "stopped"
    assert "no absolute estimate" in pipeline.result.reason
    assert steps[-1].stamp_s < 11.0  # 0.6 s of driving and ten seconds of patience
    assert isinstance(robot.commands[-1], Stop)
