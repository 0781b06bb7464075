"""A robot does not stand while parts of its picture move, be most of it covered; light, noise and compression may."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import pytest

from trailmark.frames import Image
from trailmark.testing.ground import MirroredFloor, ground_run, straight
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.moving_layer import LayerWatch

SIZE, STILL = (320, 240), ImageMotion(0.0, 0.0, 0.0)
U, V = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
PLACES = {
    "left": U / SIZE[0],
    "top": V / SIZE[1],
    "ring": -np.minimum(np.minimum(U, 319 - U) / SIZE[0], np.minimum(V, 239 - V) / SIZE[1]),
    "centre": np.hypot(U / SIZE[0] - 0.5, V / SIZE[1] - 0.5),
    "scattered": cv2.GaussianBlur(np.random.default_rng(3).standard_normal(SIZE[::-1]), (0, 0), 10.0),
}


def blobs(seed: int, sigma_px: float, shape: tuple[int, int]) -> np.ndarray:
    made = cv2.GaussianBlur(np.random.default_rng(seed).standard_normal(shape), (0, 0), sigma_px)
    return made / made.std()


GROUND, STICKER = 120.0 + 10.0 * blobs(1, 1.5, (240, 900)), 120.0 + 30.0 * blobs(2, 1.5, (240, 320))


def seen(u: float, seed: int, covered=None) -> np.ndarray:
    """Return a picture of the ground, u to the right, some of it covered."""
    moved = cv2.warpAffine(GROUND, np.array([[1.0, 0.0, u - 500.0], [0.0, 1.0, 0.0]]), SIZE, flags=cv2.INTER_CUBIC)
    shown = moved if covered is None else np.where(covered, STICKER, moved)
    return np.clip(np.rint(shown + np.random.default_rng(seed).normal(0.0, 3.0, shown.shape)), 0, 255).astype(np.uint8)


def findings(pictures, motion=STILL, **keys) -> list[bool]:
    watch = LayerWatch(SIZE)
    return [watch.is_moving(before, now, motion, **keys) for before, now in pairwise(pictures)]


def covered(place: str, share: float) -> np.ndarray:
    return np.asarray(PLACES[place] <= np.quantile(PLACES[place], share))


@pytest.mark.parametrize("step_px", [1.5, 12.0, 40.0])
@pytest.mark.parametrize("share", [0.5, 0.7, 0.95])
@pytest.mark.parametrize("place", PLACES)
def test_ground_that_moves_beside_a_cover_is_found(place, share, step_px):
    cover = covered(place, share)

    assert all(findings([seen(step_px * n, n, cover) for n in range(7)])[3:])


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7])
def test_at_rest_nothing_moves_beside_a_cover(share):
    cover = covered("left", share)

    assert not any(findings([seen(0.0, n, cover) for n in range(20)]))


@pytest.mark.parametrize("quality", [90, 60, 30])
def test_at_rest_compression_does_not_move(quality):
    pictures = [cv2.imencode(".jpg", seen(0.0, n), [cv2.IMWRITE_JPEG_QUALITY, quality])[1] for n in range(10)]

    assert not any(findings([cv2.imdecode(picture, cv2.IMREAD_GRAYSCALE) for picture in pictures]))


def test_ground_that_moves_as_was_found_moves_beside_nothing():
    pictures = [seen(0.6 * n, n) for n in range(12)]

    assert not any(findings(pictures, ImageMotion(0.6, 0.0, 0.0)))


def test_what_passes_by_is_no_doubt_where_others_say_that_the_robot_stands():
    pictures = []
    for n in range(8):
        picture = seen(0.0, n)
        picture[60:160, 20 + 6 * n : 60 + 6 * n] = STICKER[:100, :40].clip(0, 255)
        pictures.append(picture)

    assert any(findings(pictures))
    assert not any(findings(pictures, others_rest=True))


def test_faint_ground_beneath_a_film_is_found_in_some_pictures():
    """One picture says too little of it: noise as likely looks so."""
    faint = [seen(8.0 * n, n).astype(np.float64) for n in range(9)]
    noise = [np.random.default_rng(50 + n).normal(0.0, 3.0, SIZE[::-1]) for n in range(9)]
    film = 0.9 * (STICKER - 120.0) + 120.0
    pictures = [np.clip(np.rint(film + 0.11 * (p - 120.0) + e), 0, 255).astype(np.uint8) for p, e in zip(faint, noise)]

    assert any(findings(pictures))


def test_at_rest_no_picture_is_moved_on(monkeypatch):
    """It costs as much as all the rest of the comparison."""
    monkeypatch.setattr(LayerWatch, "_moved_on", lambda *_: pytest.fail("a picture was moved on at rest"))

    findings([seen(0.0, n) for n in range(4)])


def test_a_sticker_over_most_of_the_lens_does_not_hold_a_robot_that_drives(camera, track):
    floor = MirroredFloor.procedural(seed=11, size_px=512, grain_px=1.5)
    width, height = camera.size
    sticker = 120.0 + 40.0 * blobs(4, 1.5, (height, width))
    n_covered = round(0.75 * width)

    def beside(index, frame):
        pixels = frame.payload.pixels.copy()
        noisy = sticker + np.random.default_rng(index).normal(0.0, 3.0, sticker.shape)
        pixels[:, :n_covered] = np.clip(np.rint(noisy), 0, 255)[:, :n_covered]
        return frame.__class__(frame.sensor, frame.stamp_s, Image(pixels))

    tracked = track(ground_run(straight(0.3), 25, ground=floor, camera=camera), change=beside)

    assert not tracked.motions
    assert any("beneath" in lost.reason for lost in tracked.lost)
