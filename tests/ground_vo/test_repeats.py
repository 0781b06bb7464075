"""A picture that is repeated, bit by bit or encoded again, is told from a robot that brakes or stands."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from trailmark.frames import Image
from trailmark.geometry import Pose2
from trailmark.testing.ground import ground_run, straight
from trailmark_ground_vo.cadence import Cadence
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.repeats import RepeatWatch, _difference

FAST, STILL = ImageMotion(12.0, -3.0, 0.0), ImageMotion(0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def texture() -> np.ndarray:
    blobs = cv2.GaussianBlur(np.random.default_rng(2).standard_normal((240, 340)), (0, 0), 2.0)
    return 120.0 + 15.0 * blobs / blobs.std()


def seen(texture, u: float, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0.0, 3.0, (200, 240))
    return np.clip(np.rint(texture[20:220, 50 - round(u) : 290 - round(u)] + noise), 0, 255).astype(np.uint8)


def watch_of(images) -> RepeatWatch:
    watch = RepeatWatch()
    for image in images:
        watch.keep(image)
    return watch


@pytest.fixture
def moving(texture) -> RepeatWatch:
    """A watch that has seen the ground come to its place at 12 px per picture."""
    return watch_of(seen(texture, u, 40 + u) for u in (-24, -12, 0))


def smeared(image: np.ndarray) -> np.ndarray:
    """Return a picture through a lens with dirt that stands out far more than the ground."""
    dirt = np.zeros(image.shape, np.float32)
    for v, u in np.random.default_rng(5).integers((0, 0), image.shape, (80, 2)):
        cv2.circle(dirt, (int(u), int(v)), 5, 0.6, -1, cv2.LINE_AA)
    faint = 120.0 + 0.3 * (image - 120.0)
    return np.clip(np.rint(faint * (1.0 - cv2.GaussianBlur(dirt, (0, 0), 1.5))), 0, 255).astype(np.uint8)


def encoded(image: np.ndarray, quality: int = 80) -> np.ndarray:
    return cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_GRAYSCALE)


def test_the_same_picture_is_known_bit_by_bit(texture):
    watch, image = RepeatWatch(), seen(texture, 0, 0)
    assert not watch.is_same(image)
    watch.keep(image)

    assert watch.is_same(image.copy())
    assert not watch.is_same(encoded(image))


def test_a_picture_that_was_encoded_again_while_the_robot_moved_is_known(texture, moving):
    image = encoded(seen(texture, 0, 40))

    assert moving.is_encoded_again(image, FAST)
    assert not moving.is_encoded_again(image, ImageMotion(0.4, 0.0, 0.0))
    assert not moving.is_encoded_again(image, None)


@pytest.mark.parametrize("moved_px", [12.0, 6.0, 3.0, 2.0])
def test_a_robot_that_brakes_repeats_nothing(texture, moving, moved_px):
    assert not moving.is_encoded_again(seen(texture, moved_px, 1), FAST)


def test_a_robot_that_stands_on_is_believed_after_a_few_pictures(texture, moving):
    said = [moving.is_encoded_again(seen(texture, 0, seed), FAST) for seed in range(1, 6)]

    assert said[:3] == [True, True, True]
    assert not said[3]


@pytest.mark.parametrize("n_earlier", [1, 3, 10])
def test_dirt_on_the_lens_repeats_no_picture(texture, n_earlier):
    *earlier, image = [smeared(seen(texture, 4 * n, 20 + n)) for n in range(-1 - n_earlier, 0)]
    watch = watch_of([*earlier, image])

    assert not watch.is_encoded_again(smeared(seen(texture, 0, 0)), ImageMotion(4.0, 0.0, 0.0))
    assert watch.is_encoded_again(encoded(image), ImageMotion(4.0, 0.0, 0.0))


@pytest.mark.parametrize("lens", [np.asarray, smeared], ids=["clean", "dirty"])
def test_the_way_over_a_repeated_frame_is_told_with_the_next(camera, ground, track, lens):
    run = ground_run(straight(0.3), 40, ground=ground, camera=camera)
    before = {}

    def repeat(index, frame):
        is_repeated = index % 6 == 5
        # another quality: what is encoded again at the same one stays the same bit by bit
        pixels = encoded(before["pixels"], 70) if is_repeated else encoded(lens(frame.payload.pixels))
        before["pixels"] = pixels
        return frame.__class__(frame.sensor, frame.stamp_s, Image(pixels))

    tracked = track(run, change=repeat)

    again = [lost.stamp_s for lost in tracked.lost if "encoded anew" in lost.reason]
    assert again == [frame.stamp_s for frame in run.frames[5::6]]
    assert len(tracked.motions) >= 30
    for motion in tracked.motions:
        assert abs(motion.pose_since_now.x - 0.3 * (motion.stamp_s - motion.since_s)) < 5e-4


def test_where_every_second_picture_is_a_repeat_a_start_from_rest_is_told_right(camera, ground, track):
    """The source crawls at first, stands, and starts anew: a converter has doubled its pictures, with new noise."""
    steps_px = np.array([0.0] * 6 + [1.0] * 14 + [0.0] * 12 + [9.0] * 12)
    way_m = camera.metres_per_pixel[0] * np.cumsum(steps_px)
    run = ground_run(lambda t: Pose2(float(way_m[round(70 * t)])), len(way_m), ground=ground, camera=camera)

    def double(index, frame):
        pixels = run.frames[index - index % 2].payload.pixels
        noisy = pixels + np.random.default_rng(index).normal(0.0, 1.0, pixels.shape)
        return frame.__class__(frame.sensor, frame.stamp_s, Image(np.clip(np.rint(noisy), 0, 255).astype(np.uint8)))

    tracked = track(run, change=double)

    assert len([motion for motion in tracked.motions if motion.stamp_s > 32 / 70]) >= 5
    for motion in tracked.motions:
        at = [way_m[round(70 * stamp_s)] for stamp_s in (motion.since_s, motion.stamp_s)]
        assert abs(motion.pose_since_now.x - (at[1] - at[0])) < 5e-4


def test_jitter_of_noise_is_no_cadence():
    cadence = Cadence()
    for _ in range(6):
        cadence.add_motion(ImageMotion(0.4, 0.0, 0.0), 3.4)
        assert not cadence.is_due
        assert cadence.stands(STILL)
        cadence.add_repeat(3.35)


def test_a_picture_that_differs_more_than_a_repeat_ends_the_cadence():
    cadence = Cadence()
    for _ in range(2):
        cadence.add_motion(FAST, 20.0)
        cadence.add_repeat(3.0)
    cadence.add_motion(FAST, 20.0)
    assert cadence.is_due

    assert cadence.is_repeat(3.1)
    assert not cadence.is_repeat(9.0)
    assert not cadence.is_due


@pytest.mark.parametrize("shift", [(0, 0), (7, -3), (-11, 4), (120, 0)])
def test_the_difference_of_grey_pictures_is_that_of_their_numbers(texture, shift: tuple[int, int]) -> None:
    before, now = seen(texture, 0, 1), seen(texture, 5, 2)

    assert _difference(before, now, shift) == _difference(before.astype(np.float32), now.astype(np.float32), shift)
