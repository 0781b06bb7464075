"""A sensor that repeats itself bit by bit while the robot moves has frozen: who looks at it is `Lost`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from trailmark.estimates import Lost, Motion
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.frames import RGBD, Frame, Image, Odometry, Payload, Scan
from trailmark.geometry import Pose2
from trailmark.pipeline import Pipeline

RNG = np.random.default_rng(0)
#: Two of each kind of snapshot, as noise makes them.
PICTURES = [Image(RNG.integers(0, 255, (20, 30, 3), np.uint8)) for _ in range(2)]
SCANS = [Scan(np.where(np.arange(40) % 7, RNG.uniform(1, 5, 40), np.nan), -1.0, 0.05) for _ in range(2)]
RGBDS = [RGBD(RNG.integers(0, 255, (20, 30, 3), np.uint8), RNG.random((20, 30), np.float32)) for _ in range(2)]


class Wheels:
    """Says the motion between readings of wheels."""

    def __init__(self) -> None:
        self._last: Frame | None = None

    def __call__(self, frame: Frame, _: Any) -> Sequence[Motion]:
        last, self._last = self._last, frame
        if last is None:
            return ()
        moved = last.payload.pose_start_base.between(frame.payload.pose_start_base)
        return (Motion(last.stamp_s, frame.stamp_s, moved, np.diag([1e6, 1e6, 1e6])),)


def asked_and_lost(
    fakes: Any, payloads: Sequence[Payload], *, step: Pose2 | None = None, interval_s: float = 0.1
) -> tuple[list[int], dict[int, str]]:
    """Return which of the snapshots a localizer is asked about, and the reasons of those that are `Lost`.

    Wheels, where they say something, move by `step` between two snapshots.
    """
    eye, pose = fakes.Scripted(), Pose2()
    frames = []
    for k, payload in enumerate(payloads):
        if step is not None:
            frames.append(Frame("wheels", interval_s * k, Odometry(pose)))
            pose = pose @ step
        frames.append(Frame("eye", interval_s * k, payload))
    localizers, subscriptions = {"eye": eye}, {"eye": frozenset({"eye"})}
    if step is not None:
        localizers = {"wheels": fakes.Scripted(Wheels())} | localizers
        subscriptions["wheels"] = frozenset({"wheels"})
    parts = fakes.parts({"robot": fakes.Recording(frames)}, localizers, subscriptions=subscriptions)
    records = [record for run_step in Pipeline(parts) for record in run_step.estimates if record.source == "eye"]
    lost = {round(one.estimate.stamp_s / interval_s): one.estimate.reason for one in records}
    assert all(isinstance(one.estimate, Lost) for one in records)
    return [round(frame.stamp_s / interval_s) for frame, _ in eye.seen], lost


@pytest.mark.parametrize("step", [Pose2(0.03, 0.0, 0.0), Pose2(0.0, 0.0, 0.05)], ids=["drives", "turns"])
@pytest.mark.parametrize(("first", "other"), [PICTURES, SCANS, RGBDS], ids=["image", "scan", "rgbd"])
def test_who_looks_at_a_frozen_sensor_is_lost_until_it_measures_again(
    fakes: Any, first: Payload, other: Payload, step: Pose2
) -> None:
    asked, lost = asked_and_lost(fakes, [first, first, first, other], step=step)

    assert asked == [0, 3]
    assert list(lost) == [1, 2]
    assert lost[2].startswith(f"'eye' gives the same {first.kind} again, bit by bit, while the robot moves by 0.0")


@pytest.mark.parametrize("frozen", ["bgr", "depth_m"])
def test_half_of_a_camera_may_be_slower_than_the_other_and_freeze(fakes: Any, frozen: str) -> None:
    def picture(k: int) -> RGBD:
        rng = np.random.default_rng(k)
        parts = {"bgr": rng.integers(0, 255, (20, 30, 3), np.uint8), "depth_m": rng.random((20, 30), np.float32)}
        return RGBD(**parts | {frozen: getattr(RGBDS[0], frozen)})

    asked, lost = asked_and_lost(fakes, [picture(k) for k in range(9)], step=Pose2(0.03, 0.0, 0.0))

    assert asked == list(range(6))
    assert list(lost) == [6, 7, 8]


@pytest.mark.parametrize(
    "silent",
    [
        Image(np.zeros((20, 30), np.uint8)),
        Scan(np.full(40, np.nan), -1.0, 0.05),
        Scan(np.empty(0), -1.0, 0.05),
        RGBD(np.full((20, 30, 3), 255, np.uint8), np.full((20, 30), np.nan, np.float32)),
    ],
    ids=["black", "open", "empty", "white"],
)
def test_what_says_nothing_is_no_proof(fakes: Any, silent: Payload) -> None:
    assert asked_and_lost(fakes, [silent] * 4, step=Pose2(0.03, 0.0, 0.0)) == ([0, 1, 2, 3], {})


def test_fresh_colour_without_any_depth_has_not_frozen(fakes: Any) -> None:
    colours = [RGBD(np.roll(RGBDS[0].bgr, k), np.full((20, 30), np.nan, np.float32)) for k in range(9)]

    assert asked_and_lost(fakes, colours, step=Pose2(0.03, 0.0, 0.0)) == (list(range(9)), {})


def test_small_steps_add_up(fakes: Any) -> None:
    asked, lost = asked_and_lost(fakes, [PICTURES[0]] * 6, step=Pose2(0.0008, 0.0, 0.0))

    assert asked == [0, 1, 2]
    assert list(lost) == [3, 4, 5]


def test_a_driver_that_goes_round_in_its_buffers_is_found_out(fakes: Any) -> None:
    asked, lost = asked_and_lost(fakes, PICTURES * 4, step=Pose2(0.03, 0.0, 0.0))

    assert asked == [0, 1]
    assert list(lost) == list(range(2, 8))


def test_where_the_robot_stands_the_same_is_seen_again(fakes: Any) -> None:
    asked, lost = asked_and_lost(fakes, [PICTURES[0]] * 20, step=Pose2())

    assert asked == list(range(20))
    assert not lost


def test_where_nobody_else_tells_of_motion_the_same_is_not_believed(fakes: Any) -> None:
    asked, lost = asked_and_lost(fakes, [PICTURES[0]] * 4)

    assert asked == [0]
    assert lost[3].endswith("bit by bit, and nobody else tells whether the robot stands")


@pytest.mark.parametrize("step", [Pose2(), Pose2(0.05, 0.0, 0.0)])
def test_its_own_word_does_not_count(fakes: Any, step: Pose2) -> None:
    """A camera is no witness for itself: neither frozen when it says that the robot stands, nor where it stops."""
    eye = fakes.Mover(step)
    source = fakes.Recording([Frame("eye", 0.1 * k, PICTURES[0]) for k in range(8)])

    for _ in Pipeline(fakes.parts({"robot": source}, {"eye": eye})):
        pass

    assert len(eye.seen) == 1


@pytest.mark.parametrize("is_sure_of_the_way", [True, False])
def test_who_knows_the_turn_alone_is_no_witness(fakes: Any, is_sure_of_the_way: bool) -> None:
    """A gyro says that the robot does not turn: it may drive."""
    told = np.diag([1e6, 1e6, 1e6]) if is_sure_of_the_way else np.diag([0.0, 0.0, 1e6])

    def turns(frame: Frame, _: Any) -> Sequence[Motion]:
        return (Motion(frame.stamp_s - 0.1, frame.stamp_s, Pose2(), told),)

    eye = fakes.Scripted()
    frames = [
        one
        for k in range(1, 6)
        for one in (Frame("gyro", 0.1 * k, Odometry(Pose2())), Frame("eye", 0.1 * k, PICTURES[0]))
    ]
    parts = fakes.parts(
        {"robot": fakes.Recording(frames)},
        {"gyro": fakes.Scripted(turns), "eye": eye},
        subscriptions={"gyro": frozenset({"gyro"}), "eye": frozenset({"eye"})},
    )

    for _ in Pipeline(parts):
        pass

    assert len(eye.seen) == (5 if is_sure_of_the_way else 1)


def test_two_that_freeze_together_are_no_witnesses_of_each_other(fakes: Any) -> None:
    """Each says that the robot stands; the one that is looked at first is believed once."""
    eyes = {"left": fakes.Mover(Pose2()), "right": fakes.Mover(Pose2())}
    frames = [Frame(name, 0.1 * k, PICTURES[i]) for k in range(6) for i, name in enumerate(eyes)]
    subscriptions = {name: frozenset({name}) for name in eyes}
    parts = fakes.parts(
        {"robot": fakes.Recording(frames)}, eyes, subscriptions=subscriptions, estimator=Kalman(KalmanConfig())
    )

    for _ in Pipeline(parts):
        pass

    assert max(len(eye.seen) for eye in eyes.values()) <= 2


def test_a_witness_that_falls_silent_is_none_any_longer(fakes: Any) -> None:
    """Wheels and camera hang together."""
    eye = fakes.Scripted()
    frames = [Frame("wheels", 0.1 * k, Odometry(Pose2())) for k in range(3)]
    frames += [Frame("eye", 0.3 + 0.1 * k, PICTURES[0]) for k in range(9)]
    parts = fakes.parts(
        {"robot": fakes.Recording(frames)},
        {"wheels": fakes.Scripted(Wheels()), "eye": eye},
        subscriptions={"wheels": frozenset({"wheels"}), "eye": frozenset({"eye"})},
    )

    for _ in Pipeline(parts):
        pass

    assert 1 < len(eye.seen) < 6


def test_who_takes_frames_for_a_clock_is_asked_all_the_same_and_is_no_witness(fakes: Any) -> None:
    clock, eye = fakes.Mover(Pose2(0.05, 0.0, 0.0)), fakes.Scripted()
    clock.looks_at_frames = False
    frames = [Frame("eye", 0.1 * k, PICTURES[0]) for k in range(8)]

    for _ in Pipeline(fakes.parts({"robot": fakes.Recording(frames)}, {"clock": clock, "eye": eye})):
        pass

    assert len(clock.seen) == 8
    assert len(eye.seen) == 1


def test_one_that_fails_while_it_is_lost_is_switched_off_as_its_options_say(fakes: Any) -> None:
    eye, n_asked = fakes.Scripted(), []

    def health() -> str:
        n_asked.append(1)
        raise ValueError("broken")

    eye.health = health
    frames = [Frame("eye", 0.1 * k, PICTURES[0]) for k in range(9)]
    options = {"eye": {"on_error": "disable"}}
    pipeline = Pipeline(fakes.parts({"robot": fakes.Recording(frames)}, {"eye": eye}, localizer_options=options))

    assert len(list(pipeline)) == 9
    assert len(n_asked) == 1


def test_a_source_that_writes_into_its_picture_anew_has_not_frozen(fakes: Any) -> None:
    pixels = np.zeros((20, 30), np.uint8)

    class Reusing(fakes.Recording):
        def frames(self):
            for frame in super().frames():
                pixels[:] += 1
                yield frame

    eye = fakes.Scripted()
    source = Reusing([Frame("eye", 0.1 * k, Image(pixels)) for k in range(10)])
    for _ in Pipeline(fakes.parts({"robot": source}, {"eye": eye})):
        pass

    assert len(eye.seen) == 10
