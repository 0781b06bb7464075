"""What all papers' experiments are made of."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark.errors import ConfigError
from trailmark.estimates import Belief, Fix
from trailmark.experiments import ExperimentOptions, Row
from trailmark.frames import Frame, Odometry, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import FrameSource, Localizer
from trailmark_papers.kit import (
    FrameKeeper,
    Table,
    Watcher,
    begin_with,
    collisions_of,
    group_by,
    keyframes_of,
    largest_of,
    mean_of,
    observe_timed,
    panels,
    path_of,
    rms,
    run_config,
    sd_of,
    show,
    sim_source,
    spread_of,
    started_source,
    sweep,
    truth_of,
    world_of,
)

ROUTE: dict[str, Any] = {"plugin": "sim", "world": "street", "sensors": ["wheels"], "duration_s": 1.0, "threads": 1}


def difference(a: float, b: float) -> float:
    return a - b


def test_headlines_are_the_named_rows_however_far_a_version_drives() -> None:
    rows = [Row("3 m", "ours: rms", "m", 1.0), Row("0.9 m", "ours: rms", "m", 1.0), Row("3 m", "theirs: rms", "m", 1.0)]

    found = begin_with(rows, "* m: ours: *")

    assert [row.is_headline for row in found] == [True, True, False]
    assert [row.item for row in found] == [row.item for row in rows]


def test_rows_of_a_table_share_name_samples_and_seeds() -> None:
    table = Table("Table 1", n=40, seeds=4)

    table.add("error", "m", 0.2, paper=0.4, bar=0.3)
    table.add_higher("speed", "fps", 20.0, bar=25.0, n=7)
    table.add_share("answered", [True, True, False, True])

    assert [row.experiment for row in table] == ["Table 1"] * 3
    assert [(row.n, row.seeds) for row in table] == [(40, 4), (7, 4), (40, 4)]
    assert [row.met for row in table] == [True, False, None]
    assert (table.rows[2].ours, table.rows[2].unit, table.rows[2].better) == (75.0, "%", "higher")


def test_what_could_not_be_measured_is_left_out_of_a_mean() -> None:
    values = np.array([1.0, math.nan, 3.0])

    assert (mean_of(values), sd_of(values), largest_of(values)) == (2.0, 1.0, 3.0)
    assert (mean_of(values[1:2]), sd_of(values[1:2]), largest_of(values[1:2])) == (None, None, None)
    assert rms(np.array([3.0, -4.0])) == pytest.approx(math.sqrt(12.5))
    assert math.isnan(rms(np.array([])))


def test_one_seed_has_no_spread() -> None:
    assert spread_of([2.0]) is None
    assert spread_of([1.0, 3.0]) == 1.0


def test_a_sweep_answers_by_cell_and_groups_keep_the_order(tmp_path: Path) -> None:
    options = ExperimentOptions(quick=True, seed=0, out=tmp_path, report=print)

    found = sweep(options, difference, {("x", 1): (5.0, 1.0), ("y", 1): (1.0, 1.0), ("x", 2): (9.0, 2.0)})

    assert found == {("x", 1): 4.0, ("y", 1): 0.0, ("x", 2): 7.0}
    assert group_by(found, lambda cell: cell[0]) == {"x": [4.0, 7.0], "y": [0.0]}


def test_collisions_are_counted_over_all_vehicles() -> None:
    assert collisions_of({"source.a.collisions": 2, "source.b.collisions": 1.0, "frames": 40}) == 3


def test_a_taught_path_is_run_kept_and_read_again(tmp_path: Path) -> None:
    config = {"sources": {"robot": ROUTE}, "localizers": {"wheels": {"plugin": "odometry"}}, "seed": 3}
    keeper: FrameKeeper[float] = FrameKeeper(Odometry, lambda payload: payload.pose_start_base.x)
    store = tmp_path / "path.trail"

    result = run_config(config, tmp_path / "teach", "teach", store=store, on_step=keeper)
    run_config(config, tmp_path / "teach", "teach", store=store)  # over what there is

    assert truth_of(result).length_m() > 0.1
    assert path_of(store).length_m > 0.1
    assert keyframes_of(store, "nobody") == []
    assert len(keeper.stamps_s) == len(keeper.values) > 10
    assert keeper.values[-1] == pytest.approx(truth_of(result).length_m(), abs=0.05)  # 5 cm


def test_a_collision_ends_a_drive(tmp_path: Path) -> None:
    ahead = {"route": "wall", "start": [6.0, 2.0, 0.0], "driver": "commands", "duration_s": 20.0, "threads": 1}
    source = sim_source("supermarket", sensors=["wheels"], **ahead)
    controller = {"plugin": "goal_seeking", "goal": [15.0, 2.0], "way": "straight", "max_fix_age_m": None}
    config = {"sources": {"robot": source}, "localizers": {"wheels": {"plugin": "odometry"}}, "start": [6.0, 2.0, 0.0]}

    result = run_config({**config, "controller": controller}, tmp_path)

    assert collisions_of(result.counters) == 1
    assert truth_of(result).stamps_s[-1] < 19.0


class _Counting(Watcher):
    def __init__(self) -> None:
        self.stamps_s: list[float] = []

    def see(self, frame: Frame) -> None:
        self.stamps_s.append(frame.stamp_s)


def test_all_watchers_see_every_frame_beside_the_truth() -> None:
    watchers = [_Counting(), _Counting()]

    with started_source(ROUTE, seed=3) as source:
        truth = show(source, watchers, Odometry)

    assert watchers[0].stamps_s == watchers[1].stamps_s
    np.testing.assert_array_equal(truth.stamps_s, watchers[0].stamps_s)


def test_a_source_is_closed_when_what_it_is_for_fails() -> None:
    closed: list[bool] = []

    def fail() -> None:
        with started_source(ROUTE) as source:
            source.close = lambda: closed.append(True)  # type: ignore[method-assign]
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()

    assert closed == [True]


def test_the_world_of_a_simulator_is_at_hand_and_a_recording_has_none() -> None:
    with started_source(ROUTE) as source:
        world = world_of(source)

    assert world.routes
    assert isinstance(world.truth, Mapping)
    assert len(world.sensors) == len(source.sensors)
    with pytest.raises(ConfigError, match="_Recorded has no world to look at"):
        world_of(_Recorded(None))


class _Recorded(FrameSource):
    @property
    def sensors(self) -> dict[str, SensorInfo]:
        return {}

    def frames(self) -> Iterator[Frame]:
        return iter(())


class _Fixed(Localizer):
    def observe(self, frame: Frame, belief: Belief) -> list[Fix]:
        return [Fix(frame.stamp_s, Pose2(), np.eye(3))]


def test_an_answer_is_timed_by_the_clock_that_is_given() -> None:
    clock = iter([1_000_000, 4_500_000])
    frame = Frame("wheels", 0.5, Odometry(Pose2()))

    (fix,), took_ms = observe_timed(_Fixed(None), frame, Belief(0.5), lambda: next(clock))

    assert fix.stamp_s == 0.5
    assert took_ms == 3.5


def test_panels_bear_their_titles_and_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        with panels(tmp_path / f"{name}.svg", 3.0, "first [m]", "second [m]", xlabel="way [m]", name="x") as (_, axes):
            axes[0].plot([0.0, 1.0])

    drawn = (tmp_path / "a.svg").read_text("utf-8")
    assert drawn == (tmp_path / "b.svg").read_text("utf-8")
    assert all(drawn.count(f">{words}<") == 1 for words in ("first [m]", "second [m]", "way [m]"))
