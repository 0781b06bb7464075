"""The checks find what they are for: each is shown a part that breaks its rule."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np
import pytest

from trailmark.config import PluginConfig, Sensor
from trailmark.errors import ShapeError, SourceError
from trailmark.estimates import Belief, Estimate, Fix, Lost, Motion, information_from_sigmas
from trailmark.frames import Frame, Image, Odometry
from trailmark.geometry import Pose2
from trailmark.interfaces import Fault, Localizer, Session
from trailmark.testing import SyntheticRun, circle, fault_checks, localizer_checks, odometry_run, room_run
from trailmark.testing.checks.parametrize import parametrize

WHEELS = odometry_run(circle(0.3, 1.0), 30)
UNEVEN = odometry_run(n_frames=60)
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


class Late(Honest):
    """Stamps what it says 20 ms after the frame that it is about."""

    def estimate(self, last, frame, pose):
        return Motion(last[0] + 0.02, frame.stamp_s + 0.02, last[1].between(pose), INFORMATION)


class LateFix(Honest):
    """Says where base was at the frame before."""

    def estimate(self, last, frame, pose):
        return Fix(frame.stamp_s, last[1], INFORMATION)


class Covariant(Honest):
    """Gives the covariance for the information."""

    def estimate(self, last, frame, pose):
        return Motion(last[0], frame.stamp_s, last[1].between(pose), np.linalg.inv(INFORMATION))


class Humble(Honest):
    """Says a hundred times the sigma that it has."""

    def estimate(self, last, frame, pose):
        return Motion(last[0], frame.stamp_s, last[1].between(pose), INFORMATION / 200.0**2)


class Shared(Honest):
    """Keeps the last frame with the class."""

    kept: ClassVar[dict[str, Any]] = {}

    def start(self, session: Session) -> None:
        Shared.kept.clear()

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        pose = frame.payload.pose_start_base  # type: ignore[union-attr]
        last = Shared.kept.get("last")
        Shared.kept["last"] = frame.stamp_s, pose
        return () if last is None or last[0] >= frame.stamp_s else (self.estimate(last, frame, pose),)


class Threadbare(Honest):
    """Works where it was started, and nowhere else."""

    def start(self, session: Session) -> None:
        super().start(session)
        self.thread = threading.get_ident()

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        if threading.get_ident() != self.thread:
            raise RuntimeError("not my thread")
        return super().observe(frame, belief)


@pytest.mark.parametrize(
    ("check", "localizer", "config", "run"),
    [
        ("stamps_are_those_of_the_frames", Late, Config(), UNEVEN),
        ("stamps_are_those_of_the_frames", LateFix, Config(), UNEVEN),
        ("information_says_something", Covariant, Config(), WHEELS),
        ("information_says_something", Humble, Config(), WHEELS),
        ("two_instances_share_no_state", Shared, Config(), WHEELS),
        ("two_instances_work_in_two_threads", Threadbare, Config(), WHEELS),
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
@pytest.mark.parametrize("run", [WHEELS, UNEVEN], ids=["even", "uneven"])
def test_an_honest_localizer_passes(name: str, run: SyntheticRun) -> None:
    localizer_checks(Honest, Config(), run, memory_frames=200)[name]()


def test_an_expected_failure_needs_a_known_name_and_a_reason() -> None:
    checks: dict[str, Callable[[], None]] = {"says_something": lambda: None}

    with pytest.raises(ValueError, match=r"no check is called 'says_somthing' \(did you mean 'says_something'\?\)"):
        parametrize(checks, {"says_somthing": "because"})
    with pytest.raises(ValueError, match="say why 'says_something' is expected to fail"):
        parametrize(checks, {"says_something": " "})
    (parameter,) = parametrize(checks, {"says_something": "because"}).args[1]
    assert parameter.marks[0].kwargs == {"strict": True, "reason": "because"}


# --- faults ------------------------------------------------------------------------------------------------------


class FaultConfig(PluginConfig):
    """A config."""


class Brighter(Fault):
    """Makes pictures brighter, and does nothing that it should not."""

    kinds = frozenset({"image"})

    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame | None:
        assert isinstance(frame.payload, Image)
        return Frame(frame.sensor, frame.stamp_s, Image(self.worsen(frame.payload.pixels, rng)))

    def worsen(self, pixels: Any, rng: np.random.Generator) -> Any:
        return pixels // 2 + pixels.dtype.type(100)


class Idle(Brighter):
    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame | None:
        return frame


class OwnDice(Brighter):
    def worsen(self, pixels: Any, rng: np.random.Generator) -> Any:
        return np.random.default_rng().integers(0, 255, pixels.shape).astype(pixels.dtype)


class Scribbling(Brighter):
    def worsen(self, pixels: Any, rng: np.random.Generator) -> Any:
        pixels.base[...] = 0
        return pixels


class Halving(Brighter):
    def worsen(self, pixels: Any, rng: np.random.Generator) -> Any:
        return np.ascontiguousarray(pixels[::2])


class Stuttering(Brighter):
    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame | None:
        return Frame(frame.sensor, max(frame.stamp_s, 0.1), frame.payload)


class Ageing(Brighter):
    n = 0

    def worsen(self, pixels: Any, rng: np.random.Generator) -> Any:
        self.n += 1
        return pixels // 2 + pixels.dtype.type(min(self.n, 100))


class Blinded(Brighter):
    def worsen(self, pixels: Any, rng: np.random.Generator) -> Any:
        return (pixels // pixels.max()).astype(pixels.dtype)


@pytest.mark.parametrize(
    ("check", "fault", "story"),
    [
        ("it_does_something", Idle, "it changes no frame of any sensor"),
        ("same_seed_same_frames", OwnDice, "gives other frames of"),
        ("frames_are_left_alone", Scribbling, "work on a copy"),
        ("frames_stay_of_their_kind", Halving, "and became"),
        ("stamps_strictly_increase", Stuttering, "do not increase"),
        ("starts_again", Ageing, "forget in start"),
    ],
)
def test_a_fault_that_breaks_a_rule_is_found(check, fault, story) -> None:
    checks = fault_checks(fault, FaultConfig())

    with pytest.raises(AssertionError, match=story):
        checks[check]()


def test_a_fault_that_cannot_bear_black_pictures_is_found() -> None:
    with (
        np.errstate(divide="raise"),
        pytest.raises(SourceError, match="fault 'fault' of source 'checked' failed in apply"),
    ):
        fault_checks(Blinded, FaultConfig())["black_white_and_noise_are_taken"]()


@pytest.mark.parametrize("name", sorted(fault_checks(Brighter, FaultConfig())))
def test_an_honest_fault_passes(name: str) -> None:
    fault_checks(Brighter, FaultConfig())[name]()


def test_a_truth_that_is_no_trajectory_is_refused_with_the_way_to_make_one() -> None:
    with pytest.raises(ShapeError, match=r"not a list: Trajectory\.from_poses"):
        SyntheticRun((), {}, [(0.0, Pose2())])  # type: ignore[arg-type]
