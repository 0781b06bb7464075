"""The folder of a run."""

from __future__ import annotations

import csv
import json
import math

import numpy as np
import pytest

from trailmark.errors import ConfigError
from trailmark.estimates import Fix, Lost, Motion, PathOffset, information_from_sigmas
from trailmark.frames import GroundPlane, SensorInfo
from trailmark.geometry import Pose2, Trajectory, read_tum
from trailmark.paths import Waypoint
from trailmark.pipeline import Pipeline, new_folder
from trailmark.pipeline.outputs.recorder import ESTIMATE_COLUMNS


def noisy(fakes):
    """A localizer that draws its motion from its own random numbers."""

    def say(frame, belief):
        if len(localizer.seen) == 1:
            return ()
        x, y, theta = localizer.session.rng.normal(0.0, [0.1, 0.01, 0.05])
        return (Motion(localizer.seen[-2][0].stamp_s, frame.stamp_s, Pose2(x, y, theta), fakes.GOOD),)

    localizer = fakes.Scripted(say)
    return localizer


def recorded(fakes, folder, seed: int = 0, n: int = 50):
    def look(frame, belief):
        if frame.stamp_s < 1.0:
            return (Lost(frame.stamp_s, "no landmark, yet"),)
        return (Fix(frame.stamp_s, Pose2(frame.stamp_s, 1.0, 0.0), fakes.GOOD, {"score": np.float64(0.5)}),)

    info = SensorInfo("cam", "image", calibration=GroundPlane((1e-3, 1e-3)))
    truth = Trajectory.from_poses([(0.0, Pose2()), (5.0, Pose2(5.0, 1.0, 0.1))])
    source = fakes.Recording(fakes.image_frames("cam", [i / 10 for i in range(n)]), [info], truth)
    localizers = {"vo": noisy(fakes), "map": fakes.Scripted(look)}
    localizer_options = {"map": {"async": True, "latency_ms": 350}}
    pipeline = Pipeline(
        fakes.parts({"cam": source}, localizers, localizer_options=localizer_options, seed=seed), out=folder
    )
    list(pipeline)
    return pipeline.result


