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


def pictures_and_light(fakes):
    frames = [*fakes.image_frames("cam", [0.0, 0.1, 0.2, 0.9]), *fakes.scalar_frames("light", [0.05, 0.15, 0.25])]
    return fakes.Recording(sorted(frames, key=lambda frame: frame.stamp_s))


@pytest.mark.parametrize(("keep", "seen"), [("newest", [0.0, 0.2]), ("all", [0.0, 0.05, 0.1])])
def test_the_newest_frame_of_every_kind_waits_unless_all_are_asked_for(fakes, keep: str, seen: list[float]) -> None:
    slow = fakes.Scripted()
    localizer_options = {"map": {"async": True, "latency_ms": 500, "keep": keep}}

    list(Pipeline(fakes.parts({"s": pictures_and_light(fakes)}, {"map": slow}, localizer_options=localizer_options)))

    # The light costs no time, pictures take half a second: 0.2 until 0.7, 0.1 until 1.0, when all has ended.
    assert [frame.stamp_s for frame, _ in slow.seen] == seen


def test_of_a_localizer_that_keeps_all_no_endless_queue_waits(fakes) -> None:
    slow = fakes.Scripted()
    localizer_options = {"map": {"async": True, "latency_ms": 9000, "keep": "all"}}
    pipeline = Pipeline(
        fakes.parts({"cam": camera(fakes, 400, 100.0)}, {"map": slow}, localizer_options=localizer_options)
    )

    list(pipeline)

    counters = pipeline.result.counters
    assert counters["localizer.map.overwritten"] == 400 - 1 - 256
    assert counters["localizer.map.given_up"] == 256


@pytest.mark.parametrize("is_async", [False, True])
def test_a_delay_holds_every_estimate_back_and_keeps_nobody_busy(fakes, is_async: bool) -> None:
    far = fakes.Scripted(fix_at_frame(fakes))
    localizer_options = {"map": {"async": is_async, "delay_ms": 250}}
    pipeline = Pipeline(fakes.parts({"cam": camera(fakes, 8)}, {"map": far}, localizer_options=localizer_options))

    arrived = [(told.estimate.stamp_s, told.arrived_s) for step in pipeline for told in step.estimates]

    assert len(far.seen) == 8
    assert arrived == [pytest.approx((0.1 * i, 0.1 * i + 0.25)) for i in range(len(arrived))]
    assert pipeline.result.counters["localizer.map.accepted"] == 8  # those under way at the end arrive too
    assert "localizer.map.overwritten" not in pipeline.result.counters


def test_latency_and_delay_add_up(fakes) -> None:
    slow = fakes.Scripted(fix_at_frame(fakes))
    localizer_options = {"map": {"async": True, "latency_ms": 250, "delay_ms": 1000}}
    pipeline = Pipeline(fakes.parts({"cam": camera(fakes, 15)}, {"map": slow}, localizer_options=localizer_options))

    arrived = [told.arrived_s for step in pipeline for told in step.estimates]

    assert arrived[0] == pytest.approx(1.25)
    assert [frame.stamp_s for frame, _ in slow.seen][:3] == pytest.approx([0.0, 0.2, 0.4])


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
