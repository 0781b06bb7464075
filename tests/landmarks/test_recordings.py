"""Bearings to four infrared beacons, at nine places: as near as the closed solver, and no surer than it is right."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest


@pytest.fixture(scope="module")
def benchmark(load_script: Callable[[str], ModuleType]) -> ModuleType:
    return load_script("benchmarks/landmarks.py")


@pytest.mark.data
def test_bearings_of_beacons_tell_the_place_and_how_well(benchmark: ModuleType, data_folder: Path) -> None:
    rows = list(benchmark.bearing_rows(data_folder / "omni" / "bearing"))
    ours = [row for row in rows if row.method == "known_landmarks"]
    theirs = [row for row in rows if row.method == "locate"]
    assert len(ours) == len(theirs) == 9
    assert np.mean([row.answered for row in ours]) > 0.9
    assert np.median([row.median_m for row in ours]) <= 1.01 * np.median([row.median_m for row in theirs])
    assert 0.2 < np.mean([row.nees for row in ours]) < 5.0
    assert np.mean([row.silent for row in ours]) <= 0.001
