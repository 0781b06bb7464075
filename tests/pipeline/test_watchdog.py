"""A loop that stands still in real time: another thread stops the robot, and it stays stopped until the loop lives."""

from __future__ import annotations

import threading
import time

import pytest

from trailmark.clock import RunClock, SystemClock
from trailmark.commands import Stop, Velocity
from trailmark.config import StopWhen
from trailmark.errors import RunError
from trailmark.interfaces import Sink
from trailmark.pipeline import Pipeline
from trailmark.pipeline.control.robot import Robot
from trailmark.pipeline.control.watchdog import Watchdog

STALL_S = 0.15


def robot_of(fakes, n: int = 12):
    """Return a robot that notes when it is told what, by which thread."""

    class Noting(fakes.ToyRobot):
        def drive(self, command):
            self.notes.append((time.monotonic(), threading.current_thread().name, command))
            super().drive(command)

    robot = Noting(n)
    robot.notes = []
    return robot


def sleeping_at(i: int, seconds_s: float = 4 * STALL_S):
    """Return what a localizer says that takes long at one frame."""
    seen = []

    def say(frame, belief):
        seen.append(frame)
        if len(seen) == i:
            time.sleep(seconds_s)
        return ()

    return say


def run(fakes, robot, say=lambda frame, belief: (), *, pace="realtime", stall_s=STALL_S, **more):
    """Run a robot in real time, and return the pipeline after its end."""
    parts = fakes.parts(
        {"robot": robot},
        {"vo": fakes.Scripted(say)},
        controller=fakes.Chaser(1e9),
        pace=pace,
        stop_when=StopWhen(stall_s=stall_s),
        **more,
    )
    pipeline = Pipeline(parts)
    steps = list(pipeline)
    return pipeline, steps


def test_the_robot_is_stopped_while_a_localizer_thinks(fakes, caplog) -> None:
    robot = robot_of(fakes)

    pipeline, _ = run(fakes, robot, sleeping_at(4))

    stops = [i for i, (_, thread, command) in enumerate(robot.notes) if thread == "watchdog"]
    assert len(stops) == 1
    assert isinstance(robot.notes[stops[0]][2], Stop)
    before_s, stopped_s, after_s = (robot.notes[stops[0] + k][0] for k in (-1, 0, 1))
    assert STALL_S <= stopped_s - before_s < 3 * STALL_S
    assert after_s - before_s > 4 * STALL_S
    assert robot.notes[stops[0] + 1][2] == Velocity(1.0)  # the loop lives: it is driven on
    assert pipeline.result.status == "done"
    assert pipeline.result.counters["control.stall_stops"] == 1
    assert "the run has stood still for 0." in caplog.text
    assert "in say, test_watchdog.py line" in caplog.text
    assert "the run goes on" in caplog.text


def test_the_step_that_comes_back_says_stop_and_sinks_hear_it(fakes) -> None:
    class Ear(Sink):
        def on_command(self, stamp_s, command):
            heard.append(command)

    heard: list[object] = []
    robot = robot_of(fakes)

    _, steps = run(fakes, robot, sleeping_at(4), sinks={"ear": Ear(None)})

    commands = [step.command for step in steps if step.command is not None]
    stop = next(command for command in commands if isinstance(command, Stop))
    assert "stood still for 0." in stop.reason
    assert "stop_when.stall_s: 0.15" in stop.reason
    assert stop in heard
    following = commands[commands.index(stop) + 1]
    assert following == Velocity(1.0)


def test_a_command_that_was_in_work_meanwhile_does_not_reach_the_robot(fakes) -> None:
    """The controller hangs: what it says then is about where the robot was long ago."""

    class Slow(fakes.Chaser):
        def step(self, belief):
            self.n = getattr(self, "n", 0) + 1
            if self.n == 4:
                time.sleep(4 * STALL_S)
                return Velocity(-9.0)
            return Velocity(1.0)

    robot = robot_of(fakes)
    parts = fakes.parts({"robot": robot}, controller=Slow(1.0), pace="realtime", stop_when=StopWhen(stall_s=STALL_S))

    list(Pipeline(parts))

    told = [command for _, _, command in robot.notes]
    assert Velocity(-9.0) not in told
    assert sum(thread == "watchdog" for _, thread, _ in robot.notes) == 1
    assert told[-2:-1] == [Velocity(1.0)]


