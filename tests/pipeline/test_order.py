"""What happens at a frame, in which order."""

from __future__ import annotations

import pytest

from trailmark.errors import ConfigError
from trailmark.estimates import Fix, Lost, Motion
from trailmark.geometry import Pose2
from trailmark.interfaces import Sink
from trailmark.pipeline import Pipeline


def stamps(n: int, rate_hz: float = 10.0) -> list[float]:
    return [i / rate_hz for i in range(n)]


def test_a_localizer_sees_what_the_ones_before_it_said_of_the_same_frame(fakes) -> None:
    before, mover, after = fakes.Scripted(), fakes.Mover(Pose2(0.1)), fakes.Scripted()
    source = fakes.Recording(fakes.image_frames("cam", stamps(5)))

    for _ in Pipeline(fakes.parts({"cam": source}, {"before": before, "vo": mover, "after": after})):
        pass

    # Both extrapolate to the frame's stamp; only the later one knows the motion until then.
    assert [belief.motion_age_s for _, belief in after.seen[1:]] == [0.0] * 4
    assert [belief.motion_age_s for _, belief in before.seen[2:]] == pytest.approx([0.1] * 3)
    assert after.seen[-1][1].pose_map_base.x == pytest.approx(0.4)


def test_for_one_that_does_not_look_at_the_belief_none_is_made(fakes) -> None:
    looks, looks_not = fakes.Scripted(), fakes.Scripted()
    looks_not.uses_belief = False
    source = fakes.Recording(fakes.image_frames("cam", stamps(5)))

    for _ in Pipeline(fakes.parts({"cam": source}, {"vo": fakes.Mover(Pose2(0.1)), "no": looks_not, "yes": looks})):
        pass

    assert [belief.stamp_s for _, belief in looks_not.seen] == stamps(5)
    assert {belief.pose_map_base for _, belief in looks_not.seen} == {None}
    assert looks.seen[-1][1].pose_map_base.x == pytest.approx(0.4)


def test_a_localizer_is_asked_only_with_its_own_sensors(fakes) -> None:
    eye, thermometer = fakes.Scripted(), fakes.Scripted()
    frames = sorted(
        [*fakes.image_frames("cam", [0.0, 1.0]), *fakes.scalar_frames("light", [0.5, 1.5])], key=lambda f: f.stamp_s
    )
    subscriptions = {"eye": frozenset({"cam"}), "thermometer": frozenset({"light"})}

    for _ in Pipeline(
        fakes.parts(
            {"robot": fakes.Recording(frames)}, {"eye": eye, "thermometer": thermometer}, subscriptions=subscriptions
        )
    ):
        pass

    assert {frame.sensor for frame, _ in eye.seen} == {"cam"}
    assert {frame.sensor for frame, _ in thermometer.seen} == {"light"}


def test_a_step_tells_what_was_said_and_what_became_of_it(fakes) -> None:
    def say(frame, belief):
        return (Lost(frame.stamp_s, "blank wall"),) if frame.stamp_s else (Fix(0.0, Pose2(1.0), fakes.GOOD),)

    source = fakes.Recording(fakes.image_frames("cam", stamps(2)))

    first, second = list(Pipeline(fakes.parts({"cam": source}, {"map": fakes.Scripted(say)})))

    assert [(told.source, told.outcome.status) for told in first.estimates] == [("map", "accepted")]
    assert first.belief.pose_map_base == Pose2(1.0)
    assert second.estimates[0].outcome.status == "unused"
    assert second.frame is not None
    assert second.stamp_s == 0.1


def test_an_unused_localizer_runs_and_is_recorded_as_unused(fakes) -> None:
    rival = fakes.Mover(Pose2(5.0))
    source = fakes.Recording(fakes.image_frames("cam", stamps(4)))
    pipeline = Pipeline(
        fakes.parts({"cam": source}, {"vo": fakes.Mover(Pose2(0.1)), "rival": rival}, use=frozenset({"vo"}))
    )

    *_, last = pipeline

    assert last.belief.pose_map_base.x == pytest.approx(0.3)
    assert pipeline.result.counters["localizer.rival.unused"] == 3
    assert pipeline.result.trajectories["rival"].poses[-1, 0] == pytest.approx(15.0)  # its private dead reckoning


def test_two_motions_without_use_are_refused(fakes) -> None:
    source = fakes.Recording(fakes.image_frames("cam", stamps(4)))
    localizers = {"vo": fakes.Mover(Pose2(0.1)), "wheels": fakes.Mover(Pose2(0.1))}

    with pytest.raises(ConfigError, match=r"'vo' and 'wheels' both give motion of the sensor 'cam'.*use: \[vo\]"):
        list(Pipeline(fakes.parts({"cam": source}, localizers)))


@pytest.mark.parametrize("order", [("vo", "mapper"), ("mapper", "vo")])
def test_a_motion_that_is_spare_is_unused_beside_another_of_the_same_sensor(fakes, order: tuple[str, str]) -> None:
    class Mapper(fakes.Mover):
        motion_is_spare = True

    parts = {"vo": fakes.Mover(Pose2(0.1)), "mapper": Mapper(Pose2(5.0))}
    source = fakes.Recording(fakes.image_frames("cam", stamps(4)))
    pipeline = Pipeline(fakes.parts({"cam": source}, {name: parts[name] for name in order}))

    *_, last = pipeline

    counters = pipeline.result.counters
    assert counters["localizer.vo.accepted"] >= 2  # whoever is heard first is believed once
    assert counters["localizer.mapper.unused"] >= 2
    assert [told.outcome.reason for told in last.estimates if told.source == "mapper"] == [
        "'vo' gives motion, and both would count twice"
    ]


