"""Real time, with a clock that passes when somebody waits for it."""

from __future__ import annotations

import math
import threading
from queue import SimpleQueue
from types import SimpleNamespace

import pytest

from trailmark.commands import Stop, Velocity
from trailmark.config import SourceConfig
from trailmark.errors import ConfigError, RunError, SourceError
from trailmark.estimates import Fix
from trailmark.frames import SensorInfo
from trailmark.geometry import Pose2
from trailmark.pipeline import Pipeline


class Device:
    """Makes a live source whose frames come when the test says so."""

    @staticmethod
    def of(fakes, sensor: str = "cam"):
        class Live(fakes.Recording):
            is_live = True

            def __init__(self):
                super().__init__([], [SensorInfo(sensor, "image")])
                self.queue = SimpleQueue()

            def frames(self):
                while (item := self.queue.get()) is not None:
                    if isinstance(item, Exception):
                        raise item
                    yield item

            def close(self):
                self.queue.put(None)
                super().close()

        return Live()


class TestRecorded:
    def test_frames_are_held_to_their_stamps(self, fakes) -> None:
        clock = fakes.FakeClock()
        source = fakes.Recording(fakes.image_frames("cam", [50.0, 50.1, 50.4]))

        seen = [clock.now_s() - 1000.0 for _ in Pipeline(fakes.parts({"cam": source}, pace="realtime"), clock=clock)]

        assert seen == pytest.approx([0.0, 0.1, 0.4])

    def test_a_slow_run_gets_its_frames_late_and_loses_none(self, fakes) -> None:
        clock = fakes.FakeClock()
        source = fakes.Recording(fakes.image_frames("cam", [0.0, 0.1, 0.2]))

        def work_hard(frame, belief):
            clock.t += 0.25
            return ()

        pipeline = Pipeline(
            fakes.parts({"cam": source}, {"slow": fakes.Scripted(work_hard)}, pace="realtime"), clock=clock
        )

        assert len(list(pipeline)) == 3
        assert clock.waits == []
        assert clock.t == pytest.approx(1000.75)

    def test_the_controller_is_asked_between_frames(self, fakes) -> None:
        clock = fakes.FakeClock()
        source = fakes.Recording(fakes.image_frames("cam", [0.0, 1.0]))
        chaser = fakes.Chaser(1e9)
        parts = fakes.parts({"cam": source}, controller=chaser, control_hz=4.0, pace="realtime")

        steps = list(Pipeline(parts, clock=clock))

        assert [round(step.stamp_s, 3) for step in steps] == [0.0, 0.25, 0.5, 0.75, 1.0]
        assert [step.frame is None for step in steps] == [False, True, True, True, False]
        assert all(step.command == Velocity(1.0) for step in steps)

    def test_a_simulated_robot_is_asked_at_frames_alone(self, fakes) -> None:
        robot = fakes.ToyRobot(4)
        parts = fakes.parts({"robot": robot}, controller=fakes.Chaser(1e9), control_hz=1000.0, pace="realtime")

        steps = list(Pipeline(parts, clock=fakes.FakeClock()))

        assert len(steps) == 4


