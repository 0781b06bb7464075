"""However a run ends: the robot is stopped, what is known is kept, parts are closed."""

from __future__ import annotations

import logging
import signal

import pytest

from trailmark import interruption
from trailmark.commands import Stop, Velocity
from trailmark.errors import ConfigError, RunError, SourceError
from trailmark.estimates import Fix, Lost
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.frames import SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Sink
from trailmark.pipeline import Pipeline
from trailmark.pipeline.ending.hangs import HangError


def camera(fakes, n: int = 5):
    return fakes.Recording(fakes.image_frames("cam", [i / 10 for i in range(n)]))


def failing_at(stamp_s: float, error: BaseException):
    def say(frame, belief):
        if frame.stamp_s >= stamp_s - 1e-9:
            raise error
        return ()

    return say


def test_a_localizer_that_raises_ends_the_run_naming_it_and_the_frame(fakes) -> None:
    source, broken = camera(fakes), fakes.Scripted(failing_at(0.2, ValueError("no texture")))
    pipeline = Pipeline(fakes.parts({"cam": source}, {"floor": broken}))

    with pytest.raises(
        RunError, match=r"localizer 'floor' failed in observe at the frame of 'cam' at 0\.200000 s: ValueError: no te"
    ) as caught:
        list(pipeline)

    assert caught.value.part == "localizer 'floor'"
    assert isinstance(caught.value.__cause__, ValueError)
    assert pipeline.result.status == "failed"
    assert pipeline.result.reason.startswith("localizer 'floor' failed")
    assert source.log[-1] == broken.log[-1] == "close"


def test_with_on_error_disable_it_is_switched_off_and_the_rest_goes_on(fakes, caplog) -> None:
    broken = fakes.Scripted(failing_at(0.2, ValueError("no texture")))
    localizers = {"floor": broken, "vo": fakes.Mover(Pose2(0.1))}
    pipeline = Pipeline(
        fakes.parts({"cam": camera(fakes)}, localizers, localizer_options={"floor": {"on_error": "disable"}})
    )

    with caplog.at_level(logging.WARNING):
        *_, last = pipeline

    assert len(broken.seen) == 3  # never asked again
    assert last.belief.pose_map_base.x == pytest.approx(0.4)
    assert "switched off: localizer 'floor' failed" in last.belief.health["floor"]
    assert pipeline.result.status == "done"
    assert pipeline.result.counters["localizer.floor.disabled"] == 1
    assert "it is switched off (on_error: disable)" in caplog.text


def test_an_answer_that_is_no_sequence_is_an_error(fakes) -> None:
    pipeline = Pipeline(fakes.parts({"cam": camera(fakes)}, {"floor": fakes.Scripted(lambda frame, belief: None)}))

    with pytest.raises(RunError, match=r"failed in observe .*: it returned NoneType, not a sequence of est"):
        list(pipeline)


def test_a_stamp_that_is_no_number_is_an_error_of_the_localizer(fakes) -> None:
    answer = (Lost("now", "no texture"),)  # type: ignore[arg-type]
    pipeline = Pipeline(fakes.parts({"cam": camera(fakes)}, {"floor": fakes.Scripted(lambda frame, belief: answer)}))

    with pytest.raises(RunError, match=r"'floor' failed in observe .*: it returned an estimate with the stamp 'now'"):
        list(pipeline)


def test_a_source_error_ends_the_run_with_what_there_is(fakes) -> None:
    frames = [*fakes.image_frames("cam", [0.0, 0.1]), SourceError("frames/2.png: truncated")]
    pipeline = Pipeline(fakes.parts({"cam": fakes.Recording(frames)}, {"vo": fakes.Mover(Pose2(0.1))}))

    with pytest.raises(SourceError, match="truncated"):
        list(pipeline)

    assert pipeline.result.status == "failed"
    assert len(pipeline.result.trajectories["fused"]) == 2


@pytest.mark.parametrize("where", ["localizer", "source"])
def test_ctrl_c_ends_cleanly_with_what_is_done(fakes, where: str) -> None:
    source = camera(fakes)
    if where == "source":
        source = fakes.Recording([*fakes.image_frames("cam", [0.0, 0.1, 0.2]), fakes.press_ctrl_c])
    said = fakes.Scripted(lambda frame, belief: fakes.press_ctrl_c() if frame.stamp_s > 0.25 else ())
    pipeline = Pipeline(fakes.parts({"cam": source}, {"vo": fakes.Mover(Pose2(0.1)), "floor": said}))

    n_steps = len(list(pipeline))

    assert n_steps == 3
    assert pipeline.result.status == "interrupted"
    assert len(pipeline.result.trajectories["fused"]) == 3
    assert source.log[-1] == "close"


