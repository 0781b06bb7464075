"""The paper's experiments, in short."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from trailmark.config import load_run_config
from trailmark.experiments import ExperimentOptions
from trailmark.geometry import Pose2, Trajectory
from trailmark.plugins import load_plugins
from trailmark_papers.kit import Table, Trial
from trailmark_papers.nagai2015 import cover, indoor, outdoor, runs, straight


def short(out: Path, said: list[str]) -> ExperimentOptions:
    return ExperimentOptions(quick=True, seed=3, out=out, report=said.append)


def test_straight_lines_give_the_papers_three_figures_for_two_modes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(straight, "_QUICK_FLOORS", ("asphalt",))
    monkeypatch.setattr(straight, "_QUICK_S", 4.0)
    said: list[str] = []

    rows = straight.straight_rows(short(tmp_path, said))

    assert len(said) == 1
    assert [row.unit for row in rows] == ["%", "%", "deg/m"] * 2
    assert [row.paper for row in rows if "odometer" in row.item] == [None, None]  # the paper's are of 10 m
    assert all(row.ours is not None and 0 < row.ours < 1.0 for row in rows)
    assert all(row.met for row in rows if row.bar is not None)


def test_ten_metres_stand_beside_the_papers_two_figures() -> None:
    table = Table("B 10 m straight, paper", 5, 5)

    drifts = [straight.StraightErrors(position, 0.2, 0.03) for position in (3.0, 4.0, 5.0)]
    floors = {"wood": straight._OverPlaces.of(drifts), "carpet": straight._OverPlaces.of(drifts[:1])}
    straight._add_worst(table, "floors", "paper", floors, is_papers=True)

    assert [(row.n, round(row.spread or 0.0, 3)) for row in table] == [(5, 0.816), (5, 0.0), (5, 0.0)]
    assert [(row.unit, round(row.ours or 0.0, 3), row.paper) for row in table] == [
        ("%", 4.082, None),
        ("%", 0.2, 0.99),
        ("deg/m", 0.03, 0.44),
    ]


def test_drift_is_told_in_percent_and_degrees_per_metre() -> None:
    stamps = np.arange(11.0)
    truth = Trajectory(stamps, np.stack([np.arange(11.0), np.zeros(11), np.zeros(11)], axis=1))
    turned = Pose2(0.0, 0.0, 0.01)
    estimate = Trajectory(
        stamps, np.array([(turned @ Pose2(1.02 * s, 0.0, math.radians(s / 2))).array() for s in stamps])
    )

    found = straight.drift(estimate, truth)

    assert found.position_percent == pytest.approx(2.0)
    assert found.odometer_percent == pytest.approx(2.0)
    assert found.heading_deg_per_m == pytest.approx(0.5)


def test_carpet_is_rejected_by_the_consensus_and_believed_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cover, "_QUICK", (4.0, 0.3, 0.8, 0.5))
    monkeypatch.setattr(cover, "_GIVE_UP_S", 5.0)

    rows = cover.cover_rows(short(tmp_path, []))

    false = {row.experiment.rpartition(", ")[2]: row for row in rows if "false" in row.item}
    assert false["with consensus"].met
    assert false["without consensus"].ours
    rejected = next(row.ours for row in rows if row.item == "searches rejected")
    assert rejected is not None
    assert rejected > 20.0


def test_a_stretch_of_the_outdoor_course_is_driven_forward_and_in_reverse(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outdoor, "_QUICK_S", 3.5)

    rows = outdoor.outdoor_rows(short(tmp_path, []))

    by_item = {row.item: row for row in rows}
    assert by_item["registrations"].ours == 18  # at 0 and every 0.05 m of 0.87 m
    assert "forward and reverse" in by_item["end of the path missed by"].experiment
    assert by_item["end of the path missed by"].met
    assert by_item["way between corrections, mean"].met
    assert sorted(path.name[:9] for path in tmp_path.glob("*.svg")) == ["figure_16", "figure_17", "figure_18"]
    drawn = next(tmp_path.glob("figure_16*.svg")).read_text("utf-8")
    starts_px = [float(x) for x in re.findall(r'x="([\d.]+)"[^>]*>(?:forward|reverse)', drawn)]
    assert len(starts_px) == 4
    assert max(starts_px) < 400.0  # of 460.8: the legend stays in the figure


def test_the_gates_are_half_a_metre_wide() -> None:
    poles = runs.poles_of(runs.course("indoor"))

    assert poles.shape == (8, 3)
    gaps = np.hypot(*(poles[0::2, :2] - poles[1::2, :2]).T) - poles[0::2, 2] - poles[1::2, 2]
    np.testing.assert_allclose(gaps, 0.50, atol=1e-9)


def test_without_a_folder_of_recordings_there_are_no_photographs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ground").mkdir()
    (tmp_path / "ground" / "tiles_1k.jpg").touch()
    full = ExperimentOptions(quick=False, seed=0, out=tmp_path, report=print)

    monkeypatch.setenv("TRAILMARK_DATA", str(tmp_path))
    assert runs.photographs(full) == {"tiles": tmp_path / "ground" / "tiles_1k.jpg"}
    assert runs.photographs(short(tmp_path, [])) == {}
    monkeypatch.delenv("TRAILMARK_DATA")
    assert runs.photographs(full) == {}


@pytest.mark.parametrize("name", indoor._VARIANTS)
def test_every_variant_of_the_indoor_course_is_a_valid_config(tmp_path: Path, name: str) -> None:
    config = indoor._config(
        Trial(tmp_path, 0, 1), indoor._VARIANTS[name], 2.5, Pose2(1.0, 2.0, 0.3), Pose2(1.1, 2.0, 0.3)
    )

    assert load_run_config(config, plugins=load_plugins()).controller is not None
