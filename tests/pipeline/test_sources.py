"""Sources with their options, checked, counted and merged."""

from __future__ import annotations

import logging
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trailmark.config import Mounting, SensorOverride, SourceConfig
from trailmark.errors import ConfigError, DataError, RunError, SourceError
from trailmark.frames import RGBD, Frame, GroundPlane, Image, Record, Scalar, SensorInfo
from trailmark.geometry import Pose2, Trajectory, write_tum
from trailmark.interfaces import Session
from trailmark.pipeline import Pipeline, SourceStream


def stamps_of(fakes, sources, **fields) -> list[tuple[str, float]]:
    return [(step.frame.sensor, round(step.stamp_s, 6)) for step in Pipeline(fakes.parts(sources, **fields))]


class TestLife:
    @pytest.mark.parametrize(("method", "arguments"), [("start", [Session(name="lamp")]), ("close", [])])
    def test_who_starts_a_source_alone_is_told_which_one_failed(self, fakes, monkeypatch, method, arguments) -> None:
        def fails(*_) -> None:
            raise ValueError("nothing is plugged in")

        source = fakes.Recording(fakes.scalar_frames("light", [0.0]))
        monkeypatch.setattr(source, method, fails)
        stream = SourceStream("lamp", source, SourceConfig())

        with pytest.raises(RunError, match=f"^source 'lamp' failed in {method}: ValueError: nothing is plugged in$"):
            getattr(stream, method)(*arguments)


class TestOptions:
    def test_an_offset_moves_stamps_and_ground_truth(self, fakes) -> None:
        truth = Trajectory.from_poses([(0.0, Pose2()), (1.0, Pose2(1.0))])
        source = fakes.Recording(fakes.scalar_frames("light", [0.0, 1.0]), truth=truth)
        pipeline = Pipeline(fakes.parts({"light": source}, options={"light": SourceConfig(time_offset_s=10.0)}))

        assert [step.stamp_s for step in pipeline] == [10.0, 11.0]
        assert pipeline.result.ground_truth.stamps_s.tolist() == [10.0, 11.0]

    def test_a_window_is_counted_from_the_first_frame(self, fakes) -> None:
        source = fakes.Recording(fakes.scalar_frames("light", [100.0, 101.0, 102.0, 103.0, 104.0]))
        options = {"light": SourceConfig(start_s=1.0, stop_s=3.0)}

        assert stamps_of(fakes, {"light": source}, options=options) == [("light", s) for s in (101.0, 102.0, 103.0)]

    def test_sensors_are_renamed_in_frames_and_sessions(self, fakes) -> None:
        source = fakes.Recording(fakes.scalar_frames("light", [0.0]))
        eye = fakes.Scripted()
        pipeline = Pipeline(
            fakes.parts({"s": source}, {"eye": eye}, options={"s": SourceConfig(rename={"light": "lamp"})})
        )

        assert [step.frame.sensor for step in pipeline] == ["lamp"]
        assert eye.session.sensors["lamp"].name == "lamp"

    def test_renaming_what_is_not_there_is_refused(self, fakes) -> None:
        source = fakes.Recording(fakes.scalar_frames("light", [0.0]))
        options = {"s": SourceConfig(rename={"lihgt": "lamp"})}

        with pytest.raises(ConfigError, match=r"sources.s.rename: the source has no sensor 'lihgt'; it has light"):
            list(Pipeline(fakes.parts({"s": source}, options=options)))

    def test_mounting_and_calibration_correct_the_only_sensor(self, fakes) -> None:
        eye = fakes.Scripted()
        source = fakes.Recording(fakes.image_frames("floor", [0.0]))
        options = SourceConfig(mounting=Mounting(x=0.1, yaw_deg=180.0))
        stream = SourceStream("floor", source, options, GroundPlane((1e-3, 1e-3)))
        override = SensorOverride(mounting=Mounting(x=0.2))

        list(Pipeline(replace(fakes.parts({}, {"eye": eye}, sensors={"floor": override}), sources=[stream])))

        info = eye.session.sensors["floor"]
        assert info.calibration.metres_per_pixel == (1e-3, 1e-3)
        assert (info.pose_base_sensor.x, info.pose_base_sensor.yaw) == (0.2, 0.0)  # sensors: has the last word
        assert stream.sensors["floor"].pose_base_sensor.yaw == pytest.approx(math.pi)

    def test_a_calibration_for_several_sensors_is_refused(self, fakes) -> None:
        source = fakes.Recording([], [SensorInfo("a", "scalar"), SensorInfo("b", "scalar")])
        options = {"s": SourceConfig(mounting=Mounting())}

        with pytest.raises(
            ConfigError, match="for a source of one sensor, and this one has a, b; write them under sens"
        ):
            list(Pipeline(fakes.parts({"s": source}, options=options)))

    def test_a_ground_truth_file_is_read_before_the_run(self, fakes, tmp_path) -> None:
        good, bad = tmp_path / "truth.tum", tmp_path / "bad.tum"
        write_tum(good, Trajectory.from_poses([(0.0, Pose2(1.0, 2.0, 0.0))]))
        bad.write_text("1 2 3\n")

        def pipeline(path):
            source = fakes.Recording(fakes.scalar_frames("light", [0.0]))
            return Pipeline(fakes.parts({"light": source}, options={"light": SourceConfig(ground_truth=str(path))}))

        run = pipeline(good)
        assert len(list(run)) == 1
        assert run.result.ground_truth.poses[0, 1] == 2.0
        with pytest.raises(DataError, match=r"bad.tum:1: expected 8 numbers"):
            next(pipeline(bad))