class TestLive:
    def test_frames_are_taken_as_they_come(self, fakes) -> None:
        device, clock = Device.of(fakes), fakes.FakeClock()
        frames = fakes.image_frames("cam", [1000.1, 1000.2])
        for frame in frames:
            clock.scheduled.append((frame.stamp_s, lambda frame=frame: device.queue.put(frame)))
        clock.scheduled.append((1000.3, lambda: device.queue.put(None)))

        steps = list(Pipeline(fakes.parts({"cam": device}, {"vo": fakes.Mover(Pose2(0.1))}), clock=clock))

        assert [step.stamp_s for step in steps] == [1000.1, 1000.2]
        assert steps[-1].belief.pose_map_base.x == pytest.approx(0.1)

    def test_the_controller_is_asked_when_no_frame_comes(self, fakes) -> None:
        device, clock = Device.of(fakes), fakes.FakeClock()
        clock.scheduled = [
            (1000.0, lambda: device.queue.put(fakes.image_frames("cam", [1000.0])[0])),
            (1001.05, lambda: device.queue.put(None)),  # unplugged: the robot is not left alone with its last command
        ]
        chaser = fakes.Chaser(1e9)

        steps = list(Pipeline(fakes.parts({"cam": device}, controller=chaser, control_hz=10.0), clock=clock))

        assert [round(step.stamp_s, 3) for step in steps] == [round(1000 + i / 10, 3) for i in range(11)]
        assert [step.frame is not None for step in steps] == [True] + [False] * 10

    def test_a_robot_whose_motion_ceases_stands_until_it_is_back(self, fakes) -> None:
        def say(frame, belief):  # the wheels pause, the camera goes on
            return () if 1000.45 < frame.stamp_s < 1001.55 else mover.observe(frame, belief)

        device, clock, mover = Device.of(fakes), fakes.FakeClock(), fakes.Mover(Pose2(0.1))
        for frame in fakes.image_frames("cam", [1000 + i / 10 for i in range(19)]):
            clock.scheduled.append((frame.stamp_s, lambda frame=frame: device.queue.put(frame)))
        clock.scheduled.append((1001.85, lambda: device.queue.put(None)))
        parts = fakes.parts({"cam": device}, {"vo": fakes.Scripted(say)}, controller=fakes.Chaser(1e9), control_hz=10.0)

        commands = {round(step.stamp_s, 1): step.command for step in Pipeline(parts, clock=clock)}

        assert commands[1000.8] == Velocity(1.0)
        assert all(isinstance(commands[round(1000 + i / 10, 1)], Stop) for i in range(10, 16))
        assert commands[1001.6] == commands[1001.8] == Velocity(1.0)

    def test_the_oldest_frame_is_dropped_and_counted(self, fakes) -> None:
        device = Device.of(fakes)
        taken, gate = threading.Event(), threading.Event()

        def block(frame, belief):
            taken.set()
            assert gate.wait(10.0)
            return ()

        pipeline = Pipeline(fakes.parts({"cam": device}, {"slow": fakes.Scripted(block)}))
        seen: list[float] = []
        run = threading.Thread(target=lambda: seen.extend(step.stamp_s for step in pipeline))
        run.start()
        device.queue.put(fakes.image_frames("cam", [1.0])[0])
        assert taken.wait(10.0)
        for stamp_s in (2.0, 3.0, 4.0, 5.0):  # while the run is busy with the first
            device.queue.put(fakes.image_frames("cam", [stamp_s])[0])
        device.queue.put(None)
        while pipeline.parts.sources[0].n_frames != 5:
            taken.wait(0.001)
        gate.set()
        run.join(10.0)

        assert seen == [1.0, 4.0, 5.0]
        assert pipeline.result.counters["source.cam.dropped"] == 2

    def test_an_error_of_the_device_reaches_the_run(self, fakes) -> None:
        device, clock = Device.of(fakes), fakes.FakeClock()
        clock.scheduled = [
            (1000.0, lambda: device.queue.put(fakes.image_frames("cam", [1000.0])[0])),
            (1000.1, lambda: device.queue.put(SourceError("camera 0 does not answer"))),
        ]
        pipeline = Pipeline(fakes.parts({"cam": device}), clock=clock)

        with pytest.raises(SourceError, match="camera 0 does not answer"):
            list(pipeline)

        assert pipeline.result.counters["frames"] == 1

    def test_live_and_recorded_sources_do_not_mix(self, fakes) -> None:
        sources = {"cam": Device.of(fakes), "log": fakes.Recording(fakes.scalar_frames("log", [0.0]))}

        with pytest.raises(ConfigError, match="cam live and log recorded: two clocks make no run"):
            list(Pipeline(fakes.parts(sources)))

    def test_a_camera_that_is_behind_the_window_is_told(self, fakes, caplog) -> None:
        from trailmark.clock import RunClock
        from trailmark.pipeline.instruments import Counters
        from trailmark.pipeline.sources.realtime import _Intake

        counters, clock = Counters(), fakes.FakeClock()
        streams = [SimpleNamespace(name=name, sensors=[name], reorder_s=0.3) for name in ("wheels", "cam")]
        intake = _Intake(streams, counters, RunClock(clock))
        for index in range(25):
            (frame,) = fakes.image_frames("wheels", [10.0 + index])
            intake._put(frame)
            assert intake.take(math.inf) is frame
            intake._put(fakes.image_frames("cam", [9.0 + index])[0])

        assert counters["source.cam.late"] == 25
        assert caplog.text.count("20 frames of 'cam' came more than 0.3 s behind those of other sensors") == 1


