"""What a lived-in laboratory does to the pose: things are carried and covered, people cross, light goes down."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark.experiments import ExperimentOptions
from trailmark.frames import RGBD, Frame, Scalar
from trailmark.isolation.fingerprint import digest_of
from trailmark.isolation.plain import to_plain_bytes
from trailmark_papers.kit import rms
from trailmark_papers.toth2015 import PARTS
from trailmark_papers.toth2015.disturbances import disturbance_rows
from trailmark_papers.toth2015.drives import LANDMARKS, TWO_NAME, Driven, DriveOutcome, Plan, covered, drive
from trailmark_papers.toth2015.light import LIGHTS
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


def test_a_thing_before_the_camera_takes_half_of_the_view_and_its_depth() -> None:
    picture = RGBD(np.full((4, 6, 3), 200, np.uint8), np.full((4, 6), 2.0, np.float32))

    seen = covered(Frame("rgbd", 1.0, picture)).payload

    assert isinstance(seen, RGBD)
    assert (seen.bgr[:, :3] < 20).all()
    assert (seen.bgr[:, 3:] == 200).all()
    assert np.isnan(seen.depth_m[:, :3]).all()
    assert (seen.depth_m[:, 3:] == 2.0).all()
    assert (picture.bgr == 200).all()
    assert covered(Frame("light", 1.0, Scalar(3.0))).payload == Scalar(3.0)


@pytest.mark.slow
def test_light_that_is_not_made_up_for_differs_where_lamps_dim() -> None:
    """The three ways to take the light see the same pictures: without any, the darker ones look otherwise."""
    methods = {name: {**LANDMARKS, "refind": "look", **light} for name, light in LIGHTS.items()}
    given = {"dims_s": 0.3, "dims_to": 0.2, "exposure": 1.0}

    found = drive(Plan("test", "lab", 0, methods, given, length_m=0.2, rate_hz=5.0)).outcomes

    both, picture, none = (found[name].errors for name in LIGHTS)
    assert np.array_equal(both, picture)
    assert not np.array_equal(picture, none)


def test_what_is_printed_stands_beside_what_it_is_the_printed_form_of() -> None:
    near, far = (DriveOutcome(np.arange(3.0), np.full((3, 3), miss_m), 3, np.ones(3), 2.0) for miss_m in (0.01, 0.2))
    drives = [
        Driven(Plan("people cross", "lab", 0, {}), {"landmarks": near}),
        Driven(Plan("people cross, as printed", "lab", 0, {}), {"landmarks": far}),
    ]

    jump, position, share = disturbance_rows(drives)

    assert (position.ours, position.faithful) == pytest.approx((0.01 * np.sqrt(2), 0.2 * np.sqrt(2)))
    assert (jump.experiment, jump.ours, share.faithful) == ("laboratory, people cross", 0.0, 100.0)


@pytest.mark.parametrize("is_quick", [True, False])
def test_every_drive_can_be_called_in_a_process_of_its_own_and_be_known_again(is_quick: bool, tmp_path: Path) -> None:
    options = ExperimentOptions(quick=is_quick, seed=0, out=tmp_path, report=print)
    calls = [plan for plans_of, _ in PARTS for plan in plans_of(options)]

    assert len({digest_of(json.loads(to_plain_bytes(plan))) for plan in calls}) == len(calls)