class TestChecks:
    def run(self, fakes, frames, sensors=(), **options):
        pipeline = Pipeline(
            fakes.parts({"s": fakes.Recording(frames, sensors)}, options={"s": SourceConfig(**options)})
        )
        n_steps = len(list(pipeline))
        return n_steps, pipeline.result.counters

    def test_a_repeated_stamp_is_dropped_and_counted(self, fakes) -> None:
        n_steps, counters = self.run(fakes, fakes.scalar_frames("light", [0.0, 1.0, 1.0, 1.0, 2.0]))

        assert n_steps == 3
        assert counters["source.s.repeated"] == 2

    @pytest.mark.parametrize(
        ("frames", "message"),
        [
            ([Scalar(1.0), Image(np.zeros((2, 2), np.uint8))], "carries image, but the sensor is of kind scalar"),
            ([Scalar(1.0), Record({})], "carries record, but the sensor is of kind scalar"),
            (
                [Image(np.zeros((2, 2), np.uint8)), Image(np.zeros((2, 3), np.uint8))],
                r"changes from \(2, 2\) uint8 to \(2, 3\) uint8",
            ),
            (
                [
                    RGBD(np.zeros((2, 2, 3), np.uint8), np.zeros((2, 2), np.float32)),
                    RGBD(np.zeros((2, 2, 3), np.uint8), np.zeros((1, 2), np.float32)),
                ],
                "changes from",
            ),
        ],
    )
    def test_a_frame_that_is_not_what_it_was_is_an_error_or_a_counted_skip(self, fakes, frames, message) -> None:
        bad = [Frame("x", float(i), payload) for i, payload in enumerate(frames)]
        kind = {Scalar: "scalar", Image: "image", RGBD: "rgbd"}[type(frames[0])]

        with pytest.raises(SourceError, match=rf"source 's': the frame of 'x' at 1.000000 s {message}"):
            self.run(fakes, bad, [SensorInfo("x", kind)])
        n_steps, counters = self.run(fakes, bad, [SensorInfo("x", kind)], on_bad_frame="skip")
        assert (n_steps, counters["source.s.skipped"]) == (1, 1)

    def test_the_first_skipped_frame_of_a_sensor_is_told(self, fakes, caplog) -> None:
        sizes = [2, 2, 3, 3, 2]
        frames = [Frame("x", float(i), Image(np.zeros((2, size), np.uint8))) for i, size in enumerate(sizes)]

        self.run(fakes, frames, [SensorInfo("x", "image")], on_bad_frame="skip")

        assert "the frame of 'x' at 2.000000 s changes from" in caplog.text
        assert caplog.text.count("changes from") == 1

    def test_of_a_sensor_with_several_problems_each_is_told_once(self, fakes, caplog) -> None:
        pictures = {stamp_s: Image(np.zeros((2, 2), np.uint8)) for stamp_s in (0.0, 1.0, 0.5, 3.0, 2.5)}
        pictures |= {5.0: Image(np.zeros((2, 3), np.uint8)), 6.0: Image(np.zeros((2, 4), np.uint8))}
        frames = [Frame("x", stamp_s, picture) for stamp_s, picture in pictures.items()]

        self.run(fakes, frames, [SensorInfo("x", "image")], on_bad_frame="skip")

        assert caplog.text.count("goes back in time") == 1
        assert caplog.text.count("changes from") == 1

    def test_a_stamp_that_goes_back_is_an_error_or_a_counted_skip(self, fakes) -> None:
        frames = fakes.scalar_frames("light", [0.0, 2.0, 1.0, 3.0])

        with pytest.raises(
            SourceError, match=r"goes back in time: the one before it was at 2\.000000 s; 'on_bad_frame: sk"
        ):
            self.run(fakes, frames)
        assert self.run(fakes, frames, on_bad_frame="skip")[0] == 3

    # Not two at the beginning: of the first three, the majority would be wrong.
    @pytest.mark.parametrize(("at", "n_wrong"), [(0, 1), (1, 1), (1, 2), (25, 1), (25, 2), (48, 1), (48, 2), (49, 1)])
    def test_a_frame_of_the_future_costs_itself_alone(self, fakes, at: int, n_wrong: int) -> None:
        stamps = [100.0 + i / 10 for i in range(50)]
        for index in range(at, at + n_wrong):
            stamps[index] = 4.1e9 + index  # the year 2100

        n_steps, counters = self.run(fakes, fakes.scalar_frames("light", stamps), on_bad_frame="skip")

        assert (n_steps, counters["source.s.skipped"]) == (50 - n_wrong, n_wrong)

    def test_a_window_does_not_end_at_a_frame_of_the_future(self, fakes) -> None:
        stamps = [0.0, 0.1, 4.1e9, 0.2, 0.3, 9.0]

        n_steps, _ = self.run(fakes, fakes.scalar_frames("light", stamps), on_bad_frame="skip", stop_s=5.0)

        assert n_steps == 4

    @settings(max_examples=60, deadline=None)
    @given(st.lists(st.sampled_from([0.1, 1.0, 9.0, 11.0, 60.0, 5000.0]), min_size=1, max_size=12))
    def test_pauses_cost_no_frame(self, fakes, steps_s: list[float]) -> None:
        stamps = [sum(steps_s[:i]) for i in range(1, len(steps_s) + 1)]

        n_steps, counters = self.run(fakes, fakes.scalar_frames("light", stamps), on_bad_frame="skip")

        assert (n_steps, counters.get("source.s.skipped", 0)) == (len(stamps), 0)

    def test_sensors_of_one_source_come_in_one_order(self, fakes) -> None:
        frames = [*fakes.scalar_frames("a", [1.0]), *fakes.scalar_frames("b", [0.5])]

        with pytest.raises(
            SourceError, match=r"'b' at 0.500000 s is older than the source's frame before it \(1.000000 s\)"
        ):
            self.run(fakes, frames)

    def test_the_announced_size_must_be_that_of_the_frames(self, fakes) -> None:
        frames = fakes.image_frames("cam", [0.0])

        with pytest.raises(SourceError, match="is 3x2 px, but the sensor is 640x480 px"):
            self.run(fakes, frames, [SensorInfo("cam", "image", size=(640, 480))])

    def test_an_unknown_sensor_is_an_error(self, fakes) -> None:
        with pytest.raises(SourceError, match=r"'light' at 0.000000 s is of none of its sensors \(lamp\)"):
            self.run(fakes, fakes.scalar_frames("light", [0.0]), [SensorInfo("lamp", "scalar")])

    def test_what_a_source_raises_is_a_source_error_that_names_it(self, fakes) -> None:
        with pytest.raises(SourceError, match="source 's' failed in frames: ZeroDivisionError: by zero"):
            self.run(fakes, [*fakes.scalar_frames("light", [0.0]), ZeroDivisionError("by zero")])
        with pytest.raises(SourceError, match=r"^frames/7.png:"):
            self.run(fakes, [*fakes.scalar_frames("light", [0.0]), SourceError("frames/7.png: truncated")])

    def test_a_source_without_a_frame_is_an_error(self, fakes) -> None:
        with pytest.raises(SourceError, match=r"source 's' gave no frame$"):
            self.run(fakes, [], [SensorInfo("light", "scalar")])
        with pytest.raises(SourceError, match=r"gave no frame in its window \(start_s, stop_s\)"):
            self.run(fakes, fakes.scalar_frames("light", [0.0, 1.0]), start_s=5.0)