def test_the_same_seed_gives_the_same_bytes(fakes, tmp_path) -> None:
    for name in ("a", "b"):
        recorded(fakes, tmp_path / name, seed=3)
    recorded(fakes, tmp_path / "other", seed=4)

    for name in ("estimates.csv", "trajectories/vo.tum", "trajectories/map.tum", "trajectories/fused.tum"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert (tmp_path / "a/estimates.csv").read_bytes() != (tmp_path / "other/estimates.csv").read_bytes()


def test_every_estimate_is_a_row(fakes, tmp_path) -> None:
    result = recorded(fakes, tmp_path / "run")
    with (tmp_path / "run/estimates.csv").open() as file:
        rows = list(csv.DictReader(file))

    assert tuple(rows[0]) == ESTIMATE_COLUMNS
    lost, fix = (next(row for row in rows if row["kind"] == kind) for kind in ("lost", "fix"))
    motion = next(row for row in rows if row["kind"] == "motion")
    assert (lost["x"], lost["info_xx"], lost["reason"]) == ("", "", "no landmark, yet")
    assert float(fix["arrived_s"]) > float(fix["stamp_s"])  # beside the run
    assert (fix["since_s"], fix["status"], fix["details"]) == ("", "accepted", '{"score":0.5}')
    assert float(fix["x"]) == float(fix["stamp_s"])
    assert float(fix["info_tt"]) == pytest.approx(1e6)
    assert float(motion["since_s"]) == 0.0
    n_by_status = sum(n for name, n in result.counters.items() if name.endswith((".accepted", ".unused")))
    assert len(rows) == n_by_status


def test_a_path_offset_stands_as_station_lateral_heading(fakes, tmp_path) -> None:
    information = information_from_sigmas(math.inf, 0.1, 0.2)
    see = fakes.Scripted(lambda frame, belief: (PathOffset(frame.stamp_s, 0.3, 0.2, 0.1, information),))
    source = fakes.Recording(fakes.image_frames("cam", [0.0]))
    disk = {"waypoints": [Waypoint(i, 0.5 * i, Pose2(0.5 * i)) for i in range(3)]}

    list(Pipeline(fakes.parts({"cam": source}, {"divs": see}, mode="replay", disk=disk), out=tmp_path / "run"))

    with (tmp_path / "run/estimates.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert [row[key] for key in ("kind", "x", "y", "theta", "info_xx")] == ["path_offset", "0.3", "0.2", "0.1", "0.0"]


def test_trajectories_are_those_of_each_localizer_by_itself(fakes, tmp_path) -> None:
    result = recorded(fakes, tmp_path / "run")
    folder = tmp_path / "run/trajectories"

    assert sorted(path.name for path in folder.iterdir()) == ["fused.tum", "groundtruth.tum", "map.tum", "vo.tum"]
    seen = read_tum(folder / "map.tum")
    np.testing.assert_allclose(seen.poses[:, 0], seen.stamps_s, atol=1e-8)  # its own fixes, at their own stamps
    assert len(read_tum(folder / "fused.tum")) == 50
    np.testing.assert_allclose(read_tum(folder / "vo.tum").poses, result.trajectories["vo"].poses, atol=1e-8)


def test_run_and_timing_say_what_the_contract_promises(fakes, tmp_path) -> None:
    recorded(fakes, tmp_path / "run")
    run = json.loads((tmp_path / "run/run.json").read_text())
    timing = json.loads((tmp_path / "run/timing.json").read_text())

    assert {"trailmark", "command", "started", "duration_s", "python", "platform", "cpu", "plugins", "git"} <= set(run)
    assert (run["status"], run["mode"], run["pace"], run["seed"]) == ("done", "track", "step", 0)
    assert run["packages"]["numpy"] == np.__version__
    assert run["sensors"]["cam"]["calibration"]["metres_per_pixel"] == [1e-3, 1e-3]
    assert run["counters"]["frames"] == 50
    assert "estimates.csv" in run["files"]
    assert "trajectories/vo.tum" in run["files"]
    assert (timing["frames"], timing["stages"]["localizer.vo"]["n"]) == (50, 50)
    assert {"source.cam", "estimator", "sink.recorder", "start.localizer.vo"} <= set(timing["stages"])
    assert set(timing["stages"]["estimator"]) == {"n", "mean_ms", "p50_ms", "p95_ms", "p99_ms", "max_ms"}
    assert timing["peak_rss_mb"] is None or timing["peak_rss_mb"] > 10


def test_a_run_that_fails_leaves_what_there_was(fakes, tmp_path) -> None:
    frames = [*fakes.image_frames("cam", [0.0, 0.1, 0.2]), OSError("unplugged")]
    pipeline = Pipeline(fakes.parts({"cam": fakes.Recording(frames)}, {"vo": fakes.Mover(Pose2(0.1))}), out=tmp_path)

    with pytest.raises(Exception, match="unplugged"):
        list(pipeline)

    run = json.loads((tmp_path / "run.json").read_text())
    assert (run["status"], run["counters"]["frames"]) == ("failed", 3)
    assert "unplugged" in run["reason"]
    assert len((tmp_path / "estimates.csv").read_text().splitlines()) == 3
    assert len(read_tum(tmp_path / "trajectories/fused.tum")) == 3


def test_a_folder_that_is_not_empty_needs_overwrite(fakes, tmp_path) -> None:
    (tmp_path / "trajectories").mkdir()
    (tmp_path / "trajectories/old.tum").write_text("")
    (tmp_path / "notes.txt").write_text("mine")
    parts = fakes.parts({"cam": fakes.Recording(fakes.image_frames("cam", [0.0]))})

    with pytest.raises(ConfigError, match="is not empty; choose another, or say --overwrite"):
        Pipeline(parts, out=tmp_path)
    list(Pipeline(parts, out=tmp_path, overwrite=True))

    assert not (tmp_path / "trajectories/old.tum").exists()
    assert (tmp_path / "notes.txt").read_text() == "mine"  # what no run has written stays


def test_a_localizer_that_never_knew_its_start_has_the_way_from_it(fakes) -> None:
    source = fakes.Recording(fakes.image_frames("cam", [i / 10 for i in range(5)]))
    pipeline = Pipeline(fakes.parts({"cam": source}, {"vo": fakes.Mover(Pose2(0.1))}, start="unknown"))

    list(pipeline)

    assert len(pipeline.result.trajectories["fused"]) == 0
    assert pipeline.result.trajectories["vo"].poses[-1, 0] == pytest.approx(0.4)


def test_new_folders_have_a_date_and_no_two_are_the_same(tmp_path) -> None:
    first = new_folder("my config", tmp_path)
    first.mkdir()

    assert first.name.endswith("-my-config")
    assert new_folder("my config", tmp_path) != first