def test_ctrl_c_in_the_callers_own_code_ends_cleanly_too(fakes) -> None:
    source = camera(fakes)
    pipeline = Pipeline(fakes.parts({"cam": source}))

    def look() -> None:
        with pipeline:
            next(pipeline)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        look()
    assert pipeline.result.status == "interrupted"
    assert source.log[-1] == "close"


def test_leaving_early_closes_everything(fakes) -> None:
    source = camera(fakes)
    with Pipeline(fakes.parts({"cam": source})) as pipeline:
        for step in pipeline:
            if step.stamp_s > 0.15:
                break
        assert next(pipeline).stamp_s == pytest.approx(0.3)  # a loop that was left may be taken up again

    assert pipeline.result.status == "interrupted"
    assert pipeline.result.reason == "left before the last frame"
    assert source.log[-1] == "close"
    with pytest.raises(StopIteration):
        next(pipeline)


def test_the_result_of_a_run_that_goes_on_is_an_error(fakes) -> None:
    with Pipeline(fakes.parts({"cam": camera(fakes)})) as pipeline, pytest.raises(RunError, match="has not ended"):
        pipeline.result


def test_a_part_that_does_not_start_is_named_and_the_others_are_closed(fakes) -> None:
    class Broken(Sink):
        def start(self, session):
            raise OSError("no display")

    source, localizer = camera(fakes), fakes.Scripted()
    pipeline = Pipeline(fakes.parts({"cam": source}, {"floor": localizer}, sinks={"viewer": Broken(None)}))

    with pytest.raises(RunError, match="sink 'viewer' failed in start: OSError: no display"):
        pipeline.start()

    assert source.log[-1] == localizer.log[-1] == "close"


def test_a_sink_that_raises_is_named(fakes) -> None:
    class Broken(Sink):
        def on_belief(self, belief):
            raise OSError("disk full")

    pipeline = Pipeline(fakes.parts({"cam": camera(fakes)}, sinks={"disk": Broken(None)}))

    with pytest.raises(RunError, match="sink 'disk' failed in on_belief: OSError: disk full"):
        list(pipeline)

    assert pipeline.result.status == "failed"


def test_a_part_that_does_not_close_fails_the_run_after_all_others_are_closed(fakes) -> None:
    class Sticky(Sink):
        def close(self):
            raise OSError("busy")

    source = camera(fakes, 1)
    pipeline = Pipeline(fakes.parts({"cam": source}, sinks={"disk": Sticky(None)}))

    with pytest.raises(RunError, match="sink 'disk' failed in close: OSError: busy"):
        list(pipeline)

    assert pipeline.result.status == "failed"
    assert source.log[-1] == "close"


def test_hooks_mark_the_ends_of_a_run(fakes) -> None:
    calls = []
    pipeline = Pipeline(
        fakes.parts({"cam": camera(fakes)}, call_hook=lambda name, **given: calls.append((name, sorted(given))))
    )

    list(pipeline)

    assert calls == [("trailmark_run_started", ["run"]), ("trailmark_run_finished", ["result", "run"])]


