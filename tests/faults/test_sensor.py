"""Low light, motion blur and grains; a wet patch."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.frames import Frame
from trailmark_faults.sensor import line_kernel, photograph
from trailmark_faults.wet import glint_light, patch_outline


def pixels(frames) -> list[np.ndarray]:
    return [frame.payload.pixels.astype(float) for frame in frames]


def test_shot_noise_is_the_root_of_the_electrons() -> None:
    read = photograph(np.full((400, 400), 900.0, np.float32), 40.0, np.random.default_rng(7))

    assert read.mean() == pytest.approx(900.0, abs=1.0)
    assert read.std() == pytest.approx(50.0, rel=0.01)  # sqrt(900 + 40^2)


@pytest.mark.parametrize("level", [50, 200])
def test_low_light_is_dark_and_bright_pixels_are_noisier(faulty, level) -> None:
    keys = {"light": 0.05, "gain": 8.0, "full_well": 5000.0, "read_noise": 4.0}
    frames = faulty.pictures(1, np.full((300, 300), level, np.uint8))

    (seen,) = pixels(faulty.worsened(frames, {"low_light": keys}))

    electrons = level / 255 * 5000 * 0.05
    assert seen.mean() == pytest.approx(0.4 * level, rel=0.03)
    assert seen.std() == pytest.approx(math.sqrt(electrons + 16) * 8 * 255 / 5000, rel=0.05)


@pytest.mark.parametrize(("length", "angle"), [(8.0, 0.0), (5.5, 0.6), (12.0, math.pi / 2), (0.4, 1.0)])
def test_the_kernel_of_a_smear_has_its_length_and_direction_and_no_shift(length, angle) -> None:
    kernel = line_kernel(length, angle).astype(float)
    v, u = np.mgrid[0 : len(kernel), 0 : len(kernel)] - len(kernel) // 2

    assert kernel.sum() == pytest.approx(1.0)
    assert [(kernel * u).sum(), (kernel * v).sum()] == pytest.approx([0.0, 0.0], abs=1e-5)
    along = u * math.cos(angle) + v * math.sin(angle)
    spread = (kernel * along**2).sum()  # of an even line length^2 / 12, and of steps between pixels up to 1/4
    assert length**2 / 12 - 0.05 <= spread <= length**2 / 12 + 0.3


def test_motion_blur_smears_along_and_not_across(faulty) -> None:
    stripes = np.tile(np.arange(80) % 8 < 4, (60, 1)).astype(np.uint8) * 200
    frames = faulty.pictures(1, stripes)

    (along,) = pixels(faulty.worsened(frames, {"motion_blur": {"length_px": 8.0, "angle_deg": 90.0}}))
    (across,) = pixels(faulty.worsened(frames, {"motion_blur": {"length_px": 8.0, "angle_deg": 0.0}}))

    assert (along == stripes).all()
    assert np.ptp(across[:, 10:-10]) < 10


def test_specks_cover_their_share_and_are_elsewhere_each_time(faulty) -> None:
    frames = faulty.pictures(2, np.full((240, 320), 100, np.uint8))

    first, second = pixels(faulty.worsened(frames, {"specks": {"share": 0.02, "size_px": 6.0}}))

    assert (first != 100).mean() == pytest.approx(0.025, abs=0.01)  # soft edges touch more than they cover
    assert ((first != 100) & (second != 100)).mean() < 0.005
    assert (first == 255).any()
    assert (first == 0).any()


def test_a_wet_patch_is_darker_with_less_contrast_where_it_is(faulty, floor) -> None:
    keys = {"size": 2.5, "speed": 0.0, "light": 0.6, "contrast": 0.3, "glints": 0}
    seeds = range(20)
    seen = [pixels(faulty.worsened(faulty.pictures(1, floor), {"wet_patch": keys}, seed=seed))[0] for seed in seeds]

    wettest = min(seen, key=np.mean)
    wet = wettest < 0.85 * floor
    assert wet.mean() > 0.5
    assert wettest[wet].mean() == pytest.approx(0.6 * floor[wet].mean(), rel=0.1)
    assert wettest[wet].std() < 0.6 * 0.8 * floor[wet].std()


def test_a_wet_patch_passes_through_the_picture_and_comes_again(faulty, floor) -> None:
    frames = faulty.pictures(200, floor)

    seen = pixels(faulty.worsened(frames, {"wet_patch": {"speed": 0.3, "glints": 0}}))

    wet = np.array([(picture < 0.8 * floor).mean() for picture in seen])
    assert wet.max() > 0.2
    assert wet.min() == 0.0
    assert np.count_nonzero(np.diff((wet > 0.1).astype(int)) == 1) >= 2


def test_lamps_shine_in_a_wet_patch_and_slide_over_the_floor(faulty) -> None:
    frames = [Frame("floor", 0.5 * i, faulty.pictures(1, np.full((240, 320), 60, np.uint8))[0].payload) for i in (0, 1)]
    keys = {"size": 3.0, "speed": 0.1, "glints": 5, "glint_px": 8.0}

    first, second = pixels(faulty.worsened(frames, {"wet_patch": keys}))

    assert (first == 255).any()
    assert ((first == 255) != (second == 255)).any()


def test_the_outline_of_a_patch_is_soft_and_whole() -> None:
    outline = patch_outline(100, np.random.default_rng(7))

    assert outline[50, 50] == 1.0
    assert max(outline[0].max(), outline[-1].max(), outline[:, 0].max(), outline[:, -1].max()) == 0.0
    assert ((outline > 0) & (outline < 1)).any()


def test_a_highlight_is_as_wide_as_it_is_told() -> None:
    light = glint_light((41, 41), np.array([[20.0, 20.0]]), 8.0)

    assert light[20, 20] == 510.0
    assert light[20, 24] == pytest.approx(255.0, rel=0.01)  # half at half its width
    assert glint_light((41, 41), np.array([[500.0, 500.0]]), 8.0).max() == 0.0