class TestMerge:
    def test_frames_come_by_stamp_and_ties_in_the_order_of_the_config(self, fakes) -> None:
        sources = {
            "b": fakes.Recording(fakes.scalar_frames("b", [0.0, 1.0, 2.0])),
            "a": fakes.Recording(fakes.scalar_frames("a", [0.5, 1.0, 1.5])),
        }

        assert stamps_of(fakes, sources) == [("b", 0.0), ("a", 0.5), ("b", 1.0), ("a", 1.0), ("a", 1.5), ("b", 2.0)]

    @settings(max_examples=40, deadline=None)
    @given(st.lists(st.lists(st.integers(0, 20), min_size=1, unique=True), min_size=1, max_size=4))
    def test_any_sources_come_out_as_if_sorted(self, fakes, stamps: list[list[int]]) -> None:
        everywhere = [[-1, *sorted(some), 21] for some in stamps]  # they begin and end together
        sources = {
            f"s{i}": fakes.Recording(fakes.scalar_frames(f"s{i}", map(float, some)))
            for i, some in enumerate(everywhere)
        }

        expected = sorted((float(stamp), i) for i, some in enumerate(everywhere) for stamp in some)

        assert stamps_of(fakes, sources) == [(f"s{i}", stamp) for stamp, i in expected]

    def test_frames_are_pulled_one_at_a_time(self, fakes) -> None:
        source = fakes.Recording(fakes.scalar_frames("a", [0.0, 1.0, 2.0]))
        pipeline = Pipeline(fakes.parts({"a": source}))

        next(pipeline)
        assert source.log == ["start", "pull 0"]
        next(pipeline)
        assert source.log == ["start", "pull 0", "pull 1"]
        pipeline.close()

    def test_sources_that_do_not_overlap_are_refused_naming_both(self, fakes) -> None:
        sources = {
            "front": fakes.Recording(fakes.scalar_frames("front", [0.0, 1.0])),
            "wheels": fakes.Recording(fakes.scalar_frames("wheels", [5.0, 6.0])),
        }

        with pytest.raises(
            ConfigError, match=r"'front' and 'wheels' do not overlap in time.*wheels.time_offset_s: -5.000"
        ):
            list(Pipeline(fakes.parts(sources)))

    def test_sources_one_after_the_other_are_fine_while_a_third_goes_on(self, fakes) -> None:
        sources = {
            "first": fakes.Recording(fakes.scalar_frames("first", [0.0, 1.0])),
            "second": fakes.Recording(fakes.scalar_frames("second", [2.0, 3.0])),
            "wheels": fakes.Recording(fakes.scalar_frames("wheels", [0.5, 1.5, 2.5])),
        }

        assert len(stamps_of(fakes, sources)) == 7

    def test_clocks_that_differ_by_hours_are_noticed_at_once(self, fakes, caplog) -> None:
        sources = {
            "front": fakes.Recording(fakes.scalar_frames("front", [0.0, 1.0])),
            "wheels": fakes.Recording(fakes.scalar_frames("wheels", [1.7e9])),
        }
        pipeline = Pipeline(fakes.parts(sources))

        with caplog.at_level(logging.WARNING):
            next(pipeline)

        assert "source 'wheels' begins 1700000000 s after 'front'" in caplog.text
        pipeline.close()


