"""A sensor that repeats itself bit by bit while the robot moves has frozen: who looks at it is `Lost`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from trailmark.estimates import Lost, Motion
from trailmark.frames import RGBD, Frame, Image, Odometry, Payload, Scan
from trailmark.geometry import Pose2
from trailmark.pipeline import Pipeline

RNG = np.random.default_rng(0)
#: Two of each kind of snapshot, as noise makes them.
PICTURES = [Image(RNG.integers(0, 255, (20, 30, 3), np.uint8)) for _ in range(2)]
SCANS = [Scan(np.where(np.arange(40) % 7, RNG.uniform(1, 5, 40), np.nan), -1.0, 0.05) for _ in range(2)]
RGBDS = [RGBD(RNG.integers(0, 255, (20, 30, 3), np.uint8), RNG.random((20, 30), np.float32)) for _ in range(2)]
HALF_FROZEN = [RGBD(RGBDS[0].bgr, RGBDS[1].depth_m), RGBD(RGBDS[1].bgr, RGBDS[0].depth_m)]


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
@pytest.mark.parametrize(
    ("first", "other"), [PICTURES, SCANS, RGBDS, HALF_FROZEN], ids=["image", "scan", "rgbd", "half"]
)
def test_who_looks_at_a_frozen_sensor_is_lost_until_it_measures_again(
    fakes: Any, first: Payload, other: Payload, step: Pose2
) -> None:
    asked, lost = asked_and_lost(fakes, [first, first, first, other], step=step)

    assert asked == [0, 3]
    assert list(lost) == [1, 2]
    assert lost[2].startswith(f"'eye' gives the same {first.kind} again, bit by bit, while the robot moves by 0.0")


@pytest.mark.parametrize("repeated", [0, 1])
def test_either_camera_of_two_may_freeze(fakes: Any, repeated: int) -> None:
    bgrs, depths = [one.bgr for one in RGBDS], [one.depth_m for one in RGBDS]
    frames = [RGBD(bgrs[0], depths[0]), RGBD(bgrs[repeated], depths[1 - repeated])]

    assert asked_and_lost(fakes, frames, step=Pose2(0.03, 0.0, 0.0))[0] == [0]


def test_small_steps_add_up(fakes: Any) -> None:
    asked, lost = asked_and_lost(fakes, [PICTURES[0]] * 6, step=Pose2(0.008, 0.0, 0.0))

    assert asked == [0, 1, 2]
    assert list(lost) == [3, 4, 5]


def test_where_the_robot_stands_the_same_is_seen_again(fakes: Any) -> None:
    asked, lost = asked_and_lost(fakes, [PICTURES[0]] * 20, step=Pose2())

    assert asked == list(range(20))
    assert not lost


def test_where_nobody_else_tells_of_motion_the_same_is_believed_for_half_a_second(fakes: Any) -> None:
    asked, lost = asked_and_lost(fakes, [PICTURES[0]] * 8)

    assert asked == list(range(6))
    assert lost[7].endswith("for 0.7 s, and nobody else tells whether the robot stands")


def test_its_own_word_does_not_count(fakes: Any) -> None:
    """A frozen camera that says that the robot stands is no witness for itself."""
    eye = fakes.Mover(Pose2())
    source = fakes.Recording([Frame("eye", 0.1 * k, PICTURES[0]) for k in range(8)])

    for _ in Pipeline(fakes.parts({"robot": source}, {"eye": eye})):
        pass

    assert len(eye.seen) == 6


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
