"""A place that is taught from a start that is 3 degrees wrong: replays are judged in the map as it was taught."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from trailmark import run
from trailmark.evaluation import evaluate_run
from trailmark.evaluation.taught_places import TRUTH_FILE, read_taught_places

_ROBOT = {"plugin": "sim", "world": "lab", "route": "straight", "sensors": ["wheels", "laser"]}
_RATES = {"rates_hz": {"laser": 2, "wheels": 20}, "duration_s": 4}
_LOCALIZERS = {"wheels": {"plugin": "odometry"}, "laser": {"plugin": "laser_icp"}}


@pytest.fixture(scope="module")
def replayed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a replay of a place taught with another heading than the world's."""
    folder = tmp_path_factory.mktemp("bent")
    config: Mapping[str, Any] = {"sources": {"robot": {**_ROBOT, **_RATES}}, "localizers": _LOCALIZERS}
    store = folder / "bent.trail"
    taught = {**config, "estimator": {"plugin": "kalman"}, "start": [0.8, 2.6, 3.0]}
    run(taught, folder / "teach", store=store, mode="teach", report=False)
    driven = {**config, "estimator": {"plugin": "kalman"}, "controller": {"plugin": "path_tracking"}}
    run(driven, folder / "replay", store=store, mode="replay", report=False)
    return folder / "replay"


def test_the_path_store_knows_where_its_places_really_were(replayed: Path) -> None:
    off_m = read_taught_places(replayed / TRUTH_FILE).off_m()

    assert len(off_m) > 3
    assert off_m[0] < 0.01
    assert off_m[-1] > 0.02


def test_an_honest_laser_is_not_blamed_for_the_map(replayed: Path) -> None:
    document = evaluate_run(replayed, write=False)

    assert "the taught map is" in document["map_frame"]
    assert document["sources"]["laser"]["nees"]["per_dof"] < 5.0


def test_without_the_truth_of_teaching_it_would_be(replayed: Path) -> None:
    known = (replayed / TRUTH_FILE).read_bytes()
    (replayed / TRUTH_FILE).unlink()
    try:
        document = evaluate_run(replayed, write=False)
    finally:
        (replayed / TRUTH_FILE).write_bytes(known)

    assert document["sources"]["laser"]["nees"]["per_dof"] > 10.0