def test_ground_truth_beyond_all_reason_is_a_warning(fakes, caplog) -> None:
    truth = Trajectory.from_poses([(0.0, Pose2()), (1.0, Pose2(-1e300))])
    source = fakes.Recording(fakes.scalar_frames("light", [0.0, 1.0]), truth=truth)

    with Pipeline(fakes.parts({"light": source})) as pipeline:
        list(pipeline)

    assert pipeline.result.ground_truth is None
    assert "source 'light' gives no ground truth: ValueError: it reaches 1e+300 m" in caplog.text


class TestLasting:
    """How long a source says it lasts is for a bar alone."""

    @pytest.mark.parametrize("told", ["5", math.nan, math.inf, -1.0, 0, 10**400, [5.0], None])
    def test_what_is_no_length_is_not_known(self, fakes, told: object) -> None:
        source = fakes.Recording(fakes.scalar_frames("light", [0.0]))
        source.lasts_s = lambda: told

        assert SourceStream("s", source, SourceConfig()).lasts_s() is None
        assert SourceStream("s", source, SourceConfig(stop_s=3.0)).lasts_s() == 3.0

    def test_one_that_fails_to_say_ends_no_run(self, fakes, caplog: pytest.LogCaptureFixture) -> None:
        source = fakes.Recording(fakes.scalar_frames("light", [0.0]))
        source.lasts_s = lambda: 1 / 0

        with caplog.at_level(logging.DEBUG):
            assert SourceStream("s", source, SourceConfig()).lasts_s() is None
        assert "source 's' does not say how long it lasts: " in caplog.text

    @pytest.mark.parametrize(("start_s", "left_s"), [(0.0, 5.0), (2.0, 3.0), (5.0, None), (9.0, None)])
    def test_the_time_is_that_of_the_window(self, fakes, start_s: float, left_s: float | None) -> None:
        source = fakes.Recording(fakes.scalar_frames("light", [0.0]))
        source.lasts_s = lambda: np.float32(5.0)

        assert SourceStream("s", source, SourceConfig(start_s=start_s)).lasts_s() == left_s
