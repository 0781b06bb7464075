"""Registering a patch and finding it again."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from trailmark.errors import ConfigError
from trailmark.geometry import Pose2
from trailmark.testing.ground import MirroredFloor
from trailmark_ground_vo.config import GroundMapConfig
from trailmark_ground_vo.levels import LEFT_OUT
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.patch import PatchFinder

SCALE = 3.9e-4
HERE = Pose2(1.2, -0.4, 0.9)


def finder_for(camera, **keys):
    return PatchFinder(GroundMapConfig(camera="floor", **keys), camera.size)


def moved(camera, ground, u, v, turn_rad, seed=1):
    """A picture whose content has moved since HERE."""
    mounting = camera.mounting.planar()
    base = mounting @ Pose2(u * SCALE, -v * SCALE, turn_rad).inverse() @ mounting.inverse()
    return camera.image(ground, HERE @ base, seed)


@pytest.fixture
def patch(camera, ground):
    finder = finder_for(camera)
    return finder.register(finder.view(camera.image(ground, HERE, 0)))


def test_a_patch_costs_1936_bytes(patch):
    assert patch.shape == (44, 44)
    assert patch.nbytes == 1936


@pytest.mark.parametrize("search", ["exhaustive", "pyramid"])
@pytest.mark.parametrize("truth", [(0.0, 0.0, 0.0), (37.3, -21.8, 0.05), (-12.4, 44.1, -0.11)])
def test_a_patch_is_found_to_a_fraction_of_a_pixel(search, truth, camera, ground, patch):
    finder = finder_for(camera, search=search)
    view = finder.view(moved(camera, ground, *truth))

    found = finder.find(view, patch, ImageMotion(0.0, 0.0, 0.0))

    assert found.reason == ""
    assert (found.motion.u, found.motion.v) == pytest.approx(truth[:2], abs=0.15)
    assert found.motion.turn_rad == pytest.approx(truth[2], abs=4e-3)
    assert found.details["agreeing"] >= 3


def test_the_search_starts_where_the_patch_is_expected(camera, ground, patch):
    finder = finder_for(camera, search_px=8)
    view = finder.view(moved(camera, ground, 52.0, -30.0, 0.3))

    found = finder.find(view, patch, ImageMotion(48.0, -36.0, 0.27))

    assert found.reason == ""
    assert (found.motion.u, found.motion.v) == pytest.approx((52.0, -30.0), abs=0.15)
    assert found.details["shift_px"] == pytest.approx(math.hypot(4.0, 6.0), abs=0.2)


def test_whole_pixels_as_in_the_paper(camera, ground, patch):
    finder = finder_for(camera, refined=False, min_groups=4)
    view = finder.view(moved(camera, ground, 20.6, 0.0, 0.0))

    found = finder.find(view, patch, ImageMotion(0.0, 0.0, 0.0))

    assert found.motion.u in (20.0, 22.0)
    assert found.information[0, 0] == pytest.approx(12 / 4)


def test_the_high_pass_finds_what_raw_intensities_lose_in_another_light(camera):
    dull = MirroredFloor.procedural(seed=11, size_px=512, grain_px=1.5, contrast=4.0)
    camera = replace(camera, noise_sigma=1.0)
    relit = replace(camera, gain=0.85, offset=0.0, vignette=0.25)
    accepted = {}
    for high_pass in (True, False):
        finder = finder_for(camera, high_pass=high_pass)
        patch = finder.register(finder.view(camera.image(dull, HERE, 0)))
        views = [finder.view(moved(relit, dull, 10.0 * n, 5.0, 0.01 * n)) for n in range(4)]
        accepted[high_pass] = sum(not finder.find(view, patch, ImageMotion(0.0, 0.0, 0.0)).reason for view in views)

    assert accepted[True] == 4
    assert accepted[False] <= 1


def test_another_floor_is_rejected(camera, patch):
    finder = finder_for(camera)
    rejected = []
    for seed in range(20, 32):
        other = MirroredFloor.procedural(seed=seed, size_px=512, grain_px=1.5)
        found = finder.find(finder.view(moved(camera, other, 0.0, 0.0, 0.0)), patch, ImageMotion(0.0, 0.0, 0.0))
        rejected.append(bool(found.reason))
        assert not found.reason or "covered" in found.reason

    assert all(rejected)


def test_dirt_on_one_quarter_does_not_hide_the_place(camera, ground, patch):
    finder = finder_for(camera)
    image = moved(camera, ground, 6.0, -4.0, 0.01)
    image[96:140, 112:166] = 20  # the upper left quarter of where the patch lies

    found = finder.find(finder.view(image), patch, ImageMotion(0.0, 0.0, 0.0))

    assert found.reason == ""
    assert found.details["agreeing"] == 3
    assert (found.motion.u, found.motion.v) == pytest.approx((6.0, -4.0), abs=1.3)  # half a millimetre
    strict = finder_for(camera, min_groups=4).find(finder.view(image), patch, ImageMotion(0.0, 0.0, 0.0))
    assert strict.reason == "only 3 of 4 groups agree (covered or changed ground)"


def test_three_groups_are_not_believed_far_from_where_the_patch_was_expected(camera, ground, patch):
    finder = finder_for(camera)
    image = moved(camera, ground, 30.0, -20.0, 0.01)
    image[80:124, 136:190] = 20

    found = finder.find(finder.view(image), patch, ImageMotion(0.0, 0.0, 0.0))

    assert found.details["agreeing"] == 3
    assert re.match(r"3 of 4 groups agree on a place 3\d px off", found.reason)


def test_ten_percent_of_speckle_leaves_most_places_accepted(camera, ground, patch):
    finder, rng = finder_for(camera), np.random.default_rng(5)
    accepted = 0
    for n in range(10):
        image = moved(camera, ground, 2.0 * n - 9.0, 3.0, 0.0, seed=n)
        speckled = rng.random(image.shape) < 0.1
        image[speckled] = 255 * rng.integers(0, 2, np.count_nonzero(speckled))
        found = finder.find(finder.view(image), patch, ImageMotion(0.0, 0.0, 0.0))
        accepted += not found.reason
        if not found.reason:
            assert found.motion.u == pytest.approx(2.0 * n - 9.0, abs=3.0)

    assert accepted >= 9


def test_vectors_and_plain_kernels_find_the_same(camera, ground, patch):
    image = moved(camera, ground, 11.0, -7.0, 0.02)
    answers = []
    for use_vectors in (True, False):
        finder = finder_for(camera, search_px=12, use_vectors=use_vectors)
        answers.append(finder.find(finder.view(image), patch, ImageMotion(8.0, -6.0, 0.0)))

    assert answers[0].motion == answers[1].motion
    assert answers[0].details == answers[1].details


def test_information_is_about_as_good_as_the_matches_are(camera, ground, patch):
    finder, squares = finder_for(camera), []
    for n in range(25):
        truth = np.array([1.7 * n - 20.0, 0.9 * n - 8.0, 0.002 * n])
        found = finder.find(finder.view(moved(camera, ground, *truth, seed=n)), patch, ImageMotion(0.0, 0.0, 0.0))
        error = found.motion.array() - truth
        squares.append(error @ found.information @ error / 3)

    assert 0.3 < np.mean(squares) < 5.0


def test_reach_ends_where_the_search_would_leave_the_picture(camera):
    finder = finder_for(camera, search_px=16)

    assert finder.is_in_reach(ImageMotion(60.0, 0.0, 0.0))
    assert not finder.is_in_reach(ImageMotion(140.0, 0.0, 0.0))
    assert not finder.is_in_reach(ImageMotion(0.0, 0.0, 0.2))


def test_a_picture_too_small_for_the_search_is_refused():
    with pytest.raises(ConfigError, match=r"pictures of 240 x 240 are too small for patches of 44 px"):
        PatchFinder(GroundMapConfig(camera="floor"), (240, 240))


@pytest.mark.parametrize("search", ["exhaustive", "pyramid"])
def test_a_patch_half_of_which_is_left_out_is_found_by_the_rest(search, camera, ground, patch):
    finder, half = finder_for(camera, search=search, min_groups=2), patch.copy()
    half[:, :22] = LEFT_OUT

    found = finder.find(finder.view(moved(camera, ground, 5.0, -8.0, 0.02)), half, ImageMotion(0.0, 0.0, 0.0))

    assert found.n_agreeing == 2
    assert (found.motion.u, found.motion.v) == pytest.approx((5.0, -8.0), abs=0.3)


@pytest.mark.parametrize("search", ["exhaustive", "pyramid"])
def test_a_patch_without_ground_is_not_found(search, camera, ground, patch):
    finder = finder_for(camera, search=search)
    view = finder.view(moved(camera, ground, 0.0, 0.0, 0.0))

    found = finder.find(view, np.full_like(patch, LEFT_OUT), ImageMotion(0.0, 0.0, 0.0))

    assert (found.n_agreeing, found.correlation) == (0, 0.0)
    assert "only 0 of 4 groups agree" in found.reason


def test_no_search_believes_a_place_that_does_not_tell_its_turn(camera, ground, patch):
    finder = finder_for(camera)
    found = finder.find(finder.view(moved(camera, ground, 0.0, 0.0, 0.0)), patch, ImageMotion(0.0, 0.0, 0.0))

    hardly = replace(found, information=np.diag([1e4, 1e4, 1.0 / math.radians(1.0) ** 2]))

    assert finder.fits(found)
    assert finder.confirms(found)
    assert not finder.fits(hardly)
    assert not finder.confirms(hardly)


def test_a_group_of_which_the_coarse_search_sees_nothing_does_not_agree(camera, ground, patch):
    finder, dotted = finder_for(camera, search="pyramid"), patch.copy()
    dotted[:22, :22] = np.random.default_rng(0).integers(8, 248, (22, 22))  # other ground
    dotted[0:22:2, 0:22:2] = LEFT_OUT

    found = finder.find(finder.view(moved(camera, ground, 0.0, 0.0, 0.0)), dotted, ImageMotion(0.0, 0.0, 0.0))

    assert found.n_agreeing == 3