class TestWorkers:
    def test_a_localizer_beside_the_run_answers_when_it_is_done(self, fakes) -> None:
        busy, gate = threading.Event(), threading.Event()

        def think(frame, belief):
            busy.set()
            assert gate.wait(10.0)
            return (Fix(frame.stamp_s, Pose2(7.0), fakes.GOOD),)

        slow = fakes.Scripted(think)
        source = fakes.Recording(fakes.image_frames("cam", [i / 10 for i in range(5)]))
        parts = fakes.parts({"cam": source}, {"map": slow}, localizer_options={"map": {"async": True}}, pace="realtime")
        pipeline = Pipeline(parts, clock=fakes.FakeClock())

        assert next(pipeline).estimates == ()
        assert busy.wait(10.0)
        for _ in range(4):
            assert next(pipeline).estimates == ()
        gate.set()
        assert next(pipeline, None) is None

        counters = pipeline.result.counters
        n_seen = len(slow.seen)
        assert 1 <= n_seen <= 2  # the first, and perhaps the last, which waited
        assert counters["localizer.map.overwritten"] == 3
        assert n_seen + counters.get("localizer.map.given_up", 0) == 2
        assert counters["localizer.map.accepted"] == n_seen
        assert slow.session.last_latency_s() > 0.0

    def test_an_error_in_a_thread_ends_the_run(self, fakes) -> None:
        asked = threading.Event()

        def fail(frame, belief):
            asked.set()
            raise ValueError("no texture")

        source = fakes.Recording(fakes.image_frames("cam", [0.0]))
        parts = fakes.parts(
            {"cam": source}, {"map": fakes.Scripted(fail)}, localizer_options={"map": {"async": True}}, pace="realtime"
        )
        pipeline = Pipeline(parts, clock=fakes.FakeClock())
        next(pipeline)
        assert asked.wait(10.0)

        with pytest.raises(
            RunError, match=r"localizer 'map' failed in observe at the frame of 'cam' at .*: ValueError: no texture"
        ):
            next(pipeline)

        assert pipeline.result.status == "failed"

    def test_threads_end_with_the_run(self, fakes) -> None:
        before = threading.active_count()
        source = fakes.Recording(fakes.image_frames("cam", [0.0, 0.1]))
        parts = fakes.parts(
            {"cam": source}, {"map": fakes.Scripted()}, localizer_options={"map": {"async": True}}, pace="realtime"
        )

        list(Pipeline(parts, clock=fakes.FakeClock()))

        assert threading.active_count() == before


class TestStampsOfDevices:
    """Whatever gives live frames: one stamp of the future silences nobody."""

    def run(self, fakes, monkeypatch, stamps, **options):
        """Return the run of a device whose frames come every tenth of a second, with these stamps."""
        came_s = iter(0.1 * k for k in range(100))
        monkeypatch.setattr("trailmark.pipeline.sources.stream.live_stamp_s", lambda: next(came_s))
        device = Device.of(fakes)
        for frame in fakes.image_frames("cam", stamps):
            device.queue.put(frame)
        device.queue.put(None)
        parts = fakes.parts({"cam": device}, {"vo": fakes.Mover(Pose2(0.1))}, options={"cam": SourceConfig(**options)})
        return Pipeline(parts)

    def test_it_costs_its_own_frame_alone(self, fakes, monkeypatch) -> None:
        pipeline = self.run(fakes, monkeypatch, [0.0, 0.1, 1e9, 0.3, 0.4], on_bad_frame="skip")

        list(pipeline)

        assert pipeline.counters["source.cam.skipped"] == 1
        assert pipeline.counters["source.cam.frames"] == 4

    def test_it_is_an_error_where_bad_frames_are(self, fakes, monkeypatch) -> None:
        with pytest.raises(SourceError, match=r"the frame of 'cam' at 5000.000000 s is 5000 s ahead of those"):
            list(self.run(fakes, monkeypatch, [0.0, 0.1, 5000.0, 0.3]))

    @pytest.mark.parametrize("on_bad_frame", ["skip", "error"])
    def test_a_run_that_began_in_the_future_ends(self, fakes, monkeypatch, on_bad_frame) -> None:
        with pytest.raises(SourceError, match=r"the first frame of 'cam' was 500 s ahead of all|goes back in time"):
            list(self.run(fakes, monkeypatch, [500.0, 0.1, 0.2, 0.3, 0.4], on_bad_frame=on_bad_frame))