class TestRobot:
    def test_the_loop_closes_frame_by_frame(self, fakes) -> None:
        robot, chaser = fakes.ToyRobot(), fakes.Chaser(1.0)
        see = fakes.Scripted(lambda frame, belief: (Fix(frame.stamp_s, Pose2(frame.payload.value), fakes.GOOD),))
        pipeline = Pipeline(fakes.parts({"robot": robot}, {"gps": see}, controller=chaser))

        steps = list(pipeline)

        assert robot.x == pytest.approx(1.0)
        assert robot.log[:4] == ["frame 0", "drive", "frame 1", "drive"]  # never a frame ahead of its command
        assert steps[0].command == Velocity(1.0)
        assert robot.commands[-2:] == [Stop("arrived", done=True), Stop("arrived")]
        assert robot.log[-2:] == ["drive", "close"]
        assert (pipeline.result.status, pipeline.result.reason) == ("done", "arrived")

    def test_the_controller_is_asked_control_hz_times_a_second(self, fakes) -> None:
        chaser = fakes.Chaser(1e9)
        source = fakes.Recording(fakes.image_frames("cam", [i / 100 + 0.002 * (i % 2) for i in range(100)]))

        list(Pipeline(fakes.parts({"cam": source}, controller=chaser, control_hz=20.0)))

        assert 20 <= len(chaser.beliefs) <= 21  # the last may be a quarter of a period early

    def test_frames_that_jitter_do_not_halve_the_control_rate(self, fakes) -> None:
        chaser = fakes.Chaser(1e9)
        stamps = [round(i / 70, 3) for i in range(70)]

        list(Pipeline(fakes.parts({"cam": fakes.Recording(fakes.image_frames("cam", stamps))}, controller=chaser)))

        assert len(chaser.beliefs) == 70

    def test_an_error_stops_the_robot_first(self, fakes) -> None:
        robot = fakes.ToyRobot()
        localizers = {"floor": fakes.Scripted(failing_at(0.3, ValueError("no texture")))}

        with pytest.raises(RunError):
            list(Pipeline(fakes.parts({"robot": robot}, localizers, controller=fakes.Chaser(9.0))))

        assert isinstance(robot.commands[-1], Stop)
        assert robot.log[-2:] == ["drive", "close"]

    def test_commands_go_to_sinks_without_a_robot(self, fakes) -> None:
        class Ear(Sink):
            heard = ()

            def on_command(self, stamp_s, command):
                self.heard = (*self.heard, (stamp_s, command))

        ear = Ear(None)
        list(Pipeline(fakes.parts({"cam": camera(fakes, 2)}, controller=fakes.Chaser(9.0), sinks={"ear": ear})))

        assert ear.heard == ((0.0, Velocity(1.0)), (0.1, Velocity(1.0)))

    def test_a_robot_shares_a_stepped_run_with_no_other_source(self, fakes) -> None:
        sources = {"robot": fakes.ToyRobot(), "cam": camera(fakes)}

        with pytest.raises(ConfigError, match="a robot is the only source of its run, and this run has robot, cam"):
            list(Pipeline(fakes.parts(sources, controller=fakes.Chaser(1.0))))

    def test_commands_that_the_robot_does_not_know_are_refused(self, fakes) -> None:
        robot = fakes.ToyRobot(accepts=frozenset({Stop}))

        with pytest.raises(ConfigError, match="Chaser gives Velocity, but the robot takes Stop"):
            list(Pipeline(fakes.parts({"robot": robot}, controller=fakes.Chaser(1.0))))

    def test_a_robot_that_nobody_drives_is_refused(self, fakes) -> None:
        with pytest.raises(ConfigError, match="robot of source 'robot' does not drive by itself: add a controller"):
            list(Pipeline(fakes.parts({"robot": fakes.ToyRobot()})))

    def test_a_robot_that_drives_itself_needs_no_controller_and_gets_no_commands(self, fakes) -> None:
        robot, chaser = fakes.ToyRobot(3), fakes.Chaser(1.0)
        robot.drives_itself = True

        list(Pipeline(fakes.parts({"robot": robot}, controller=chaser)))

        assert chaser.beliefs == []
        assert robot.commands == [Stop("done")]


class TestFeed:
    def test_frames_from_anywhere_go_through_the_same_parts(self, fakes) -> None:
        with Pipeline(
            fakes.parts({}, {"vo": fakes.Mover(Pose2(0.1))}), sensors=[SensorInfo("cam", "image")]
        ) as pipeline:
            steps = [pipeline.feed(frame) for frame in fakes.image_frames("cam", [0.0, 0.1, 0.1, 0.2])]

        assert steps[2] is None  # it repeats a stamp
        assert steps[3].belief.pose_map_base.x == pytest.approx(0.2)
        assert pipeline.result.status == "done"
        assert pipeline.result.counters["source.feed.repeated"] == 1
        with pytest.raises(RunError, match="the run has ended: done"):
            pipeline.feed(fakes.image_frames("cam", [0.3])[0])

    def test_feeding_a_pipeline_with_sources_is_refused(self, fakes) -> None:
        with pytest.raises(ConfigError, match="has sources of its own: iterate over it"):
            Pipeline(fakes.parts({"cam": camera(fakes)})).feed(fakes.image_frames("cam", [0.0])[0])

    def test_feeding_needs_to_know_the_sensors(self, fakes) -> None:
        with pytest.raises(ConfigError, match="before their sensors are known"):
            Pipeline(fakes.parts({})).feed(fakes.image_frames("cam", [0.0])[0])

    def test_a_frame_that_goes_back_is_an_error(self, fakes) -> None:
        with Pipeline(fakes.parts({}), sensors=[SensorInfo("cam", "image")]) as pipeline:
            pipeline.feed(fakes.image_frames("cam", [1.0])[0])
            with pytest.raises(SourceError, match=r"goes back in time: the one before it was at 1\.000000 s$"):
                pipeline.feed(fakes.image_frames("cam", [0.5])[0])