def test_a_driver_that_hangs_is_given_stop_beside_its_call(fakes, caplog) -> None:
    class Stuck(fakes.ToyRobot):
        notes = ()
        n = 0

        def drive(self, command):
            self.notes = (*self.notes, (threading.current_thread().name, command))
            self.n += 1
            if self.n == 3:
                time.sleep(4 * STALL_S)

    robot = Stuck(8)

    run(fakes, robot)

    assert robot.notes[2] == ("MainThread", Velocity(1.0))  # which hangs
    assert robot.notes[3][0] == "watchdog"
    assert isinstance(robot.notes[3][1], Stop)
    assert robot.notes[4] == ("MainThread", robot.notes[3][1])  # the call may have come through after the stop
    assert "has not come back from its last command" in caplog.text


def test_a_slow_first_frame_loses_nothing(fakes) -> None:
    """Kernels compile, a device wakes: nobody has told the robot to move yet."""
    robot = robot_of(fakes)

    pipeline, _ = run(fakes, robot, sleeping_at(1))

    assert "control.stall_stops" not in pipeline.result.counters
    assert not [thread for _, thread, _ in robot.notes if thread == "watchdog"]
    assert pipeline.result.status == "done"


@pytest.mark.parametrize(("pace", "stall_s"), [("step", STALL_S), ("realtime", None)])
def test_nobody_watches_in_step_pace_or_when_it_is_switched_off(fakes, pace: str, stall_s: float | None) -> None:
    robot = robot_of(fakes, 6)

    pipeline, _ = run(fakes, robot, sleeping_at(4), pace=pace, stall_s=stall_s)

    assert "control.stall_stops" not in pipeline.result.counters
    assert {thread for _, thread, _ in robot.notes} == {"MainThread"}


def test_waiting_for_the_next_frame_is_no_stall(fakes) -> None:
    """Frames that are due later than the limit: the loop waits, and would hear of everything."""
    robot = robot_of(fakes, 4)

    pipeline, _ = run(fakes, robot, stall_s=0.04)  # frames come every 0.1 s

    assert "control.stall_stops" not in pipeline.result.counters


def test_a_program_that_leaves_its_loop_alone_has_its_robot_stopped(fakes) -> None:
    robot = robot_of(fakes)
    parts = fakes.parts(
        {"robot": robot}, controller=fakes.Chaser(1e9), pace="realtime", stop_when=StopWhen(stall_s=STALL_S)
    )

    with Pipeline(parts) as pipeline:
        for _ in range(3):
            next(pipeline)
        time.sleep(3 * STALL_S)

        assert robot.notes[-1][1] == "watchdog"
        assert isinstance(robot.notes[-1][2], Stop)


class TestRobot:
    """What reaches a drivable, from which thread ever."""

    def test_while_it_is_held_only_stop_reaches_it(self, fakes) -> None:
        toy = fakes.ToyRobot()
        robot = Robot(toy)
        robot.drive(Velocity(1.0))
        robot.hold(Stop("held"))
        robot.drive(Velocity(2.0))
        robot.drive(Stop("mine"))
        robot.release()
        robot.drive(Velocity(3.0))

        assert toy.commands == [Velocity(1.0), Stop("held"), Stop("mine"), Velocity(3.0)]

    def test_what_is_over_is_not_released(self, fakes) -> None:
        toy = fakes.ToyRobot()
        robot = Robot(toy)
        robot.hold(Stop("over"), for_good=True)
        robot.hold(Stop("still"))

        assert not robot.release()
        robot.drive(Velocity(1.0))
        assert toy.commands == [Stop("over")]  # it may be closed by now

    def test_a_robot_that_does_not_take_stop_is_told_again(self, fakes, caplog) -> None:
        class Deaf(fakes.ToyRobot):
            n = 0

            def drive(self, command):
                self.n += 1
                if 1 < self.n < 4:
                    raise OSError("no answer")
                super().drive(command)

        toy = Deaf()
        robot = Robot(toy)
        clock = RunClock(SystemClock())
        robot.drive(Velocity(1.0))
        watchdog = Watchdog(robot, clock, 0.05)
        watchdog.start()
        until_s = time.monotonic() + 5.0
        while robot.is_under_way and time.monotonic() < until_s:
            time.sleep(0.01)
        watchdog.close()

        assert isinstance(toy.commands[-1], Stop)
        assert caplog.text.count("no answer") == 2

    def test_a_stop_that_fails_is_an_error_of_the_run(self, fakes) -> None:
        class Deaf(fakes.ToyRobot):
            def drive(self, command):
                raise OSError("serial port closed")

        with pytest.raises(RunError, match=r"the robot failed in drive\(Stop.*OSError: serial port closed"):
            Robot(Deaf()).hold(Stop("held"))
