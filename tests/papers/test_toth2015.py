"""What a lived-in laboratory does to the pose: things are carried and covered, people cross, light goes down."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from trailmark_papers.kit import rms
from trailmark_papers.toth2015.drives import LANDMARKS, TWO_NAME, Driven, DriveOutcome, Plan, drive
from trailmark_papers.toth2015.speeds import speed_rows

_HALF_WAY_S = 1.2


@pytest.mark.parametrize(
    "disturbance",
    [
        pytest.param({"crate": "walks_off", "crate_s": _HALF_WAY_S}, id="a landmark walks away"),
        pytest.param({"crate": "covered", "crate_s": _HALF_WAY_S}, id="a landmark is covered"),
        pytest.param({"people": 4}, id="people cross"),
        pytest.param({"dims_s": _HALF_WAY_S, "dims_to": 0.2, "exposure": 1.0}, id="light to 20 %"),
        pytest.param({"dims_s": _HALF_WAY_S, "dims_to": 0.2}, id="light to 20 %, automatic exposure"),
    ],
)
def test_the_pose_does_not_jump(disturbance: Mapping[str, Any]) -> None:
    plan = Plan("test", "lab", 0, {"landmarks": LANDMARKS}, disturbance, length_m=0.75)

    found = drive(plan).outcomes["landmarks"]

    assert found.pose_percent >= 90.0
    assert found.jump_m < 0.05
    assert rms(found.position_m) < 0.03


@pytest.mark.parametrize(("speed_mps", "bars"), [(0.3, [90.0, 0.05, 1.0]), (1.0, [None, None, None])])
def test_two_landmarks_are_judged_as_fast_as_the_paper_drives(speed_mps: float, bars: list[float | None]) -> None:
    outcome = DriveOutcome(np.arange(3.0), np.full((3, 3), 0.04), 3, np.ones(3), 2.0)
    plan = Plan("speed", "lab", 0, {}, speed_mps=speed_mps, rate_hz=15.0)

    rows = speed_rows([Driven(plan, {TWO_NAME: outcome})])

    assert [row.bar for row in rows] == bars
    assert [row.met for row in rows] == ([None] * 3 if speed_mps > 0.3 else [True, False, False])
