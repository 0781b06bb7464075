"""The drive of a calibration: from a config to the motions of its camera."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from trailmark.commands import Command, Steer4WS, Stop, Velocity
from trailmark.config import RunConfig, SensorOverride
from trailmark.errors import ConfigError, DataError
from trailmark.estimates import Belief, Lost, Motion
from trailmark.frames import Frame, GroundPlane, SensorInfo
from trailmark.geometry import Pose3
from trailmark.interfaces import Drivable, Session
from trailmark.pipeline import SourceStream, build_sources
from trailmark_ground_vo.calibration import Assumed, Steps
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.localizer import GroundVO

__all__ = ["ObservedDrive", "Speeds", "observe_drive"]

#: Time to stand still before, between and after moves when the command drives [s].
_PAUSE_S = 0.8


#: Takes the time between the last two pictures, gives the next command; None is the end.
_Orders = Generator[Command | None, float, None]


@dataclass(frozen=True, slots=True)
class Speeds:
    """How the command drives a robot that it may drive.

    Attributes
    ----------
    distance_m : float
        Straight ahead; negative backwards [m].
    turn_rad : float
        In place, counter-clockwise; 0: no turn [rad].
    speed_mps, turn_radps : float
        How fast.
    """

    distance_m: float
    turn_rad: float
    speed_mps: float = 0.2
    turn_radps: float = 0.5


@dataclass(frozen=True, slots=True)
class ObservedDrive:
    """What the camera saw.

    Attributes
    ----------
    sensor : SensorInfo
        The camera, as the config has it.
    assumed : Assumed
        Scales that the motions are in.
    steps : Steps
        The motions.
    n_pictures : int
        Pictures.
    lost : mapping of str to int
        How many of them fitted to none, by the reason, the most frequent one first.
    """

    sensor: SensorInfo
    assumed: Assumed
    steps: Steps
    n_pictures: int
    lost: Mapping[str, int]


def observe_drive(
    config: RunConfig,
    camera: str | None,
    drive: Speeds | None,
    say: Callable[[str], None],
    accept: Callable[[SensorInfo], None] = lambda _: None,
) -> ObservedDrive:
    """Play the source of a config, drive the robot if that is asked for, and return the motions of its camera.

    Parameters
    ----------
    config : RunConfig
        Its first source that has the camera is played.
    camera : str or None
        Name of the camera; None: the only one.
    drive : Speeds or None
        How to drive; None: somebody else does.
    say : callable
        Is told what the robot does.
    accept : callable
        Is told the camera before anything moves; what it raises ends the command.

    Raises
    ------
    ConfigError
        If there is no such camera, or nothing that could be driven.
    DataError
        If no picture fits to the one before, or the pictures end before a drive that was asked for is over.
    KeyboardInterrupt
        If a drive that was asked for is interrupted: less than the distance would be taken for it.
    """
    sources = build_sources(config)
    if not sources:
        raise ConfigError("the config has no source: a recording, a camera or a simulated world")
    source, sensor = _start_source(sources, config.sensors, camera)
    try:
        accept(sensor)
        return _observe_drive(source, sensor, drive, say)
    finally:
        source.close()


def _start_source(
    sources: Sequence[SourceStream], overrides: Mapping[str, SensorOverride], camera: str | None
) -> tuple[SourceStream, SensorInfo]:
    """Start the source that has the camera; all others are left alone."""
    known = []
    for source in sources:
        source.start(Session(name=source.name, mode="replay"))
        cameras = [info for info in source.known_sensors(overrides).values() if info.kind == "image"]
        fitting = [info for info in cameras if camera in (None, info.name)]
        if len(fitting) == 1:
            return source, fitting[0]
        source.close()
        known += [info.name for info in cameras]
    if camera is None and len(known) > 1:
        raise ConfigError(f"there are several cameras: {', '.join(known)}; say which with --camera")
    raise ConfigError(f"no camera {camera or ''!r}; there are: {', '.join(known) or 'none'}")


def _observe_drive(
    source: SourceStream, sensor: SensorInfo, drive: Speeds | None, say: Callable[[str], None]
) -> ObservedDrive:
    plane = sensor.calibration
    if plane is not None and not isinstance(plane, GroundPlane):
        raise ConfigError(f"sensor {sensor.name!r} is calibrated as a {type(plane).__name__}, not as a ground camera")
    plane = plane or GroundPlane((1.0, 1.0))
    localizer = GroundVO(GroundVOConfig.model_validate({"camera": sensor.name}))
    bare = replace(sensor, pose_base_sensor=Pose3(), calibration=plane)
    localizer.start(Session(name="calibrate", sensors={sensor.name: bare}))
    rows, n_pictures, lost = [], 0, Counter[str]()
    with suppress(*([KeyboardInterrupt] if drive is None else [])):  # Ctrl-C ends a drive by hand
        for frame in _frames(source, sensor, drive, say):
            n_pictures += 1
            for estimate in localizer.observe(frame, Belief(frame.stamp_s)):
                if isinstance(estimate, Motion):
                    pose, covariance = estimate.pose_since_now, np.linalg.pinv(estimate.information)
                    variance = float(covariance[0, 0] + covariance[1, 1]) / 2.0
                    rows.append((estimate.since_s, frame.stamp_s, pose.x, pose.y, pose.theta, variance))
                if isinstance(estimate, Lost):
                    lost[estimate.reason] += 1
    reasons = dict(lost.most_common())
    if not rows:
        why = f": {next(iter(reasons))}" if reasons else ""
        raise DataError(f"{n_pictures} pictures of {sensor.name!r}, and no two of them fit together{why}")
    return ObservedDrive(sensor, Assumed(plane.metres_per_pixel), Steps(*np.array(rows).T), n_pictures, reasons)


def _frames(
    source: SourceStream, sensor: SensorInfo, drive: Speeds | None, say: Callable[[str], None]
) -> Iterator[Frame]:
    """Yield the pictures of the camera; on the way, drive."""
    robot = source.drivable
    if drive is None:
        yield from (frame for frame in source.frames() if frame.sensor == sensor.name)
        return
    if robot is None or robot.drives_itself:
        raise ConfigError(
            f"source {source.name!r} cannot be driven by commands; leave --drive out and drive it yourself"
        )
    last_s: float | None = None
    orders: _Orders | None = None
    for frame in source.frames():
        if frame.sensor != sensor.name:
            continue
        yield frame
        if orders is None:
            orders = _orders(robot, drive, say)
            next(orders)
        elif last_s is not None:
            command = orders.send(frame.stamp_s - last_s)
            if command is None:
                return
            robot.drive(command)
        last_s = frame.stamp_s
    raise DataError(
        f"the pictures of {sensor.name!r} ended before the drive was over: nothing was measured; let the simulation"
        " last longer (its duration_s), or look why the camera stopped"
    )


def _orders(robot: Drivable, drive: Speeds, say: Callable[[str], None]) -> _Orders:
    """Take the time between two pictures, give the command for the next: in sum exactly the distance and the turn."""
    straight: Callable[[float], Command]
    if Velocity in robot.accepts:
        straight = lambda speed: Velocity(speed)  # noqa: E731
    elif Steer4WS in robot.accepts:
        straight = lambda speed: Steer4WS(0.0, 0.0, speed)  # noqa: E731
    else:
        raise ConfigError("the robot takes neither velocities nor steering angles")
    still = Stop("calibration: stand still")
    yield from _during(_PAUSE_S, lambda _: still)
    say(f"driving {drive.distance_m:g} m")
    yield from _amount(drive.distance_m, drive.speed_mps, straight)
    yield from _during(_PAUSE_S, lambda _: straight(0.0))
    if drive.turn_rad and Velocity in robot.accepts:
        say(f"turning by {math.degrees(drive.turn_rad):.0f} deg")
        yield from _amount(drive.turn_rad, drive.turn_radps, lambda rate: Velocity(0.0, 0.0, rate))
        yield from _during(_PAUSE_S, lambda _: straight(0.0))
    elif drive.turn_rad:
        say("this vehicle cannot turn in place: the lever arm stays as it is")
    yield None


def _during(time_s: float, command: Callable[[float], Command]) -> _Orders:
    dt_s = yield command(0.0)
    while time_s > 0.0:
        time_s -= dt_s
        dt_s = yield command(0.0)


def _amount(amount: float, rate: float, command: Callable[[float], Command]) -> _Orders:
    """Yield commands whose rates times their time sum up to `amount`, the last one slower to fit."""
    left, sign = abs(amount), math.copysign(1.0, amount)
    dt_s = yield command(0.0)
    while left > 1e-9:
        now = min(rate, left / dt_s)
        left -= now * dt_s
        dt_s = yield command(sign * now)
