"""Teaching lays waypoints and commits them with their keyframes; replay uses them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from trailmark.errors import ConfigError, RunError
from trailmark.frames import GroundPlane, SensorInfo
from trailmark.geometry import Pose2
from trailmark.paths import Keyframe, Waypoint
from trailmark.pipeline import Pipeline
from trailmark.pipeline.localizers import LocalizerFailedError
from trailmark.pipeline.teaching import taught_map


def drive(fakes, n: int, step_m: float = 0.0037, rate_hz: float = 70.0):
    return fakes.Recording(fakes.image_frames("floor", [i / rate_hz for i in range(n)])), fakes.Mover(Pose2(step_m))


class Rememberer:
    """Adds a keyframe at every frame."""

    @staticmethod
    def of(fakes):
        def say(frame, belief):
            arrays = {"patch": np.zeros(4, np.uint8)}
            pose = belief.pose_map_base
            localizer.session.map.add(Keyframe(belief.travelled_m, frame.stamp_s, pose, arrays))
            return ()

        localizer = fakes.Scripted(say)
        return localizer


def taught_path(n: int = 21) -> list[Waypoint]:
    return [Waypoint(i, 0.05 * i, Pose2(0.05 * i)) for i in range(n)]


def test_a_waypoint_is_laid_every_spacing_of_the_way(fakes) -> None:
    source, mover = drive(fakes, 271)  # 270 steps of 3.7 mm: 0.999 m
    disk = {}

    list(Pipeline(fakes.parts({"floor": source}, {"vo": mover}, mode="teach", disk=disk)))

    stations = [waypoint.station_m for waypoint in disk["waypoints"]]
    assert len(stations) == 21  # at 0, at 19 multiples of 0.05 m, and where the robot stopped
    assert [waypoint.index for waypoint in disk["waypoints"]] == list(range(21))
    np.testing.assert_allclose(stations[:-1], 0.05 * np.arange(20), atol=0.0037)  # at the frame at or after it
    assert all(np.array(stations[:-1]) >= 0.05 * np.arange(20) - 1e-9)
    assert stations[-1] == pytest.approx(0.999)
    assert all(w.pose_map_base.x == pytest.approx(w.station_m) for w in disk["waypoints"])


def test_a_waypoint_is_committed_with_the_keyframes_since_the_last_one(fakes) -> None:
    source, mover = drive(fakes, 101)
    disk = {}
    pipeline = Pipeline(
        fakes.parts({"floor": source}, {"vo": mover, "map": Rememberer.of(fakes)}, mode="teach", disk=disk)
    )

    list(pipeline)

    commits = [(waypoints, stations) for waypoints, stations in disk["commits"] if waypoints]
    for (waypoints, stations), (before, _) in zip(commits[1:], commits, strict=False):
        assert len(waypoints) == 1
        assert before[0].station_m < min(stations)
        assert max(stations) <= waypoints[0].station_m
    assert sum(len(stations) for _, stations in disk["commits"]) == 101
    assert pipeline.n_waypoints == len(disk["waypoints"])
    assert pipeline.result.counters["teach.waypoints"] == len(disk["waypoints"])


def test_at_the_end_every_localizer_finishes_and_that_is_written_down(fakes) -> None:
    source, mover = drive(fakes, 50)
    disk = {}

    list(Pipeline(fakes.parts({"floor": source}, {"vo": mover}, mode="teach", disk=disk)))

    assert mover.log == ["start teach", "finish", "close"]
    assert disk["log"] == ["create", "finished vo", "close"]
    assert set(disk["sensors"]) == {"floor"}
    assert {"trailmark", "git", "started", "config"} <= set(disk["meta"])


def test_ctrl_c_is_how_a_person_ends_teaching(fakes) -> None:
    disk = {}
    source = fakes.Recording([*fakes.image_frames("floor", [i / 70 for i in range(60)]), fakes.press_ctrl_c])
    mover = fakes.Mover(Pose2(0.0037))

    list(pipeline := Pipeline(fakes.parts({"floor": source}, {"vo": mover}, mode="teach", disk=disk)))

    assert pipeline.result.status == "interrupted"
    assert "finished vo" in disk["log"]
    assert disk["waypoints"][-1].station_m > 0.2


def test_after_an_error_what_was_committed_stays_and_nothing_is_finished(fakes) -> None:
    disk = {"unfinished": {"vo"}}
    source = fakes.Recording([*fakes.image_frames("floor", [i / 70 for i in range(60)]), OSError("unplugged")])

    with pytest.raises(Exception, match="unplugged"):
        list(Pipeline(fakes.parts({"floor": source}, {"vo": fakes.Mover(Pose2(0.0037))}, mode="teach", disk=disk)))

    assert len(disk["waypoints"]) == 5
    assert disk["unfinished"] == {"vo"}


def test_a_localizer_that_cannot_finish_fails_the_run(fakes) -> None:
    class Stubborn(fakes.Scripted):
        def finish(self):
            raise ValueError("no landmark")

    source, mover = drive(fakes, 50)
    pipeline = Pipeline(fakes.parts({"floor": source}, {"vo": mover, "map": Stubborn()}, mode="teach", disk={}))

    with pytest.raises(RunError, match="localizer 'map' failed in finish: ValueError: no landmark"):
        list(pipeline)

    assert pipeline.result.status == "failed"


@pytest.mark.parametrize("fails_again", [False, True])
def test_one_that_is_switched_off_still_moves_what_it_remembers(fakes, monkeypatch, caplog, fails_again: bool) -> None:
    calls = []

    def straighten(store, localizers, switched_off) -> int:
        calls.append([[part.name for part in parts] for parts in (localizers, switched_off)])
        if len(calls) == 1 or fails_again:
            raise LocalizerFailedError("localizer 'map' failed in moved: ValueError: broken")
        return 7

    monkeypatch.setattr(taught_map, "close_loops", straighten)
    source, mover = drive(fakes, 50)
    localizers = {"vo": mover, "map": fakes.Scripted()}
    options = {"map": {"on_error": "disable"}}
    pipeline = Pipeline(fakes.parts({"floor": source}, localizers, localizer_options=options, mode="teach", disk={}))

    list(pipeline)

    assert calls == [[["vo", "map"], []], [["vo"], ["map"]]]
    assert pipeline.result.counters.get("teach.loops", 0) == (0 if fails_again else 7)
    assert ("loops stay open" in caplog.text) == fails_again


@pytest.mark.parametrize(("n", "when"), [(10, "in the whole recording"), (500, "after 5 s")])
def test_teaching_without_motion_is_refused_with_a_hint(fakes, n: int, when: str) -> None:
    source, _ = drive(fakes, n)

    with pytest.raises(ConfigError, match=rf"teaching needs motion, and {when}.*'odometry'.*or 'constant_speed'"):
        list(Pipeline(fakes.parts({"floor": source}, {"map": fakes.Scripted()}, mode="teach", disk={})))


def test_a_place_that_could_not_be_taught_is_as_it_was(fakes) -> None:
    disk = {}
    source, silent = drive(fakes, 100)[0], fakes.Scripted(lambda frame, belief: ())

    with pytest.raises(ConfigError, match="teaching needs motion"):
        list(Pipeline(fakes.parts({"floor": source}, {"vo": silent}, mode="teach", disk=disk)))

    assert disk["commits"] == []


def test_the_first_waypoint_is_where_the_robot_stood_before_it_moved(fakes) -> None:
    frames = fakes.Recording(fakes.image_frames("floor", [0.5 * i for i in range(6)]))
    mover = fakes.Mover(Pose2(0.1))
    disk = {}

    list(Pipeline(fakes.parts({"floor": frames}, {"vo": mover}, mode="teach", disk=disk)))

    assert disk["waypoints"][0] == Waypoint(0, 0.0, Pose2())
    assert disk["waypoints"][1].station_m == pytest.approx(0.1)


def test_teaching_from_nowhere_is_refused(fakes) -> None:
    source, mover = drive(fakes, 20)

    with pytest.raises(ConfigError, match="nothing was taught, because the pose was never known"):
        list(Pipeline(fakes.parts({"floor": source}, {"vo": mover}, mode="teach", disk={}, start="unknown")))


def test_a_path_is_continued_where_it_ended(fakes) -> None:
    disk = {"waypoints": taught_path(), "keyframes": [], "commits": []}
    source, mover = drive(fakes, 101, 0.01)
    parts = fakes.parts(
        {"floor": source}, {"vo": mover, "map": Rememberer.of(fakes)}, mode="teach", disk=disk, start="last"
    )

    list(Pipeline(parts))

    stations = [waypoint.station_m for waypoint in disk["waypoints"]]
    assert len(stations) == 41
    np.testing.assert_allclose(np.diff(stations), 0.05, atol=1e-9)
    assert disk["waypoints"][-1].pose_map_base.x == pytest.approx(2.0)
    assert disk["keyframes"][0][1].station_m == pytest.approx(1.0)  # keyframes go on like waypoints
    assert disk["keyframes"][-1][1].station_m == pytest.approx(2.0)


class TestReplay:
    @pytest.mark.parametrize(
        ("start", "pose"),
        [("first", Pose2()), ("last", Pose2(1.0)), ("unknown", None), ((0.3, 0.1, 90.0), Pose2(0.3, 0.1, math.pi / 2))],
    )
    def test_it_starts_where_the_config_says(self, fakes, start, pose) -> None:
        disk = {"waypoints": taught_path()}
        source, mover = drive(fakes, 3)

        first, *_ = Pipeline(fakes.parts({"floor": source}, {"vo": mover}, mode="replay", disk=disk, start=start))

        assert first.belief.pose_map_base == pose
        assert mover.session.start_pose == pose
        assert len(mover.session.path) == 21
        assert disk["log"] == ["read", "close"]
        if pose is not None:
            assert first.belief.on_path.station_m == pytest.approx(pose.x)

    def test_a_path_that_is_straightened_first_is_the_one_that_is_followed(self, fakes, monkeypatch) -> None:
        disk = {"waypoints": taught_path(), "unfinished": {"map"}}
        straight = [replace(one, pose_map_base=Pose2(0.0, 0.5) @ one.pose_map_base) for one in taught_path()]

        def straighten(store, localizers, switched_off) -> int:
            disk["waypoints"] = straight
            return 1

        monkeypatch.setattr(taught_map, "close_loops", straighten)
        source, mover = drive(fakes, 3)
        localizers = {"vo": mover, "map": fakes.Scripted()}
        pipeline = Pipeline(fakes.parts({"floor": source}, localizers, mode="replay", disk=disk, start="last"))

        first, *_ = pipeline

        assert mover.session.path.waypoints == tuple(straight)
        assert mover.session.start_pose == first.belief.pose_map_base == Pose2(1.0, 0.5)
        assert first.belief.on_path.lateral_m == pytest.approx(0.0)

    def test_what_an_interrupted_teaching_left_is_finished_first(self, fakes) -> None:
        disk = {"waypoints": taught_path(), "unfinished": {"map"}}
        source, mover = drive(fakes, 3)
        mapper = fakes.Scripted()

        list(Pipeline(fakes.parts({"floor": source}, {"vo": mover, "map": mapper}, mode="replay", disk=disk)))

        assert disk["log"][:5] == ["read", "close", "append", "finished map", "close"]
        assert disk["log"][5] == "read"
        assert mapper.log[:4] == ["start teach", "finish", "close", "start replay"]
        assert mover.log[0] == "start replay"

    def test_a_sensor_that_has_changed_since_is_named(self, fakes, caplog) -> None:
        old = SensorInfo("floor", "image", calibration=GroundPlane((1e-3, 1e-3)))
        source, mover = drive(fakes, 3)
        parts = fakes.parts(
            {"floor": source},
            {"vo": mover},
            mode="replay",
            disk={"waypoints": taught_path(), "sensors": {"floor": old}},
        )

        list(Pipeline(parts))

        assert "sensor 'floor' is not as it was when the path was taught: calibration" in caplog.text

    def test_without_a_store_it_is_refused(self, fakes) -> None:
        source, mover = drive(fakes, 3)

        with pytest.raises(ConfigError, match="mode replay needs a path store"):
            list(Pipeline(fakes.parts({"floor": source}, {"vo": mover}, mode="replay")))

    def test_without_a_path_it_is_refused(self, fakes) -> None:
        source, mover = drive(fakes, 3)

        with pytest.raises(ConfigError, match="holds no path yet"):
            list(Pipeline(fakes.parts({"floor": source}, {"vo": mover}, mode="replay", disk={})))

    def test_the_end_of_a_path_that_is_not_there_is_no_start(self, fakes) -> None:
        source, mover = drive(fakes, 3)

        with pytest.raises(ConfigError, match="start: last needs a taught path"):
            list(Pipeline(fakes.parts({"floor": source}, {"vo": mover}, start="last")))
