"""Twenty-one mistakes that are made when a part is written: the kit catches every one.

Each is a localizer or a source that is right but for one thing; beside it stands the check that finds it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

import numpy as np
import pytest

from trailmark.config import PluginConfig, Sensor
from trailmark.errors import ShapeError
from trailmark.estimates import Belief, Estimate, Fix, Lost, Motion, information_from_sigmas
from trailmark.frames import Frame, Imu, Odometry, SensorInfo
from trailmark.geometry import Pose2, Trajectory
from trailmark.interfaces import FrameSource, Localizer, Session
from trailmark.testing import SyntheticRun, imu_run, localizer_checks, odometry_run, pose_run, source_checks

RUN = odometry_run(n_frames=60)
INFORMATION = information_from_sigmas(0.01, 0.01, 0.01)
ON_BASE = Pose2(0.3, 0.1, 0.5)


class Config(PluginConfig):
    """A config."""

    sensor: Sensor["odometry"]
    """What it looks at."""


class Right(Localizer):
    """Says the motion that odometry tells."""

    def start(self, session: Session) -> None:
        self.last: tuple[float, Pose2] | None = None

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        assert isinstance(frame.payload, Odometry)
        pose = frame.payload.pose_start_base
        assert pose is not None
        last, self.last = self.last, (frame.stamp_s, pose)
        return () if last is None else self.answer(last, frame, last[1].between(pose))

    def answer(self, last: tuple[float, Pose2], frame: Frame, step: Pose2) -> Sequence[Estimate]:
        return (Motion(last[0], frame.stamp_s, self.worsen(step), self.information()),)

    def worsen(self, step: Pose2) -> Pose2:
        return step

    def information(self) -> np.ndarray:
        return INFORMATION


class Late(Right):
    def answer(self, last, frame, step):
        return (Motion(last[0] + 0.02, frame.stamp_s + 0.02, step, INFORMATION),)


class Humble(Right):
    def information(self):
        return INFORMATION / 200.0**2


class Certain(Right):
    def worsen(self, step):
        return step @ Pose2(0.005)

    def information(self):
        return INFORMATION * 1e4


class ClassState(Right):
    kept: ClassVar[list[tuple[float, Pose2]]] = []

    def start(self, session):
        ClassState.kept.clear()

    def observe(self, frame, belief):
        before = ClassState.kept[-1] if ClassState.kept else None
        ClassState.kept.append((frame.stamp_s, frame.payload.pose_start_base))
        if before is None or before[0] >= frame.stamp_s:
            return ()
        return (Motion(before[0], frame.stamp_s, before[1].between(ClassState.kept[-1][1]), INFORMATION),)


MODULE_STATE: dict[str, tuple[float, Pose2]] = {}


class GlobalState(Right):
    """Works alone, and mixes up frames when another works beside it."""

    def start(self, session):
        MODULE_STATE.clear()

    def observe(self, frame, belief):
        last = MODULE_STATE.get("last")
        MODULE_STATE["last"] = frame.stamp_s, frame.payload.pose_start_base
        if last is None or last[0] >= frame.stamp_s:
            return ()
        return (Motion(last[0], frame.stamp_s, last[1].between(MODULE_STATE["last"][1]), INFORMATION),)


class Remembering(Right):
    """Is not as new when it is started again."""

    n_starts = 0

    def start(self, session):
        self.n_starts += 1
        super().start(session)

    def worsen(self, step):
        return step @ Pose2(1e-4 * self.n_starts)


class Skewed(Right):
    def information(self):
        skewed = INFORMATION.copy()
        skewed[0, 1] = 3000.0
        return skewed


class Clockwise(Right):
    def worsen(self, step):
        return Pose2(step.x, step.y, -step.theta)


class Degrees(Right):
    def worsen(self, step):
        return Pose2(step.x, step.y, math.degrees(step.theta))


class Millimetres(Right):
    def worsen(self, step):
        return Pose2(1e3 * step.x, 1e3 * step.y, step.theta)


class OfTheSensor(Right):
    """Tells the motion of a sensor that is turned on base for that of base."""

    def worsen(self, step):
        return ON_BASE.inverse() @ step @ ON_BASE

    def information(self):
        return information_from_sigmas(1e-3, 1e-3, 1e-3)


class Dice(Right):
    def worsen(self, step):
        return step @ Pose2(float(np.random.default_rng().normal(0.0, 1e-4)))


class Writing(Right):
    """Changes the picture of its payload that others get, too."""

    def observe(self, frame, belief):
        frame.payload.angular_velocity_radps.base[...] = 0.0
        return ()


class Ahead(Right):
    def answer(self, last, frame, step):
        return (Motion(last[0], frame.stamp_s, step, INFORMATION), Fix(frame.stamp_s + 0.5, Pose2(), INFORMATION))


class Stale(Right):
    def start(self, session):
        super().start(session)
        self.first: Estimate | None = None

    def answer(self, last, frame, step):
        self.first = self.first or Fix(frame.stamp_s, frame.payload.pose_start_base, INFORMATION)
        return (self.first,)


class LostAndSure(Right):
    def answer(self, last, frame, step):
        return (Lost(frame.stamp_s, "no features"), *super().answer(last, frame, step))


class ImuConfig(PluginConfig):
    """A config."""

    sensor: Sensor["imu"]
    """What it looks at."""


@pytest.mark.parametrize(
    ("mistake", "check"),
    [
        (Late, "stamps_are_those_of_the_frames"),
        (Humble, "information_says_something"),
        (Certain, "errors_fit_the_information"),
        (ClassState, "two_instances_share_no_state"),
        (GlobalState, "two_instances_share_no_state"),
        (Remembering, "started_again_is_as_new"),
        (Skewed, "estimates_are_well_formed"),
        (Clockwise, "errors_fit_the_information"),
        (Degrees, "errors_fit_the_information"),
        (Millimetres, "errors_fit_the_information"),
        (OfTheSensor, "errors_fit_the_information"),
        (Dice, "same_seed_same_answers"),
        (Ahead, "answers_are_new"),
        (Stale, "answers_are_new"),
        (LostAndSure, "answers_are_new"),
    ],
)
def test_a_mistake_of_a_localizer_is_caught(mistake: type[Right], check: str) -> None:
    localizer_checks(Right, Config(), RUN)[check]()

    with pytest.raises(AssertionError):
        localizer_checks(mistake, Config(), RUN)[check]()


class PoseConfig(PluginConfig):
    """A config."""

    sensor: Sensor["pose"]
    """What it looks at."""


class Repeating(Localizer):
    """Tells on the poses that it is given, as certain as they are."""

    wider = 1.0

    def start(self, session):
        pass

    def observe(self, frame, belief):
        pose, covariance = (frame.payload.arrays[name] for name in ("pose", "covariance"))
        return (Fix(frame.stamp_s, Pose2(*pose.tolist()), np.linalg.inv(self.wider**2 * covariance)),)


class RepeatingHumbly(Repeating):
    wider = 100.0


def test_fixes_a_hundred_times_too_humble_are_caught_where_the_noise_is_known() -> None:
    run, check = pose_run(), "information_says_something"
    localizer_checks(Repeating, PoseConfig(), run)[check]()

    with pytest.raises(AssertionError, match=r"the sigmas of its fixes are \d+ times its errors"):
        localizer_checks(RepeatingHumbly, PoseConfig(), run)[check]()


def test_a_localizer_that_changes_its_frame_is_caught() -> None:
    with pytest.raises(AssertionError, match="work on a copy"):
        localizer_checks(Writing, ImuConfig(), imu_run(n_frames=20))["frames_are_left_alone"]()


def test_a_run_whose_frames_are_out_of_order_is_caught() -> None:
    with pytest.raises(ShapeError, match="in the order of their stamps"):
        SyntheticRun(RUN.frames[::-1], RUN.sensors, RUN.truth)


# --- sources -----------------------------------------------------------------------------------------------------


class SourceConfig(PluginConfig):
    """A config."""


class Turntable(FrameSource):
    """A gyroscope on a drive whose truth is known."""

    claimed_hz = 100.0

    def __init__(self, config: PluginConfig) -> None:
        super().__init__(config)
        self.run = imu_run(n_frames=100)

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        return {"imu": SensorInfo("imu", "imu", rate_hz=self.claimed_hz)}

    def start(self, session: Session) -> None:
        pass

    def frames(self) -> Iterator[Frame]:
        yield from self.run.frames

    def ground_truth(self) -> Trajectory:
        return self.run.truth


class InDegrees(Turntable):
    def frames(self):
        for frame in super().frames():
            turns = np.degrees(frame.payload.angular_velocity_radps)
            turns.flags.writeable = False
            yield Frame(frame.sensor, frame.stamp_s, Imu(turns))


class Boasting(Turntable):
    claimed_hz = 400.0


class Sharing(Turntable):
    """Two instances take their frames from one queue."""

    queue: ClassVar[Iterator[Frame]] = iter(())

    def start(self, session):
        Sharing.queue = itertools.chain(self.run.frames)

    def frames(self):
        while (frame := next(Sharing.queue, None)) is not None:
            yield frame


@pytest.mark.parametrize(
    ("mistake", "check"),
    [
        (InDegrees, "turn_rates_are_in_radians"),
        (Boasting, "rates_are_as_claimed"),
        (Sharing, "two_instances_share_no_frames"),
    ],
)
def test_a_mistake_of_a_source_is_caught(mistake: type[Turntable], check: str) -> None:
    source_checks(Turntable, SourceConfig())[check]()

    with pytest.raises(AssertionError):
        source_checks(mistake, SourceConfig())[check]()
