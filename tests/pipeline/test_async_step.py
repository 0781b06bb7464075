"""Localizers beside the run, on the virtual clock."""

from __future__ import annotations

import pytest

from trailmark.errors import RunError
from trailmark.estimates import Fix
from trailmark.geometry import Pose2
from trailmark.pipeline import Pipeline


def fix_at_frame(fakes, x: float = 10.0):
    return lambda frame, belief: (Fix(frame.stamp_s, Pose2(x + frame.stamp_s), fakes.GOOD),)


def camera(fakes, n: int, rate_hz: float = 10.0):
    return fakes.Recording(fakes.image_frames("cam", [i / rate_hz for i in range(n)]))


def test_estimates_arrive_when_the_latency_has_passed(fakes) -> None:
    slow = fakes.Scripted(fix_at_frame(fakes))
    localizer_options = {"map": {"async": True, "latency_ms": 250}}
    steps = list(Pipeline(fakes.parts({"cam": camera(fakes, 8)}, {"map": slow}, localizer_options=localizer_options)))

    arrived = [(step.stamp_s, told.arrived_s, told.estimate.stamp_s) for step in steps for told in step.estimates]

    # Busy until 0.25, it then takes the newest frame that waits (0.2) and is done at 0.5, and so on.
    assert arrived == [pytest.approx(row) for row in [(0.3, 0.25, 0.0), (0.5, 0.5, 0.2)]]
    assert [frame.stamp_s for frame, _ in slow.seen] == pytest.approx([0.0, 0.2, 0.4])


def test_what_the_mailbox_overwrites_is_counted(fakes) -> None:
    slow = fakes.Scripted(fix_at_frame(fakes))
    localizer_options = {"map": {"async": True, "latency_ms": 250}}
    pipeline = Pipeline(fakes.parts({"cam": camera(fakes, 8)}, {"map": slow}, localizer_options=localizer_options))

    list(pipeline)

    counters = pipeline.result.counters
    n_lost = counters["localizer.map.overwritten"] + counters["localizer.map.given_up"]
    assert counters["localizer.map.overwritten"] == 4  # 0.1, 0.3, 0.5 and 0.6
    assert len(slow.seen) + n_lost == 8


def test_frames_that_are_no_pictures_all_wait(fakes) -> None:
    slow = fakes.Scripted()
    frames = sorted(
        [*fakes.image_frames("cam", [0.0, 0.1, 0.2, 0.9]), *fakes.scalar_frames("light", [0.05, 0.15, 0.25])],
        key=lambda frame: frame.stamp_s,
    )
    localizer_options = {"map": {"async": True, "latency_ms": 500}}

    list(Pipeline(fakes.parts({"s": fakes.Recording(frames)}, {"map": slow}, localizer_options=localizer_options)))

    assert [frame.stamp_s for frame, _ in slow.seen] == [0.0, 0.05, 0.15, 0.2, 0.9][:4]
    # The light costs no time: it is the pictures that take half a second.


def test_the_belief_is_that_of_the_frames_own_stamp(fakes) -> None:
    slow = fakes.Scripted()
    localizers = {"vo": fakes.Mover(Pose2(0.1)), "map": slow}
    localizer_options = {"map": {"async": True, "latency_ms": 250}}

    list(Pipeline(fakes.parts({"cam": camera(fakes, 8)}, localizers, localizer_options=localizer_options)))

    assert [belief.pose_map_base.x for _, belief in slow.seen] == pytest.approx([0.0, 0.2, 0.4])


def test_a_late_fix_corrects_everything_after_its_own_stamp(fakes) -> None:
    once = fakes.Scripted(
        lambda frame, belief: (Fix(0.0, Pose2(5.0, 1.0, 0.0), fakes.GOOD),) if not frame.stamp_s else ()
    )
    localizers = {"vo": fakes.Mover(Pose2(0.1)), "map": once}
    steps = list(
        Pipeline(
            fakes.parts(
                {"cam": camera(fakes, 5)}, localizers, localizer_options={"map": {"async": True, "latency_ms": 250}}
            )
        )
    )

    assert [step.belief.pose_map_base.x for step in steps] == pytest.approx([0.0, 0.1, 0.2, 5.3, 5.4])


def test_a_localizers_own_model_gives_the_latency_and_is_told_back(fakes) -> None:
    slow = fakes.Scripted(fix_at_frame(fakes))
    slow.latency = 0.35
    steps = list(
        Pipeline(fakes.parts({"cam": camera(fakes, 6)}, {"map": slow}, localizer_options={"map": {"async": True}}))
    )

    assert [told.arrived_s for step in steps for told in step.estimates] == pytest.approx([0.35])
    assert slow.session.last_latency_s() == 0.35


def test_a_synchronous_localizer_is_told_its_modelled_latency_too(fakes) -> None:
    kinect = fakes.Scripted()
    kinect.latency = 0.12

    list(Pipeline(fakes.parts({"cam": camera(fakes, 2)}, {"kinect": kinect})))

    assert kinect.session.last_latency_s() == 0.12


def test_no_latency_is_as_good_as_synchronous(fakes) -> None:
    steps = list(
        Pipeline(
            fakes.parts(
                {"cam": camera(fakes, 3)},
                {"map": fakes.Scripted(fix_at_frame(fakes))},
                localizer_options={"map": {"async": True}},
            )
        )
    )

    assert [len(step.estimates) for step in steps] == [1, 1, 1]


def test_what_is_in_work_at_the_end_still_counts(fakes) -> None:
    slow = fakes.Scripted(fix_at_frame(fakes))
    pipeline = Pipeline(
        fakes.parts(
            {"cam": camera(fakes, 1)}, {"map": slow}, localizer_options={"map": {"async": True, "latency_ms": 9000}}
        )
    )

    list(pipeline)

    assert pipeline.result.counters["localizer.map.accepted"] == 1
    assert pipeline.result.trajectories["map"].poses[0, 0] == 10.0


def test_an_error_beside_the_run_ends_it_once_what_was_said_before_is_told(fakes) -> None:
    def say(frame, belief):
        if frame.stamp_s > 0.05:
            raise ValueError("no texture")
        return (Fix(frame.stamp_s, Pose2(7.0), fakes.GOOD),)

    localizer_options = {"map": {"async": True, "latency_ms": 150}}
    pipeline = Pipeline(
        fakes.parts({"cam": camera(fakes, 8)}, {"map": fakes.Scripted(say)}, localizer_options=localizer_options)
    )

    with pytest.raises(
        RunError, match=r"localizer 'map' failed in observe at the frame of 'cam' at 0.100000 s: ValueError: no texture"
    ):
        list(pipeline)

    assert pipeline.result.status == "failed"
    assert pipeline.result.counters["localizer.map.accepted"] == 1
