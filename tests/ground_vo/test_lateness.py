"""Corrections that come late: the answers of ground_map held back on a drive with ground_vo and dead reckoning."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Fix
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.testing.ground import ground_run
from trailmark_ground_vo.config import GroundMapConfig, GroundVOConfig
from trailmark_ground_vo.localizer import GroundVO
from trailmark_ground_vo.map_localizer import GroundMap

N_FRAMES, STEP_M = 90, 3.7e-3
HERE = Pose2()


def driven(ground, camera, localizer_map, mode, start, late=0, aside=HERE, seed=0):
    """Drive an arc; returns what was believed, and what was true, when each fix counted."""
    arc = lambda time_s: Pose2.exp(STEP_M * 70 * time_s, 0.0, 0.2 * time_s) @ aside  # noqa: E731
    run = ground_run(arc, N_FRAMES, ground=ground, camera=camera, seed=seed)
    session = Session(name="floor", mode=mode, sensors={"floor": run.sensor}, map=localizer_map)
    motion, places = GroundVO(GroundVOConfig(camera="floor", n_pixels=384)), GroundMap(GroundMapConfig(camera="floor"))
    estimator = DeadReckoning(DeadReckoningConfig())
    for part in (motion, places):
        part.start(session)
    estimator.start(Session(start_pose=start))
    held, counted = [], []
    for index, frame in enumerate(run.frames):
        for estimate in motion.observe(frame, estimator.belief(frame.stamp_s)):
            estimator.apply("motion", estimate)
        for fix in [fix for due, fix in held if due == index]:
            estimator.apply("map", fix)
            believed = estimator.belief(frame.stamp_s).pose_map_base
            counted.append((believed, run.truth[index][1]))
        if not any(due > index for due, _ in held):  # the search is busy until it answers
            said = places.observe(frame, estimator.belief(frame.stamp_s))
            held += [(index + late, estimate) for estimate in said if isinstance(estimate, Fix) and late]
    return counted


@pytest.mark.parametrize("late", [1, 14])
def test_a_correction_that_comes_late_is_as_good(late, camera, ground, localizer_map):
    driven(ground, camera, localizer_map, "teach", HERE)
    aside = Pose2(0.0, 0.003, math.radians(0.8))
    wrong = aside @ Pose2(0.004, -0.005, math.radians(-0.7))  # 6 mm and 0.7 deg off what is true

    counted = driven(ground, camera, localizer_map, "replay", wrong, late, aside, seed=1)

    assert len(counted) >= 5
    errors = [believed.between(true) for believed, true in counted]  # the map of the teaching is almost the truth
    misses_m = np.array([math.hypot(error.x, error.y) for error in errors])
    assert np.all(misses_m < 0.15e-3), misses_m
    assert np.all(np.abs([error.theta for error in errors]) < math.radians(0.3))
