"""Marks, reflections, vignette and cover: where they are, how much they take, and that they stay."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from trailmark.frames import RGBD, Frame
from trailmark_faults.lens import CoverConfig, LensMarksConfig, draw_marks

BLACK = np.zeros((240, 320), np.uint8)
WHITE = np.full((240, 320), 255, np.uint8)


def pixels(frames) -> list[np.ndarray]:
    return [frame.payload.pixels.astype(float) for frame in frames]


@pytest.mark.parametrize("share", [0.01, 0.05, 0.2])
@pytest.mark.parametrize("kinds", [("specks",), ("scratches",), ("specks", "scratches")])
def test_marks_cover_the_share_that_is_asked_for(share, kinds) -> None:
    config = LensMarksConfig(share=share, kinds=kinds, opacity=1.0, edge_px=0.0)

    marks = draw_marks((240, 320), config, np.random.default_rng(7))

    assert (marks.cover > 0).mean() == pytest.approx(share, rel=0.15)
    assert not marks.drops.any()


def test_soft_edges_take_as_much_light_as_hard_ones() -> None:
    hard, soft = (
        draw_marks((240, 320), LensMarksConfig(share=0.05, kinds=("specks",), edge_px=edge), np.random.default_rng(7))
        for edge in (0.0, 3.0)
    )

    assert soft.cover.sum() == pytest.approx(hard.cover.sum(), rel=0.1)
    assert soft.cover.max() < hard.cover.max() + 1e-6


def test_marks_stay_in_the_picture_while_the_floor_moves(faulty, floor) -> None:
    frames = [faulty.pictures(1, np.roll(floor, 10 * i, axis=1))[0] for i in range(4)]
    frames = [Frame("floor", 0.1 * i, frame.payload) for i, frame in enumerate(frames)]

    keys = {"share": 0.05, "opacity": 1.0, "kinds": ["specks"], "edge_px": 0.0}

    seen = pixels(faulty.worsened(frames, {"lens_marks": keys}))

    changed = [np.abs(after - frame.payload.pixels) > 20 for after, frame in zip(seen, frames)]
    everywhere = np.logical_and.reduce(changed)
    assert everywhere.mean() > 0.02
    assert np.std([after[everywhere] for after in seen], axis=0).max() == 0.0


def test_a_translucent_mark_lets_the_floor_through(faulty, floor) -> None:
    keys = {"share": 0.1, "kinds": ["specks"], "edge_px": 0.0}
    (dense,) = pixels(faulty.worsened(faulty.pictures(1, floor), {"lens_marks": {**keys, "opacity": 1.0}}))
    (thin,) = pixels(faulty.worsened(faulty.pictures(1, floor), {"lens_marks": {**keys, "opacity": 0.5}}))

    mark = dense != floor
    np.testing.assert_allclose(thin[mark], (dense[mark] + floor[mark]) / 2, atol=1.0)  # rounding


def test_drops_blur_what_lies_behind_and_nothing_else(faulty, floor) -> None:
    keys = {"share": 0.1, "kinds": ["drops"], "size": 0.2, "edge_px": 0.0}
    (seen,) = pixels(faulty.worsened(faulty.pictures(1, floor), {"lens_marks": keys}))

    drops = draw_marks(floor.shape, LensMarksConfig(**keys), np.random.default_rng(7)).drops
    changed = seen != floor
    assert changed.mean() == pytest.approx((drops > 0).mean(), rel=0.1)
    assert seen[changed].std() < 0.4 * floor[changed].std()
    assert seen[changed].mean() == pytest.approx(floor[changed].mean(), abs=3.0)


def test_another_seed_puts_marks_elsewhere(faulty, floor) -> None:
    one, other = (
        pixels(faulty.worsened(faulty.pictures(1, floor), {"lens_marks": {}}, seed=seed))[0] for seed in (1, 2)
    )

    assert (one != other).any()


@pytest.mark.parametrize(("n", "share"), [(1, 0.05), (8, 0.01), (8, 0.05)])
def test_glints_saturate_their_share_of_a_dark_picture(faulty, n, share) -> None:
    keys = {"n": n, "share": share, "halo": 0.0, "ring": 0.6}

    (seen,) = pixels(faulty.worsened(faulty.pictures(1, BLACK), {"glints": keys}))

    assert (seen == 255).mean() == pytest.approx(share, rel=0.1)


def test_glints_of_a_ring_stand_on_it_and_stay(faulty, floor) -> None:
    first, second = pixels(faulty.worsened(faulty.pictures(2, BLACK), {"glints": {"ring": 0.5, "halo": 0.0}}))

    v, u = np.nonzero(first == 255)
    radius = np.hypot(u - 160, v - 120)
    assert radius.mean() == pytest.approx(0.5 * 120, rel=0.05)
    assert (first == second).all()


def test_glints_that_twinkle_change_in_brightness_not_in_place(faulty) -> None:
    seen = pixels(faulty.worsened(faulty.pictures(6, BLACK), {"glints": {"n": 1, "twinkle": 0.9}}))

    brightness = [picture.sum() for picture in seen]
    peaks = {np.unravel_index(np.argmax(picture * (picture < 255)), picture.shape) for picture in seen}
    assert max(brightness) > 1.2 * min(brightness)
    assert len(peaks) <= 6


def test_a_vignette_is_nothing_in_the_middle_and_all_of_it_in_the_corners(faulty) -> None:
    (seen,) = pixels(faulty.worsened(faulty.pictures(1, WHITE), {"vignette": {"fall": 0.4}}))

    assert seen[120, 160] == 255
    assert [seen[0, 0], seen[-1, -1]] == [153, 153]  # 0.6 of 255
    assert seen[120, 0] == pytest.approx(255 * (1 - 0.4 * 160**2 / (160**2 + 120**2)), abs=2.0)


def test_a_cover_comes_and_goes_and_stands_still(faulty, floor) -> None:
    frames = faulty.pictures(6, floor)
    cover = {"from_s": 0.15, "to_s": 0.45, "level": 60.0, "contrast": 15.0, "noise": 1.0}

    seen = pixels(faulty.worsened(frames, {"cover": cover}))

    assert [bool((picture == floor).all()) for picture in seen] == [True, True, False, False, False, True]
    assert seen[2].mean() == pytest.approx(60.0, abs=1.0)
    assert seen[2].std() == pytest.approx(15.0, rel=0.1)
    assert np.std(seen[2] - seen[3]) == pytest.approx(np.sqrt(2.0), rel=0.15)  # the camera's noise, and rounding


def test_what_leaks_through_a_cover_is_the_floor(faulty, floor) -> None:
    (seen,) = pixels(faulty.worsened(faulty.pictures(1, floor), {"cover": {"level": 0.0, "leak": 0.3, "noise": 0.0}}))

    np.testing.assert_allclose(seen, 0.3 * floor, atol=0.51)


def test_a_cover_ends_after_it_begins() -> None:
    with pytest.raises(ValidationError, match="to_s must be after from_s: 1 is not after 2"):
        CoverConfig(from_s=2.0, to_s=1.0)


def test_colour_is_worsened_and_depth_stays(faulty) -> None:
    depth = np.full((60, 80), 2.0, np.float32)
    frame = Frame("kinect", 0.0, RGBD(np.full((60, 80, 3), 200, np.uint8), depth))

    (seen,) = faulty.worsened([frame], {"vignette": {}})

    assert (seen.payload.depth_m == depth).all()
    assert (seen.payload.bgr[0, 0] == 120).all()


def test_sixteen_bits_keep_their_range(faulty) -> None:
    deep = np.full((60, 80), 40000, np.uint16)

    (seen,) = faulty.worsened(faulty.pictures(1, deep), {"vignette": {"fall": 0.5}})

    assert seen.payload.pixels.dtype == np.uint16
    assert seen.payload.pixels[0, 0] == pytest.approx(20000, abs=1)
