"""Learning the flat field while driving."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from trailmark.estimates import Belief
from trailmark.frames import GroundPlane
from trailmark.interfaces import Session
from trailmark.testing.ground import MirroredFloor, circle, ground_run, straight
from trailmark_ground_vo.audit import Audit
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.localizer import GroundVO


def uncalibrated(run):
    """The same run by a camera of which only the scale is known."""
    return replace(run, sensor=replace(run.sensor, calibration=GroundPlane(run.sensor.calibration.metres_per_pixel)))


@pytest.fixture
def dim_camera(camera):
    return replace(camera, vignette=0.35)


def test_a_vignette_is_learned_and_then_costs_little(dim_camera, track, monkeypatch):
    dull = MirroredFloor.procedural(seed=11, size_px=512, grain_px=1.5, contrast=6.0)
    run = uncalibrated(ground_run(straight(0.26, sway_m=0.002, sway_s=1.0), 110, ground=dull, camera=dim_camera))

    guarded = track(run)
    monkeypatch.setattr(Audit, "reason_suspected", lambda audit, noise: "")  # nothing is suspected any more
    learned = track(run)
    blind = track(run, learn_flat_field=False)

    assert not learned.lost
    assert math.hypot(*learned.error()[:2]) < 0.5e-3
    assert math.hypot(*blind.error()[:2]) > 4 * math.hypot(*learned.error()[:2])
    assert not guarded.lost
    assert math.hypot(*guarded.error()[:2]) < 0.2e-3


def test_what_is_learned_is_the_flat_field(dim_camera, ground):
    run = uncalibrated(ground_run(circle(0.26, 0.3), 120, ground=ground, camera=dim_camera))
    localizer = GroundVO(GroundVOConfig(camera="floor", n_pixels=384))
    localizer.start(Session(sensors={"floor": run.sensor}))
    fields = []
    localizer._reader.learn = lambda field, learn=localizer._reader.learn: (fields.append(field), learn(field))

    for frame in run.frames:
        localizer.observe(frame, Belief(frame.stamp_s))

    true = dim_camera.flat_field / dim_camera.flat_field.mean()
    assert fields
    assert localizer.counters()["flat_fields"] == len(fields)
    assert np.abs(fields[-1] / true - 1.0)[40:-40, 40:-40].max() < 0.03
    assert fields[-1].mean() == pytest.approx(1.0, rel=1e-5)


def test_even_light_is_left_alone(camera, ground, track):
    run = uncalibrated(ground_run(straight(0.26), 60, ground=ground, camera=camera))

    assert track(run).pose == track(run, learn_flat_field=False).pose


def test_a_calibrated_flat_field_is_believed(dim_camera, ground, track):
    run = ground_run(straight(0.26), 40, ground=ground, camera=dim_camera)

    assert track(run).pose == track(run, learn_flat_field=False).pose
