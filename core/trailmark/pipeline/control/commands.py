"""Commands of the controller and of the guard, on their way to the robot."""

from __future__ import annotations

import logging
import math
from time import perf_counter_ns
from typing import Literal

from trailmark.clock import RunClock
from trailmark.commands import Command, Stop
from trailmark.config import StopWhen
from trailmark.errors import ConfigError
from trailmark.estimates import Belief
from trailmark.failures import call_guarded, raise_failure
from trailmark.interfaces import Controller, Drivable
from trailmark.pipeline.control.robot import Robot
from trailmark.pipeline.control.watchdog import Watchdog
from trailmark.pipeline.instruments import Instruments

__all__ = ["Control", "Guard", "check_commands"]

logger = logging.getLogger(__name__)

# Differences of stamps and sums of steps: at the limit is not beyond it.
_ROUNDING = 1e-9

# Cameras jitter: a frame that comes this part of a period too early is on time. The beat keeps the mean rate.
_SLACK = 0.25


class Control:
    """Asks the controller, at most `control_hz` times a second, and drives the robot.

    A robot that drives itself is not given the controller's commands, and teaching has none; the guard's `Stop`
    reaches every robot.

    Parameters
    ----------
    controller : Controller or None
        What drives.
    robot : Robot or None
        What is driven; without one, commands go to sinks alone.
    guard : Guard or None
        Stops the robot whatever the controller says.
    control_hz : float
        How often at most [Hz].
    """

    def __init__(
        self,
        controller: Controller | None,
        robot: Robot | None,
        guard: Guard | None,
        control_hz: float,
        instruments: Instruments,
    ) -> None:
        self._controller = controller
        self._robot = robot
        self._guard = guard
        self._period_s = 1.0 / control_hz
        self._counters = instruments.counters
        self._times = instruments.times.stage("controller")
        self._is_suspended = False
        self._due_s = math.inf if controller is None and guard is None else -math.inf

    @property
    def due_s(self) -> float:
        """When the controller may be asked again; ``inf``: never [s]."""
        return self._due_s

    def step(self, belief: Belief) -> Command | None:
        """Return the command for now, already given to the robot; None if it is not time yet."""
        now_s = belief.stamp_s
        if (stop := self._robot_was_held()) is not None:
            self._due_s = self._next_due_s(now_s)
            return stop
        if now_s + _SLACK * self._period_s < self._due_s:
            return None
        self._due_s = self._next_due_s(now_s)
        command: Command | None = None if self._guard is None else self._guard.check(belief)
        if command is not None:
            self._counters["control.guard_stops"] += 1
        elif self._controller is not None:
            command = self._ask(self._controller, belief)
        if command is not None:
            self.drive(command)
        return self._robot_was_held() or command

    def _robot_was_held(self) -> Stop | None:
        """Return the `Stop` that another thread gave meanwhile; the watchdog's holds until the next step only."""
        if self._robot is None or (stop := self._robot.held_by) is None:
            return None
        if not self._is_suspended and self._robot.release():
            self._counters["control.stall_stops"] += 1
            logger.warning("the run goes on; from its next step on the robot is commanded again")
        return stop

    def drive(self, command: Command) -> None:
        """Give a command to the robot, if there is one."""
        if self._robot is not None:
            self._robot.drive(command)

    def new_watchdog(self, clock: RunClock, stall_s: float) -> Watchdog | None:
        """Return what stops the robot when the loop stands still; None where nothing is driven by the loop."""
        if self._robot is None or self._controller is None:
            return None
        return Watchdog(self._robot, clock, stall_s)

    def hold(self, reason: str) -> None:
        """Stop the robot, if there is one, until `release`: the process is going to be suspended. Any thread."""
        if self._robot is not None:
            self._is_suspended = True  # the loop may take a step or two before everything stands
            self._robot.hold(Stop(reason))

    def release(self) -> None:
        """Let the loop's next step release the robot. Any thread."""
        self._is_suspended = False

    def stop_for_good(self, reason: str) -> None:
        """Stop the robot, if there is one: the run is over. Any thread."""
        if self._robot is not None:
            self._robot.hold(Stop(reason), for_good=True)

    def end_by(self, command: Command, now_s: float) -> tuple[Literal["done", "stopped"], str] | None:
        """Return how a command ends the run, and why: the goal is reached, or the robot was stopped for too long."""
        if not isinstance(command, Stop):
            return None
        if command.done:
            return "done", command.reason
        has_given_up = self._robot is not None and self._guard is not None and self._guard.has_given_up(now_s)
        return ("stopped", command.reason) if has_given_up else None

    def _next_due_s(self, now_s: float) -> float:
        """Keep to the beat, so that the mean rate is right; after a pause begin a new one."""
        on_beat_s = self._due_s + self._period_s
        return on_beat_s if on_beat_s > now_s else now_s + self._period_s

    def _ask(self, controller: Controller, belief: Belief) -> Command:
        began_ns = perf_counter_ns()
        try:
            command = controller.step(belief)
            if not isinstance(command, Command):
                raise TypeError(f"it returned {type(command).__name__}, not a command")
        except BaseException as error:
            raise_failure(error, "the controller", f"step at {belief.stamp_s:.6f} s", keeps=())
        self._times.append(perf_counter_ns() - began_ns)
        self._counters["control.commands"] += 1
        return command


