"""A path that was taught with something on the lens, and is driven again with it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix, Lost
from trailmark.frames import Frame, Image
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.testing.ground import GroundCamera, MirroredFloor
from trailmark_ground_vo.config import GroundMapConfig
from trailmark_ground_vo.map_localizer import GroundMap

N_PATCHES = 16
CAMERA = GroundCamera((320, 288))
DULL = MirroredFloor.procedural(seed=11, size_px=512, grain_px=1.5, contrast=5.0)
#: 6 mm and 1 deg beside the taught place.
BESIDE = Pose2(0.004, -0.005, math.radians(1.0))


def marked():
    """Round bright spots of 4 to 14 px that cover 5 % of the picture: where, (H, W) bool."""
    rng, spots = np.random.default_rng(5), np.zeros((288, 320), np.bool_)
    v, u = np.mgrid[:288, :320]
    while spots.mean() < 0.05:
        spots |= np.hypot(u - rng.uniform(0, 320), v - rng.uniform(0, 288)) < rng.uniform(2.0, 7.0)
    return spots


def frame_of(light, seed, noise=3.0):
    noisy = light + noise * np.random.default_rng(seed).standard_normal(light.shape)
    return Frame("floor", float(seed), Image(np.clip(np.rint(noisy), 0, 255).astype(np.uint8)))


def driven_again(localizer_map, change, noise=3.0, n_patches=N_PATCHES, first=0):
    """Teach a straight path and drive beside it.

    Parameters
    ----------
    localizer_map : LocalizerMap
        Where it is taught.
    change : callable
        Returns the light through what is on the lens.
    noise : float
        Of the pictures then [grey levels].
    n_patches : int
        Of the path.
    first : int
        The patch from which on something is on the lens.

    Returns
    -------
    list of (Pose2, Estimate)
        The true poses and the answers.
    """
    stations = [0.05 * n for n in range(n_patches)]

    def light(pose, n):
        seen = CAMERA.view(DULL, pose)
        return change(seen) if n >= first else seen

    sensors = {"floor": CAMERA.sensor_info("floor")}
    teacher, localizer = (GroundMap(GroundMapConfig(camera="floor", search="pyramid")) for _ in range(2))
    teacher.start(Session(mode="teach", sensors=sensors, map=localizer_map))
    for n, station_m in enumerate(stations):
        pose = Pose2(station_m, 0.0, 0.0)
        teacher.observe(frame_of(light(pose, n), n), Belief(float(n), pose_map_base=pose, travelled_m=station_m))
    localizer.start(Session(mode="replay", sensors=sensors, map=localizer_map))
    answers = []
    for n, station_m in enumerate(stations):
        pose = Pose2(station_m, 0.0, 0.0)
        frame = frame_of(light(pose @ BESIDE, n), 100 + n, noise)
        said = localizer.observe(frame, Belief(100.0 + n, pose_map_base=pose))
        answers += [(pose @ BESIDE, one) for one in said]
    return answers


def test_marks_on_the_lens_are_not_taken_for_the_place(localizer_map):
    spots = marked()

    answers = driven_again(localizer_map, lambda light: np.where(spots, 250.0, light))

    errors = [truth.distance_to(one.pose_map_base) for truth, one in answers if isinstance(one, Fix)]
    assert len(answers) == N_PATCHES
    assert len(errors) >= 0.9 * N_PATCHES
    assert max(errors) < 1e-3


def test_a_cover_that_was_there_when_the_path_was_taught_is_no_place(localizer_map):
    cover = CAMERA.view(MirroredFloor.procedural(seed=3, size_px=512, grain_px=3.0), Pose2())

    answers = driven_again(localizer_map, lambda light: cover)

    assert len(answers) == N_PATCHES
    assert all(isinstance(one, Lost) for _, one in answers)


@pytest.mark.parametrize(("n_patches", "first"), [(11, 0), (2, 0), (40, 26), (40, 30)])
def test_a_cover_on_few_patches_or_on_the_last_of_the_way_is_no_place(n_patches, first, localizer_map):
    cover = CAMERA.view(MirroredFloor.procedural(seed=3, size_px=512, grain_px=3.0), Pose2())

    answers = driven_again(localizer_map, lambda light: cover, n_patches=n_patches, first=first)

    fixes = [n for n, (_, one) in enumerate(answers) if isinstance(one, Fix)]
    assert len(answers) == n_patches
    assert fixes == list(range(first))


@pytest.mark.parametrize(("u", "v"), [(182, 0), (160, 144)], ids=["left", "all but a corner"])
def test_a_cover_on_three_quarters_of_few_patches_is_no_place(u, v, localizer_map):
    cover = CAMERA.view(MirroredFloor.procedural(seed=3, size_px=512, grain_px=3.0), Pose2())
    is_covered = np.ones(cover.shape, np.bool_)
    is_covered[v:, u:] = False

    answers = driven_again(localizer_map, lambda light: np.where(is_covered, cover, light), n_patches=8)

    assert len(answers) == 8
    assert all(isinstance(one, Lost) for _, one in answers)


@pytest.mark.parametrize("noise", [1.0, 12.0])
def test_a_heading_that_noise_hides_is_not_told(noise, localizer_map):
    answers = driven_again(localizer_map, lambda light: light, noise=noise)

    fixes = [(truth, one) for truth, one in answers if isinstance(one, Fix)]
    sigmas = [math.degrees(math.sqrt(np.linalg.inv(one.information)[2, 2])) for _, one in fixes]
    assert len(fixes) >= 8
    assert all(sigma < 0.25 for sigma in sigmas) if noise == 1.0 else all(sigma > 4.0 for sigma in sigmas)
    assert max(truth.distance_to(one.pose_map_base) for truth, one in fixes) < 1e-3