def test_a_motion_that_is_spare_counts_when_the_other_is_switched_off(fakes) -> None:
    class Mapper(fakes.Mover):
        motion_is_spare = True

    def fail() -> None:
        floor._say = lambda frame, belief: 1 / 0

    floor = fakes.Mover(Pose2(0.1))
    frames = fakes.image_frames("cam", stamps(9))
    source = fakes.Recording([*frames[:4], fail, *frames[4:]])
    options = {"vo": {"on_error": "disable"}}
    parts = fakes.parts({"cam": source}, {"vo": floor, "mapper": Mapper(Pose2(0.1))}, localizer_options=options)
    pipeline = Pipeline(parts)

    *_, last = pipeline

    assert pipeline.result.counters["localizer.mapper.unused"] == 3
    assert pipeline.result.counters["localizer.mapper.accepted"] == 5
    assert last.belief.pose_map_base.x == pytest.approx(0.8)
    assert last.belief.motion_age_s == 0.0
    assert last.belief.health["vo"].startswith("switched off: localizer 'vo' failed")


def test_an_estimate_about_the_future_is_refused(fakes) -> None:
    prophet = fakes.Scripted(lambda frame, belief: (Fix(frame.stamp_s + 1e9, Pose2(9.0), fakes.GOOD),))
    source = fakes.Recording(fakes.image_frames("cam", stamps(2)))
    pipeline = Pipeline(fakes.parts({"cam": source}, {"prophet": prophet}))

    steps = list(pipeline)

    assert [told.outcome.status for step in steps for told in step.estimates] == ["refused", "refused"]
    assert "but its frame is of" in steps[0].estimates[0].outcome.reason
    assert steps[-1].belief.pose_map_base == Pose2()


def test_everything_is_counted(fakes) -> None:
    def say(frame, belief):
        late = Fix(frame.stamp_s - 100.0, Pose2(), fakes.GOOD)
        return (late,) if frame.stamp_s > 0.25 else (Lost(frame.stamp_s, "dark"),)

    source = fakes.Recording(fakes.image_frames("cam", [0.0, 0.1, 0.1, 0.2, 0.3]))
    pipeline = Pipeline(fakes.parts({"cam": source}, {"vo": fakes.Mover(Pose2(0.1)), "map": fakes.Scripted(say)}))

    list(pipeline)

    counters = pipeline.result.counters
    assert counters["frames"] == 4
    assert counters["source.cam.frames"] == 4
    assert counters["source.cam.repeated"] == 1
    assert counters["localizer.vo.accepted"] == 3
    assert counters["localizer.map.lost"] == 3
    assert counters["localizer.map.late"] == 1
    assert counters["estimator.gaps"] == 0


def test_sinks_hear_everything_in_order(fakes) -> None:
    class Listener(Sink):
        def __init__(self):
            super().__init__(None)
            self.heard = []

        def on_frame(self, frame):
            self.heard.append(f"frame {frame.stamp_s:g}")

        def on_estimate(self, source, estimate, applied):
            self.heard.append(f"{source} {applied.status}")

        def on_belief(self, belief):
            self.heard.append(f"belief {belief.pose_map_base.x:g}")

        def on_end(self, end):
            self.heard.append(f"{end.status} {end.counters['frames']}")

    source = fakes.Recording(fakes.image_frames("cam", stamps(2)))
    listener = Listener()

    list(Pipeline(fakes.parts({"cam": source}, {"vo": fakes.Mover(Pose2(0.5))}, sinks={"ear": listener})))

    assert listener.heard == ["frame 0", "belief 0", "frame 0.1", "vo accepted", "belief 0.5", "done 2"]


def test_parts_get_sessions_of_their_own(fakes) -> None:
    source = fakes.Recording(fakes.image_frames("cam", stamps(1)))
    a, b = fakes.Scripted(), fakes.Scripted()
    list(Pipeline(fakes.parts({"cam": source}, {"a": a, "b": b}, seed=3)))
    numbers = [part.session.rng.random() for part in (a, b)]

    alone = fakes.Scripted()
    list(Pipeline(fakes.parts({"cam": fakes.Recording(fakes.image_frames("cam", stamps(1)))}, {"b": alone}, seed=3)))

    assert a.session.name == "a"
    assert a.session.start_pose == Pose2()
    assert set(a.session.sensors) == {"cam"}
    assert numbers[0] != numbers[1]
    assert alone.session.rng.random() == numbers[1]  # leaving a part out changes no other part's numbers


def test_motion_of_a_window_may_speak_of_the_past(fakes) -> None:
    def say(frame, belief):
        end_s = frame.stamp_s - 0.05
        return (Motion(end_s - 0.1, end_s, Pose2(0.1), fakes.GOOD),) if frame.stamp_s else ()

    source = fakes.Recording(fakes.image_frames("cam", stamps(4)))
    *_, last = Pipeline(fakes.parts({"cam": source}, {"divs": fakes.Scripted(say)}))

    assert last.belief.pose_map_base.x == pytest.approx(0.35)  # carried on from 0.25 s to 0.3 s
    assert last.belief.motion_age_s == pytest.approx(0.05)


def test_between_two_steps_a_person_may_say_where_the_robot_is(fakes) -> None:
    pipeline = Pipeline(
        fakes.parts({"cam": fakes.Recording(fakes.image_frames("cam", stamps(5)))}, {"vo": fakes.Mover(Pose2(0.1))})
    )
    poses = []

    for k, step in enumerate(pipeline):
        poses.append(step.belief.pose_map_base)
        if k == 2:
            assert pipeline.set_pose(Pose2(7.0, 8.0, 0.0)).status == "accepted"

    assert poses[2].x == pytest.approx(0.2)
    assert (poses[3].x, poses[3].y) == pytest.approx((7.1, 8.0))