def check_commands(controller: Controller, drivable: Drivable) -> None:
    """Refuse a controller that gives commands which the robot does not understand.

    Raises
    ------
    ConfigError
        Naming the commands.
    """
    given = call_guarded("the controller", "gives", lambda: frozenset(controller.gives))
    accepted = call_guarded("the robot", "accepts", lambda: frozenset(drivable.accepts))
    foreign = given - accepted - {Stop}
    if foreign:
        gives, accepts = _names(foreign), _names(accepted)
        remedy = call_guarded("the controller", "remedy_for", lambda: controller.remedy_for(accepted))
        raise ConfigError(
            f"controller: {type(controller).__name__} gives {gives}, but the robot takes {accepts or 'no command'};"
            f" {remedy or 'choose a controller for this robot'}"
        )


def _names(commands: frozenset[type[Command]]) -> str:
    return ", ".join(sorted(command.__name__ for command in commands))


class Guard:
    """Says `Stop` while the belief is older than ``stop_when`` allows, whatever the controller says.

    Before the first absolute estimate the way counts from the start, and before the first motion the time does:
    a robot that starts without a fix may drive the same way to find one. A limit of motion that nobody wrote counts
    from the first motion on, for some robots are led by fixes alone, and ends no run: it waits for the next motion.

    Parameters
    ----------
    stop_when : StopWhen
        The limits.
    give_up_s : float
        A robot that was stopped for so long will not find itself any more: the run ends [s].
    is_live : bool
        Whether a controller drives a real robot, which motion has to be fresh for even where nobody wrote a limit.
    """

    def __init__(self, stop_when: StopWhen, give_up_s: float = 10.0, is_live: bool = False) -> None:
        self._stop_when = stop_when
        self._live_limit_s = stop_when.live_motion_age_s if is_live else None
        self._has_told = False
        self._give_up_s = give_up_s
        self._start: Belief | None = None
        self._stopped_s: float | None = None

    def check(self, belief: Belief) -> Stop | None:
        """Return why the robot has to stop; None while all is well."""
        if self._start is None:
            self._start = belief
        reason = self._too_old(belief, self._start)
        if reason is None:
            self._stopped_s = None
            return self._wait_for_motion(belief)
        self._stopped_s = belief.stamp_s if self._stopped_s is None else self._stopped_s
        return Stop(reason)

    def has_given_up(self, now_s: float) -> bool:
        """Return whether the robot has been stopped for too long."""
        return self._stopped_s is not None and now_s - self._stopped_s > self._give_up_s

    def _wait_for_motion(self, belief: Belief) -> Stop | None:
        """Return why a live robot stands until it is known again how it moves; None while that is known."""
        limit_s, age_s = self._live_limit_s, belief.motion_age_s
        if limit_s is None or not math.isfinite(age_s) or age_s <= limit_s + _ROUNDING:
            return None
        reason = f"no motion for {age_s:.2f} s"
        if not self._has_told:
            logger.warning(
                "%s: the robot stands until one is measured again; for another limit than %g s, or null for none, write"
                " stop_when: {motion_age_s: ...}",
                reason,
                limit_s,
            )
            self._has_told = True
        return Stop(reason)

    def _too_old(self, belief: Belief, start: Belief) -> str | None:
        fix_limit_m, motion_limit_s = self._stop_when.fix_age_m, self._stop_when.motion_age_s
        if fix_limit_m is not None:
            way_m = belief.fix_age_m if math.isfinite(belief.fix_age_m) else belief.travelled_m - start.travelled_m
            if way_m > fix_limit_m + _ROUNDING:
                return f"no absolute estimate for {way_m:.2f} m (stop_when.fix_age_m: {fix_limit_m:g})"
        if motion_limit_s is not None:
            age_s = belief.motion_age_s if math.isfinite(belief.motion_age_s) else belief.stamp_s - start.stamp_s
            if age_s > motion_limit_s + _ROUNDING:
                return f"no motion for {age_s:.2f} s (stop_when.motion_age_s: {motion_limit_s:g})"
        return None