class TestPartsThatFail:
    def test_a_controller_that_raises_is_named_and_the_robot_stops(self, fakes) -> None:
        class Confused(fakes.Chaser):
            def step(self, belief):
                raise ZeroDivisionError("no path ahead")

        robot = fakes.ToyRobot()

        with pytest.raises(RunError, match=r"the controller failed in step at 0\.000000 s: ZeroDivisionError: no path"):
            list(Pipeline(fakes.parts({"robot": robot}, controller=Confused(1.0))))
        assert isinstance(robot.commands[-1], Stop)

    def test_a_robot_that_takes_no_command_ends_the_run_and_is_still_closed(self, fakes, caplog) -> None:
        class Deaf(fakes.ToyRobot):
            def drive(self, command):
                raise OSError("serial port closed")

        robot = Deaf()
        pipeline = Pipeline(fakes.parts({"robot": robot}, controller=fakes.Chaser(1.0)))

        with pytest.raises(RunError, match=r"the robot failed in drive\(Velocity.*OSError: serial port closed"):
            list(pipeline)

        assert "the robot failed in drive(Stop" in caplog.text
        assert robot.log[-1] == "close"
        assert pipeline.result.status == "failed"

    @pytest.mark.parametrize("method", ["apply", "belief"])
    def test_an_estimator_that_raises_is_named(self, fakes, method: str) -> None:
        class Singular(DeadReckoning):
            pass

        def fail(self, *arguments):
            raise ArithmeticError("S is singular")

        setattr(Singular, method, fail)
        parts = fakes.parts(
            {"cam": camera(fakes)}, {"vo": fakes.Mover(Pose2(0.1))}, estimator=Singular(DeadReckoningConfig())
        )

        with pytest.raises(RunError, match=rf"the estimator failed in {method}.*: ArithmeticError: S is singular"):
            list(Pipeline(parts))

    def test_a_ground_truth_that_fails_costs_a_warning(self, fakes, caplog) -> None:
        class Untrue(fakes.Recording):
            def ground_truth(self):
                raise OSError("no such file")

        pipeline = Pipeline(fakes.parts({"cam": Untrue(fakes.image_frames("cam", [0.0]))}))

        list(pipeline)

        assert pipeline.result.ground_truth is None
        assert "source 'cam' gives no ground truth: OSError: no such file" in caplog.text

    def test_a_folder_that_cannot_be_written_ends_the_run(self, fakes, tmp_path) -> None:
        source = camera(fakes)
        pipeline = Pipeline(fakes.parts({"cam": source}), out=tmp_path / "run")
        next(pipeline)
        (tmp_path / "run/timing.json").mkdir()

        with pytest.raises(RunError, match=r"cannot write to .*run: Is a directory"):
            list(pipeline)

        assert source.log[-1] == "close"

    def test_a_start_that_fails_leaves_no_empty_folder(self, fakes, tmp_path) -> None:
        parts = fakes.parts({"cam": camera(fakes)}, start="last")

        with pytest.raises(ConfigError, match="start: last"):
            Pipeline(parts, out=tmp_path / "run").start()

        assert not (tmp_path / "run").exists()


def test_a_frame_that_takes_too_long_between_two_parts_fails_the_run(fakes, monkeypatch) -> None:
    def starve(self, frame):
        raise HangError

    source = camera(fakes)
    pipeline = Pipeline(fakes.parts({"cam": source}))
    pipeline.start()
    monkeypatch.setattr("trailmark.pipeline.run.frame.FrameProcessor._observe", starve)

    with pytest.raises(RunError, match="the run has not come from one frame to the next: it has not come back"):
        list(pipeline)

    assert pipeline.result.status == "failed"
    assert source.log[-1] == "close"


def test_who_has_ended_a_run_for_a_signal_is_not_interrupted_again(fakes, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a busy machine the end takes longer than a request waits before it is raised again."""
    monkeypatch.setattr(interruption, "_request", interruption._Request())
    pipeline = Pipeline(fakes.parts({"cam": camera(fakes)}, {}))
    next(pipeline)
    interruption.ask_to_end(signal.SIGTERM)
    assert interruption.is_due()  # and is raised
    list(pipeline)
    assert pipeline.result.status == "interrupted"

    interruption._request.at_s -= 1.0

    assert not interruption.is_due()
    with interruption.shielded(0.9):  # a step of the end with a limit of its own
        assert interruption.is_due()
    interruption._request.at_s -= 1.0
    with interruption.shielded(0.0):  # as another run begins
        assert interruption.is_due()
