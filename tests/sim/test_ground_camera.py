"""The ground camera: exact geometry, the same bytes, noise, smear, memory."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from trailmark.errors import ConfigError
from trailmark.frames import GroundPlane
from trailmark.geometry import Pose2, Pose3, Twist2
from trailmark_sim.ground.camera import GroundCameraSensor, GroundRig
from trailmark_sim.ground.floors import FLOORS
from trailmark_sim.ground.ground import Floor, GroundTexture, Zone
from trailmark_sim.ground.optics import Optics, led_light
from trailmark_sim.ground.tiles import TILE_TEXELS, TileStore
from trailmark_sim.vehicles import VehicleState

PLAIN = Optics(vignette=0.0, read_noise=0.0, shot_noise=0.0, exposure_s=0.0, height_jitter=0.0, tilt_jitter_rad=0.0)
SMALL = GroundRig(width=160, height=120, field_m=(160 * 0.2 / 512, 120 * 0.188 / 480))


def camera(floor: str = "wood", rig: GroundRig = SMALL, optics: Optics = PLAIN, threads: int = 1) -> GroundCameraSensor:
    return GroundCameraSensor("floor", GroundTexture([Zone(Floor(floor))], 1), rig, optics, seed=7, threads=threads)


def at(x: float, y: float, theta: float, **more: float) -> VehicleState:
    return VehicleState(Pose2(x, y, theta), travelled_m=more.get("travelled_m", 0.0))


def warped(
    source: npt.NDArray[np.float32], pixel_source: npt.NDArray[np.float64], size: tuple[int, int]
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    """Return a picture seen through a homography from wanted to given pixels, and where it is known."""
    u, v = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    seen = pixel_source @ np.stack([u.ravel(), v.ravel(), np.ones(u.size)])
    x, y = ((axis / seen[2]).reshape(u.shape).astype(np.float32) for axis in seen[:2])
    known = (x > 4) & (x < source.shape[1] - 5) & (y > 4) & (y < source.shape[0] - 5)
    return np.asarray(cv2.remap(source, x, y, cv2.INTER_LINEAR)), known


@pytest.mark.parametrize("floor", sorted(FLOORS))
def test_frames_warp_onto_each_other_by_the_motion(floor: str) -> None:
    # Seen eight times finer, so that resampling for the comparison adds no error of its own.
    fine_rig = replace(SMALL, width=1280, height=960)
    first, second = at(5.0, 3.0, 0.70), at(5.0137, 2.9921, 0.72)
    coarse, fine = camera(floor), camera(floor, fine_rig, replace(PLAIN, psf_px=8 * PLAIN.psf_px))

    seen = coarse.radiance(second)
    motion = np.linalg.inv(fine.ground_pixel(first)) @ coarse.ground_pixel(second)
    expected, known = warped(fine.radiance(first), motion, (160, 120))

    error = (expected - seen)[known]
    assert known.mean() > 0.4
    assert np.sqrt((error**2).mean()) < 0.3  # grey levels
    gradients = [cv2.Sobel(seen, cv2.CV_32F, *order, scale=0.125)[known] for order in ((1, 0), (0, 1))]
    residual_px = np.linalg.lstsq(np.stack(gradients, axis=1), error, rcond=None)[0]
    assert np.abs(residual_px).max() < 0.01


def test_a_motion_of_whole_pixels_moves_the_picture_and_nothing_else() -> None:
    scale = SMALL.metres_per_pixel[0]
    there = camera("asphalt").render(0, 0.0, at(1.0, 2.0, 0.0)).pixels

    here = camera("asphalt").render(0, 0.0, at(1.0 + 10 * scale, 2.0, 0.0)).pixels

    # the robot drove 10 pixels forward, towards -u: what stood at u = 0 stands at u = 10
    np.testing.assert_allclose(here[:, 10:].astype(int), there[:, :-10], atol=1)  # rounding at half a grey
    assert (here[:, 10:] != there[:, :-10]).mean() < 1e-3


def test_forward_is_minus_u_and_left_is_plus_v_as_in_the_paper() -> None:
    homography = camera().ground_pixel(at(0.0, 0.0, 0.0))

    ahead = homography @ np.array([0.0, 59.5, 1.0])
    left = homography @ np.array([79.5, 119.0, 1.0])

    np.testing.assert_allclose(ahead[:2], [79.5 * SMALL.metres_per_pixel[0], 0.0], atol=1e-12)
    np.testing.assert_allclose(left[:2], [0.0, 59.5 * SMALL.metres_per_pixel[1]], atol=1e-12)


def test_the_calibration_says_what_the_camera_does() -> None:
    info = camera(rig=GroundRig(), optics=Optics()).info

    assert (info.kind, info.size, info.rate_hz) == ("image", (512, 480), 70.0)
    assert isinstance(info.calibration, GroundPlane)
    assert info.calibration.metres_per_pixel == pytest.approx((0.200 / 512, 0.188 / 480))
    assert info.pose_base_sensor == Pose3(yaw=math.pi)
    flat = info.calibration.flat_field
    assert flat is not None
    assert float(flat.mean()) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("floor", ["gravel", "wood"])
def test_one_and_two_threads_give_the_same_bytes(floor: str) -> None:
    states = [
        VehicleState(Pose2(0.3 * n, 0.1 * n, 0.5 * n), Twist2(2.0, 0.0, 1.0), travelled_m=0.3 * n) for n in range(4)
    ]

    one, two = (camera(floor, GroundRig(), Optics(), threads) for threads in (1, 2))

    for k, state in enumerate(states):
        np.testing.assert_array_equal(one.render(k, 0.0, state).pixels, two.render(k, 0.0, state).pixels)


def test_a_picture_does_not_depend_on_what_was_rendered_before() -> None:
    state = at(2.0, 1.0, 0.4, travelled_m=3.0)
    fresh = camera(optics=Optics()).render(5, 0.0, state).pixels
    used = camera(optics=Optics())
    for k in range(5):
        used.render(k, 0.0, at(0.1 * k, 0.0, 0.0))

    np.testing.assert_array_equal(used.render(5, 0.0, state).pixels, fresh)


def test_noise_is_as_strong_as_it_is_told_and_new_in_every_picture() -> None:
    noisy = camera("concrete", GroundRig(), replace(PLAIN, read_noise=2.0, shot_noise=3.0))
    state = at(1.0, 1.0, 0.0)
    clean = camera("concrete", GroundRig()).radiance(state)

    first, second = (noisy.render(k, 0.0, state).pixels - clean for k in (0, 1))

    expected = math.sqrt(2.0**2 + 3.0**2 * float(clean.mean()) / 255.0 + 1.0 / 12.0)
    assert first.std() == pytest.approx(expected, rel=0.02)
    assert abs(first.mean()) < 0.02
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.01
    assert abs(np.corrcoef(first[:, 1:].ravel(), first[:, :-1].ravel())[0, 1]) < 0.01
    assert abs(np.corrcoef(first[1:].ravel(), first[:-1].ravel())[0, 1]) < 0.01


def test_gain_and_offset_are_applied_before_clipping() -> None:
    state = at(1.0, 1.0, 0.0)
    plain = camera().radiance(state)

    pixels = camera(optics=replace(PLAIN, gain=2.5, offset=-30.0)).render(0, 0.0, state).pixels

    np.testing.assert_allclose(pixels, np.clip(2.5 * plain - 30.0, 0, 255), atol=0.51)
    assert pixels.max() == 255


def test_light_falls_off_towards_the_corners_and_the_flat_field_undoes_it() -> None:
    state = at(1.0, 1.0, 0.0)
    shaded = camera("concrete", GroundRig(), replace(PLAIN, vignette=0.4)).render(0, 0.0, state).pixels

    light = led_light(512, 480, 0.4)

    assert light[:40, :40].mean() < 0.9 * light.mean()
    np.testing.assert_allclose(shaded / light, camera("concrete", GroundRig()).radiance(state), atol=1.5)


def test_a_long_exposure_is_the_mean_of_the_instants_along_the_way() -> None:
    exposure_s, speed = 0.01, 0.3
    smeared = camera("gravel", optics=replace(PLAIN, exposure_s=exposure_s))
    sharp = camera("gravel")

    seen = smeared.radiance(VehicleState(Pose2(1.0, 0.0, 0.0), Twist2(speed)))

    ways = exposure_s * speed * (np.arange(64) + 0.5 - 32) / 64
    expected = np.mean([sharp.radiance(at(1.0 + way, 0.0, 0.0)) for way in ways], axis=0)
    still = sharp.radiance(at(1.0, 0.0, 0.0))
    assert np.abs(seen - expected).mean() < 0.15 * np.abs(seen - still).mean()


def test_a_picture_smeared_over_a_tenth_of_a_metre_shows_no_foreign_ground() -> None:
    fast = VehicleState(Pose2(0.0, 0.0, 0.4), Twist2(1.0, 0.2, 1.0))
    slow = replace(SMALL, rate_hz=10.0)
    reference = camera("pavers", slow, replace(PLAIN, exposure_s=0.1)).radiance(fast)
    used = camera("pavers", slow, replace(PLAIN, exposure_s=0.1))

    used.radiance(at(7.0, 1.0, 0.0))  # fills the first slot with other ground

    np.testing.assert_array_equal(used.radiance(fast), reference)


def test_each_row_of_a_rolling_shutter_is_that_of_a_picture_taken_at_its_time() -> None:
    readout_s, twist = 0.01, Twist2(0.5, 0.1, 0.8)
    rolling, sharp = camera("gravel", optics=replace(PLAIN, readout_s=readout_s)), camera("gravel")

    seen = rolling.radiance(VehicleState(Pose2(1.0, 0.0, 0.4), twist))

    for row in (0, 31, 60, 119):
        after_s = readout_s * ((row + 0.5) / 120 - 0.5)
        then = sharp.radiance(VehicleState(Pose2(1.0, 0.0, 0.4) @ twist.after(after_s)))
        np.testing.assert_allclose(seen[row], then[row], atol=0.05)  # grey levels
    shift_px = np.abs(seen - sharp.radiance(VehicleState(Pose2(1.0, 0.0, 0.4)))).mean(axis=1)
    assert shift_px[[0, 119]].min() > 5.0 * shift_px[59:61].max()


def test_a_rolling_shutter_at_rest_gives_the_bytes_of_a_global_one() -> None:
    still = at(1.0, 0.0, 0.4)
    rolling = camera("gravel", optics=replace(PLAIN, readout_s=0.01, exposure_s=0.01))

    np.testing.assert_array_equal(rolling.radiance(still), camera("gravel").radiance(still))


def test_a_rolling_and_smeared_picture_has_the_same_bytes_from_two_threads_and_shows_no_foreign_ground() -> None:
    fast = VehicleState(Pose2(0.0, 0.0, 0.4), Twist2(1.0, 0.2, 1.0))
    slow = replace(SMALL, rate_hz=10.0)
    optics = replace(PLAIN, exposure_s=0.02, readout_s=0.1)
    one, two = (camera("pavers", slow, optics, threads) for threads in (1, 2))

    two.radiance(at(7.0, 1.0, 0.0))  # fills the first slot with other ground

    np.testing.assert_array_equal(one.radiance(fast), two.radiance(fast))


def test_a_picture_that_takes_longer_than_to_the_next_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"'floor' is read for 20 ms, .* at 70 Hz .* 14\.29 ms"):
        camera(optics=replace(PLAIN, readout_s=0.02))


def test_height_jitter_scales_the_picture_about_its_middle() -> None:
    nodding = camera(optics=replace(PLAIN, height_jitter=0.01))
    level = np.linalg.inv(camera().ground_pixel(at(0, 0, 0)))

    poses = (at(0, 0, 0, travelled_m=d) for d in np.linspace(0.0, 60.0, 2000))
    scales = [np.linalg.det(level @ nodding.ground_pixel(pose)) for pose in poses]
    roots = np.sqrt(scales)

    assert roots.mean() == pytest.approx(1.0, abs=2e-3)
    assert roots.std() == pytest.approx(0.01, rel=0.1)
    middle = nodding.ground_pixel(at(0, 0, 0, travelled_m=3.0)) @ np.array([79.5, 59.5, 1.0])
    np.testing.assert_allclose(middle[:2], 0.0, atol=1e-12)


def test_a_tilt_shifts_the_picture_by_height_times_angle() -> None:
    height_m, tilt = 0.15, 1e-3
    nodding = camera(optics=replace(PLAIN, tilt_jitter_rad=tilt, camera_height_m=height_m))

    shifts = np.array(
        [
            (nodding.ground_pixel(at(0, 0, 0, travelled_m=d)) @ np.array([79.5, 59.5, 1.0]))[:2]
            for d in np.linspace(0.0, 60.0, 2000)
        ]
    )

    np.testing.assert_allclose(shifts.std(axis=0), height_m * tilt, rtol=0.1)


def test_the_memory_for_tiles_keeps_to_its_cap_and_what_was_dropped_comes_back_the_same() -> None:
    ground = GroundTexture([Zone(Floor("concrete"))], 1)
    store = TileStore(ground, 2.7e-4, cap_mb=9.0, threads=1)
    first = store.pool[store.slots_of([(0, 0)])[0]].copy()

    for n in range(1, 90):
        store.slots_of([(n, 0)])

    assert store.bytes_in_use <= 9e6
    assert store.n_painted == 90
    np.testing.assert_array_equal(store.pool[store.slots_of([(0, 0)])[0]], first)
    assert store.n_painted == 91
    store.slots_of([(89, 0)])  # one of the last is still there
    assert store.n_painted == 91


def test_tiles_that_are_looked_at_again_are_dropped_last() -> None:
    store = TileStore(GroundTexture([Zone(Floor("concrete"))], 1), 2.7e-4, cap_mb=9.0, threads=1)

    for n in range(store.n_slots + 5):
        store.slots_of([(0, 0), (n, 1)])

    assert store.n_painted == 1 + store.n_slots + 5


def test_the_pairs_of_texels_are_the_texels_of_the_pool() -> None:
    store = TileStore(GroundTexture([Zone(Floor("asphalt"))], 1), 2.7e-4, cap_mb=9.0, threads=1)
    slot = store.slots_of([(3, -2)])[0]
    side = TILE_TEXELS + 1

    pairs = store.pairs[slot * side * side : slot * side * side + side - 1]

    row = store.pool[slot, 0].astype(np.uint32)
    np.testing.assert_array_equal(np.sort([pairs & 0xFFFF, pairs >> 16], axis=0), np.sort([row[:-1], row[1:]], axis=0))


def test_too_little_memory_for_tiles_is_refused() -> None:
    with pytest.raises(ConfigError, match="tiles need at least 8 MB, not 1 MB"):
        TileStore(GroundTexture([Zone(Floor("wood"))], 1), 2.7e-4, cap_mb=1.0, threads=1)


@pytest.mark.parametrize("theta", [0.0, 0.3, math.pi / 4, 2.0, -3.0])
def test_a_picture_shows_every_tile_it_touches(theta: float) -> None:
    # the same place with tiles that lie differently: a missing tile would show as a foreign patch
    reference = camera("pavers", GroundRig()).radiance(at(0.0, 0.0, theta))
    many = camera("pavers", GroundRig())
    for n in range(4):
        many.radiance(at(3.0 + 0.2 * n, 1.0, theta))  # fills the first slots with other ground

    np.testing.assert_array_equal(many.radiance(at(0.0, 0.0, theta)), reference)
