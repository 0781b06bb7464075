"""The refinement: pixels that remember, and the motion that makes them look as remembered."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import numpy as np
import pytest

from trailmark.geometry import Pose2
from trailmark.testing.ground import GroundCamera, MirroredFloor
from trailmark_ground_vo.filters import SMOOTH_SCALE, smooth
from trailmark_ground_vo.refine import best_start, mean_clipped, refine
from trailmark_ground_vo.texture import (
    AGE,
    SLOPE_U,
    SLOPE_V,
    VALUE,
    X,
    Y,
    advance_texture,
    residuals,
    select_texture,
)

AREA = (40, 40, 216, 200)
CENTRE = (127.5, 119.5)
HUBER, CLIP = 8.0 * SMOOTH_SCALE, 30.0 * SMOOTH_SCALE
SCALE = 3.9e-4
GROUND = MirroredFloor.procedural(seed=2, size_px=512, grain_px=1.2)

#: No residual is too large for a pixel to be remembered as before.
ANY = 1e9


def looked_at(u, v, turn_rad, noise_sigma=0.0, index=0, aspect=1.0):
    """A smoothed picture whose content has moved by (u, v, turn) from the one at (0, 0, 0)."""
    camera = GroundCamera((256, 240), (SCALE, aspect * SCALE), noise_sigma=noise_sigma)
    content = Pose2(u * SCALE, -v * aspect * SCALE, turn_rad)
    mounting = camera.mounting.planar()
    base = mounting @ content.inverse() @ mounting.inverse()
    return smooth(camera.image(GROUND, Pose2(1.0, 0.5, 0.3) @ base, seed=1, index=index))


@pytest.fixture(scope="module")
def texture():
    return select_texture(looked_at(0.0, 0.0, 0.0), AREA, 5, 2)


def test_every_segment_of_a_line_gives_its_steepest_pixels(texture):
    picture = looked_at(0.0, 0.0, 0.0).astype(float)
    along_u = np.abs(picture[:, 2:] - picture[:, :-2])  # of columns 1 to W - 2

    assert texture.shape == (8, 88 * 5 * 2)
    for n in (0, 2, 8, 400):  # even: along u
        u, v, segment = int(texture[X, n]), int(texture[Y, n]), n // 2 % 5
        first = 40 + 32 * segment
        assert along_u[v, u - 1] == along_u[first : first + 32, u - 1].max()
        assert texture[VALUE, n] == picture[v, u]
        assert texture[SLOPE_U, n] == (picture[v, u + 1] - picture[v, u - 1]) / 2
        assert texture[SLOPE_V, n] == (picture[v + 1, u] - picture[v - 1, u]) / 2


def test_residuals_are_bilinear_differences(texture):
    picture = looked_at(2.3, -1.6, 0.01)
    motion = (2.0, -1.25, 0.008)
    cos, sin = math.cos(motion[2]), math.sin(motion[2])
    dx, dy = texture[X].astype(float) - CENTRE[0], texture[Y].astype(float) - CENTRE[1]
    x, y = cos * dx + sin * dy + CENTRE[0] + motion[0], cos * dy - sin * dx + CENTRE[1] + motion[1]
    u, v = np.floor(x).astype(int), np.floor(y).astype(int)
    fu, fv, p = x - u, y - v, picture.astype(float)
    upper, lower = (1 - fu) * p[v, u] + fu * p[v, u + 1], (1 - fu) * p[v + 1, u] + fu * p[v + 1, u + 1]

    differences = residuals(picture, texture, CENTRE, motion, 1.0)

    np.testing.assert_allclose(differences, (1 - fv) * upper + fv * lower - texture[VALUE], atol=3.0)


@pytest.mark.parametrize("aspect", [1.0, 1.05])
@pytest.mark.parametrize("truth", [(0.4, -0.3, 0.002), (-6.27, 3.81, -0.021), (0.0, 0.0, 0.0)])
def test_the_motion_is_found_to_a_hundredth_of_a_pixel(truth, aspect):
    texture = select_texture(looked_at(0.0, 0.0, 0.0, 2.0, index=0, aspect=aspect), AREA, 5, 2)
    picture = looked_at(*truth, noise_sigma=2.0, index=1, aspect=aspect)
    start = (round(truth[0]), round(truth[1]), 0.0)

    motion, curvature, iterations = refine(picture, texture, CENTRE, start, aspect, HUBER, 10)

    assert motion[:2] == pytest.approx(truth[:2], abs=0.02)
    assert motion[2] == pytest.approx(truth[2], abs=2e-4)
    assert iterations < 10
    np.testing.assert_array_equal(curvature, curvature.T)
    assert np.all(np.linalg.eigvalsh(curvature) > 0)


def test_the_curvature_predicts_how_the_refinement_scatters_with_noise():
    noise_sigma, n_runs = 4.0, 40
    found, predicted = [], []
    for index in range(n_runs):
        texture = select_texture(looked_at(0.0, 0.0, 0.0, noise_sigma, 2 * index), AREA, 5, 2)
        picture = looked_at(0.35, 0.2, 0.0, noise_sigma, 2 * index + 1)
        motion, curvature, _ = refine(picture, texture, CENTRE, (0.0, 0.0, 0.0), 1.0, HUBER, 10)
        differences = residuals(picture, texture, CENTRE, motion, 1.0)
        found.append(motion)
        predicted.append(np.diag(np.linalg.inv(curvature)) * differences.std() ** 2)

    ratio = np.var(found, axis=0) / np.mean(predicted, axis=0)

    assert np.all((ratio > 0.3) & (ratio < 4.0)), ratio  # neighbours share noise through the smoothing


def test_half_of_the_picture_may_be_covered(texture):
    picture = looked_at(1.3, 0.7, 0.003)
    picture[:, 150:] = 128 * SMOOTH_SCALE

    motion, _, _ = refine(picture, texture, CENTRE, (1.0, 1.0, 0.0), 1.0, HUBER, 20)

    assert motion[:2] == pytest.approx((1.3, 0.7), abs=0.15)


def test_without_texture_the_refinement_stays_where_it_started():
    blank = np.full((240, 256), 100 * SMOOTH_SCALE, np.uint16)
    texture = select_texture(blank, AREA, 5, 2)

    motion, curvature, _ = refine(blank, texture, CENTRE, (2.0, 1.0, 0.01), 1.0, HUBER, 8)

    assert motion == (2.0, 1.0, 0.01)
    assert not curvature.any()


def test_across_a_grain_without_end_only_one_direction_is_moved():
    stripes = np.tile(100.0 + 40.0 * np.sin(np.arange(256) / 5.0), (240, 1))
    picture = smooth(np.rint(stripes).astype(np.uint8))
    texture = select_texture(picture, AREA, 5, 2)

    motion, _, _ = refine(picture, texture, CENTRE, (0.6, 0.7, 0.0), 1.0, HUBER, 10)

    assert motion[0] == pytest.approx(0.0, abs=0.02)
    assert motion[1] == pytest.approx(0.7, abs=0.05)


def test_the_best_start_leaves_the_least_residual(texture):
    picture = looked_at(5.2, 0.1, 0.0)
    starts = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [5.0, 3.0, 0.0]])

    assert best_start(picture, texture, CENTRE, starts, 1.0, CLIP) == 1


def test_the_clipped_mean_counts_an_outlier_as_no_more_than_the_clip():
    assert mean_clipped(np.array([1.0, -2.0, 100.0], np.float32), 9.0) == pytest.approx(4.0)


def test_a_pixel_averages_what_it_looks_like_over_its_life():
    texture = select_texture(looked_at(0.0, 0.0, 0.0), AREA, 5, 2)
    clean = texture[VALUE].copy()
    errors = []

    for index in range(12):
        picture = looked_at(0.0, 0.0, 0.0, noise_sigma=4.0, index=index)
        differences = residuals(picture, texture, CENTRE, (0.0, 0.0, 0.0), 1.0)
        if index == 0:  # chosen in a noisy picture
            texture[VALUE] += differences
        else:
            texture, _ = advance_texture(
                picture, texture, differences, AREA, 5, CENTRE, (0.0, 0.0, 0.0), 1.0, 10.0, HUBER, ANY
            )
        errors.append(float(np.std(texture[VALUE] - clean)))

    assert errors[-1] < 0.45 * errors[0]
    assert np.all(texture[AGE] == 10.0)


def test_with_a_memory_of_one_picture_a_pixel_keeps_its_first_look(texture):
    picture = looked_at(0.0, 0.0, 0.0, noise_sigma=4.0, index=3)
    differences = residuals(picture, texture, CENTRE, (0.0, 0.0, 0.0), 1.0)

    kept, n_fresh = advance_texture(
        picture, texture, differences, AREA, 5, CENTRE, (0.0, 0.0, 0.0), 1.0, 1.0, HUBER, ANY
    )

    assert n_fresh == 0
    np.testing.assert_array_equal(kept[VALUE], texture[VALUE])


def test_pixels_and_slopes_turn_with_the_picture_and_jump_at_the_edge(texture):
    motion = (20.0, 0.0, 0.1)
    picture = looked_at(*motion)
    differences = residuals(picture, texture, CENTRE, motion, 1.0)

    moved, n_fresh = advance_texture(picture, texture, differences, AREA, 5, CENTRE, motion, 1.0, 1.0, HUBER, ANY)

    fresh = moved[AGE] == 1.0
    stayed = (moved[VALUE] == texture[VALUE]) & (moved[X] != np.rint(moved[X]))
    assert n_fresh == len(fresh) - np.count_nonzero(stayed)
    assert 0.1 < n_fresh / len(fresh) < 0.4
    cos, sin = math.cos(0.1), math.sin(0.1)
    turned = cos * texture[SLOPE_U] + sin * texture[SLOPE_V]
    np.testing.assert_allclose(moved[SLOPE_U][stayed], turned[stayed], rtol=1e-4, atol=0.5)
    assert np.all((moved[X] >= 39.5) & (moved[X] < 215.5) & (moved[Y] >= 39.5) & (moved[Y] < 199.5))


@pytest.mark.parametrize("motion", [(-6.4, 0.3, 0.012), (1.7, 4.3, -0.021), (0.4, -0.6, 0.035)])
def test_pixels_stay_different_and_spread_on_a_long_curved_drive(motion):
    rng = np.random.default_rng(5)
    picture = smooth(rng.integers(0, 256, (240, 256), np.uint8))
    texture = select_texture(picture, AREA, 5, 2)
    n_pixels = texture.shape[1]

    for _ in range(400):
        differences = np.zeros(n_pixels, np.float32)
        texture, _ = advance_texture(picture, texture, differences, AREA, 5, CENTRE, motion, 1.0, 10.0, HUBER, ANY)

    places = np.floor(np.column_stack([texture[X], texture[Y], np.arange(n_pixels) % 2]) + 0.5)
    assert len(np.unique(places, axis=0)) > 0.9 * n_pixels
    cells, _, _ = np.histogram2d(texture[X], texture[Y], bins=(8, 8), range=((40, 216), (40, 200)))
    assert cells.min() > 0.5 * n_pixels / 64


REFINED = """
import numpy as np
from trailmark_ground_vo.filters import smooth
from trailmark_ground_vo.refine import best_start, refine
from trailmark_ground_vo.texture import residuals, select_texture

rng = np.random.default_rng(7)
grains = rng.integers(0, 256, (60, 64)).astype(np.uint8)
picture = smooth(np.kron(grains, np.ones((4, 4), np.uint8)))
texture, centre = select_texture(picture, (40, 40, 216, 200), 8, 2), (127.5, 119.5)
best_start(picture, texture, centre, np.zeros((2, 3)), 1.0, 480.0)
motion, curvature, _ = refine(picture, texture, centre, (0.4, 0.2, 0.003), 1.0, 128.0, 12)
left = residuals(picture, texture, centre, motion, 1.0)
print(*(value.hex() for value in motion), curvature.tobytes().hex(), left.tobytes().hex())
"""


@pytest.mark.slow
def test_a_process_that_compiles_the_refinement_gives_the_bits_of_one_that_finds_it_compiled(tmp_path):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}

    compiling, finding = (
        subprocess.run([sys.executable, "-c", REFINED], env=environment, capture_output=True, text=True, check=True)
        for _ in range(2)
    )

    assert len(compiling.stdout) > 1000
    assert compiling.stdout == finding.stdout
