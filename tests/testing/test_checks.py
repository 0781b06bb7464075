"""The checks find what they are for: each is shown a part that breaks its rule."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from trailmark.config import PluginConfig, Sensor
from trailmark.estimates import Belief, Estimate, Fix, Lost, Motion, information_from_sigmas
from trailmark.frames import Frame, Image, Odometry
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session
from trailmark.testing import circle, localizer_checks, odometry_run, room_run
from trailmark.testing.checks.parametrize import parametrize

WHEELS = odometry_run(circle(0.3, 1.0), 30)
PICTURES = room_run("image", n_frames=12)
INFORMATION = information_from_sigmas(0.01, 0.01, 0.01)


class Config(PluginConfig):
    """A config."""

    sensor: Sensor["odometry", "image"]
    """What it looks at."""


class Honest(Localizer):
    """Says the motion that odometry tells, and does nothing that it should not."""

    def start(self, session: Session) -> None:
        self.session = session
        self.last: tuple[float, Pose2] | None = None

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        pose = frame.payload.pose_start_base if isinstance(frame.payload, Odometry) else Pose2()
        assert pose is not None
        last, self.last = self.last, (frame.stamp_s, pose)
        return () if last is None else (self.estimate(last, frame, pose),)

    def estimate(self, last: tuple[float, Pose2], frame: Frame, pose: Pose2) -> Estimate:
        return Motion(last[0], frame.stamp_s, last[1].between(pose), INFORMATION)


class Undescribed(PluginConfig):
    """A config whose key says nothing."""

    sensor: Sensor["odometry"]


class Lax(Config, extra="ignore"):
    """A config that takes anything."""


class Silent(Honest):
    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        return ()


class AlwaysLost(Honest):
    def estimate(self, last, frame, pose):
        return Lost(frame.stamp_s, "always")


class Boastful(Honest):
    def estimate(self, last, frame, pose):
        return Motion(last[0], frame.stamp_s, last[1].between(pose) @ Pose2(0.05, 0, 0), INFORMATION * 1e6)


class NotANumber(Honest):
    def estimate(self, last, frame, pose):
        return Fix(frame.stamp_s, Pose2(), np.full((3, 3), np.nan))


class Overlapping(Honest):
    def estimate(self, last, frame, pose):
        return Motion(last[0] - 0.2, frame.stamp_s, Pose2(), INFORMATION)


class Random(Honest):
    def estimate(self, last, frame, pose):
        noise = np.random.default_rng().normal(0, 1e-3)
        return Motion(last[0], frame.stamp_s, last[1].between(pose) @ Pose2(noise, 0, 0), INFORMATION)


class Remembering(Honest):
    """Forgets to forget when it is started again."""

    def start(self, session: Session) -> None:
        self.n_starts = getattr(self, "n_starts", 0) + 1
        super().start(session)

    def estimate(self, last, frame, pose):
        return Motion(last[0], frame.stamp_s, Pose2(0.001 * self.n_starts, 0, 0), INFORMATION)


class Painting(Honest):
    """Writes into the picture through a view that it should not have."""

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        assert isinstance(frame.payload, Image)
        frame.payload.pixels.base[...] = 0
        return (Lost(frame.stamp_s, "painted over"),)


class Hallucinating(Honest):
    """Sees motion in any picture."""

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        return (Fix(frame.stamp_s, Pose2(), INFORMATION),)


class Hoarding(Honest):
    """Keeps every frame."""

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        self.kept = [*getattr(self, "kept", []), np.ones(600_000)]
        return ()


class Opening(Honest):
    def __init__(self, config: PluginConfig) -> None:
        super().__init__(config)
        with open(__file__, encoding="utf-8") as file:
            file.readline()


class Fragile(Honest):
    """Assumes that pictures never change."""

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        assert isinstance(frame.payload, Image)
        return () if frame.payload.pixels.shape == (120, 160, 3) else (1 / 0,)  # type: ignore[return-value]


@pytest.mark.parametrize(
    ("check", "localizer", "config", "run"),
    [
        ("config_forbids_unknown_keys", Honest, Lax(), WHEELS),
        ("config_describes_every_key", Honest, Undescribed(), WHEELS),
        ("constructor_is_cheap", Opening, Config(), WHEELS),
        ("says_something", Silent, Config(), WHEELS),
        ("says_something", AlwaysLost, Config(), WHEELS),
        ("estimates_are_well_formed", NotANumber, Config(), WHEELS),
        ("estimates_are_well_formed", Overlapping, Config(), WHEELS),
        ("errors_fit_the_information", Boastful, Config(), WHEELS),
        ("same_seed_same_answers", Random, Config(), WHEELS),
        ("started_again_is_as_new", Remembering, Config(), WHEELS),
        ("frames_are_left_alone", Painting, Config(), PICTURES),
        ("black_frames_are_no_answer", Hallucinating, Config(), PICTURES),
        ("memory_is_bounded", Hoarding, Config(), WHEELS),
    ],
)
def test_a_broken_rule_is_found(check, localizer, config, run) -> None:
    with pytest.raises(AssertionError):
        localizer_checks(localizer, config, run, memory_frames=100)[check]()


def test_an_untyped_error_is_found() -> None:
    with pytest.raises(ZeroDivisionError):
        localizer_checks(Fragile, Config(), PICTURES)["another_size_is_a_typed_error"]()


@pytest.mark.parametrize("name", sorted(localizer_checks(Honest, Config(), WHEELS)))
def test_an_honest_localizer_passes(name: str) -> None:
    localizer_checks(Honest, Config(), WHEELS, memory_frames=200)[name]()


def test_an_expected_failure_needs_a_known_name_and_a_reason() -> None:
    checks: dict[str, Callable[[], None]] = {"says_something": lambda: None}

    with pytest.raises(ValueError, match=r"no check is called 'says_somthing' \(did you mean 'says_something'\?\)"):
        parametrize(checks, {"says_somthing": "because"})
    with pytest.raises(ValueError, match="say why 'says_something' is expected to fail"):
        parametrize(checks, {"says_something": " "})
    (parameter,) = parametrize(checks, {"says_something": "because"}).args[1]
    assert parameter.marks[0].kwargs == {"strict": True, "reason": "because"}
