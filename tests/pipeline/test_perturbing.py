"""Faults of sensors on purpose."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from pydantic import ValidationError

from trailmark.config import Occluders, Perturbation, SourceConfig, WrongCalibration
from trailmark.errors import ConfigError
from trailmark.frames import RGBD, Frame, GroundPlane, Image, Pinhole, Scan, SensorInfo
from trailmark.geometry import Pose3
from trailmark.pipeline import Pipeline
from trailmark.pipeline.perturbing import misjudged

GREY = np.full((60, 80), 100, np.uint8)


def run(fakes, frames, *, seed=0, **faults):
    """Return the frames that reach a run, and what was counted."""
    options = {"s": SourceConfig(perturb=Perturbation(**faults))}
    pipeline = Pipeline(fakes.plan({"s": fakes.Recording(frames)}, options=options, seed=seed))
    seen = [step.frame for step in pipeline if step.frame is not None]
    return seen, pipeline.result.counters


def pictures(n, pixels=GREY, sensor="floor"):
    return [Frame(sensor, 0.1 * i, Image(pixels)) for i in range(n)]


def test_nothing_is_the_same_frame(fakes) -> None:
    frames = pictures(3)

    seen, _ = run(fakes, frames)

    assert seen == frames


def test_noise_has_the_deviation_that_is_asked_for_and_no_bias(fakes) -> None:
    (frame,), _ = run(fakes, pictures(1, np.full((400, 400), 100, np.uint8)), noise=8.0)

    difference = frame.payload.pixels.astype(float) - 100.0
    assert difference.std() == pytest.approx(8.0, rel=0.02)
    assert difference.mean() == pytest.approx(0.0, abs=0.1)


def test_the_same_seed_gives_the_same_faults_and_another_one_others(fakes) -> None:
    faults = {"noise": 5.0, "speckle": 0.01, "flicker": 0.1, "dropped": 0.3, "occluders": Occluders()}

    first, again, other = (run(fakes, pictures(40), seed=seed, **faults)[0] for seed in (1, 1, 2))

    assert [f.payload.pixels.tobytes() for f in first] == [f.payload.pixels.tobytes() for f in again]
    assert [f.payload.pixels.tobytes() for f in first] != [f.payload.pixels.tobytes() for f in other]


def test_dropping_changes_no_frame_that_is_left(fakes) -> None:
    all_of_them = {f.stamp_s: f.payload.pixels.tobytes() for f in run(fakes, pictures(40), noise=5.0)[0]}

    left, counters = run(fakes, pictures(40), noise=5.0, dropped=0.4)

    assert all(f.payload.pixels.tobytes() == all_of_them[f.stamp_s] for f in left)
    assert 0 < counters["source.s.perturb.dropped"] == 40 - len(left)


@pytest.mark.parametrize(("in_a_row", "mean_run"), [(None, 1 / 0.7), (5.0, 5.0)])
def test_the_share_and_the_runs_of_what_is_dropped(fakes, in_a_row, mean_run) -> None:
    frames = fakes.scalar_frames("light", np.arange(20000) / 100)

    seen, _ = run(fakes, frames, dropped=0.3, dropped_in_a_row=in_a_row)

    gaps = np.rint(np.diff([f.stamp_s for f in seen]) * 100).astype(int) - 1
    assert len(seen) / 20000 == pytest.approx(0.7, abs=0.03)
    assert gaps[gaps > 0].mean() == pytest.approx(mean_run, rel=0.1)


def test_exposure_cuts_off_at_white(fakes) -> None:
    (frame,), _ = run(fakes, pictures(1, np.array([[10, 100, 200]], np.uint8)), exposure=2.0)

    assert frame.payload.pixels.tolist() == [[20, 200, 255]]


def test_sixteen_bits_stay_sixteen_bits(fakes) -> None:
    (frame,), _ = run(fakes, pictures(1, np.full((200, 200), 30000, np.uint16)), noise=2.0)

    assert frame.payload.pixels.dtype == np.uint16
    assert frame.payload.pixels.std() == pytest.approx(2.0 * 257, rel=0.05)


def test_blur_keeps_the_mean_and_takes_the_contrast(fakes) -> None:
    board = (np.indices((60, 80)).sum(axis=0) % 2 * 200).astype(np.uint8)

    (frame,), _ = run(fakes, pictures(1, board), blur_px=2.0)

    assert frame.payload.pixels.std() < 2.0
    assert frame.payload.pixels.mean() == pytest.approx(100.0, abs=1.0)


def test_speckle_turns_its_share_black_or_white(fakes) -> None:
    (frame,), _ = run(fakes, pictures(1, np.full((300, 300), 100, np.uint8)), speckle=0.1)

    assert (frame.payload.pixels == 0).mean() == pytest.approx(0.05, abs=0.005)
    assert (frame.payload.pixels == 255).mean() == pytest.approx(0.05, abs=0.005)


def test_occluders_cover_a_square_that_moves_on(fakes) -> None:
    seen, _ = run(fakes, pictures(30), occluders=Occluders(n=1, size=0.5, speed=1.0))

    covered = [frame.payload.pixels != 100 for frame in seen]
    assert max(mask.sum() for mask in covered) == pytest.approx(30 * 30, rel=0.05)
    assert any((a != b).any() for a, b in pairwise(covered))


def test_an_occluder_leaves_no_depth(fakes) -> None:
    rgbd = RGBD(np.full((60, 80, 3), 100, np.uint8), np.full((60, 80), 2.0, np.float32))

    seen, _ = run(fakes, [Frame("kinect", 0.1 * i, rgbd) for i in range(10)], occluders=Occluders(n=3, size=0.5))

    for frame in seen:
        hidden = (frame.payload.bgr != 100).any(axis=2)
        assert np.isnan(frame.payload.depth_m[hidden]).all()
        assert np.isfinite(frame.payload.depth_m).any()


def test_laser_ranges_get_noise_and_stray_beams(fakes) -> None:
    scan = Scan(np.full(4000, 5.0), 0.0, 0.001, 0.1, 30.0)

    (frame,), _ = run(fakes, [Frame("laser", 0.0, scan)], range_noise_m=0.02, speckle=0.05)

    error = frame.payload.ranges_m - 5.0
    assert (np.abs(error) > 0.2).mean() == pytest.approx(0.05, abs=0.01)
    assert np.std(error[np.abs(error) < 0.2]) == pytest.approx(0.02, rel=0.1)


def test_a_missing_sensor_says_nothing_for_a_while_and_others_go_on(fakes) -> None:
    frames = sorted(
        [*fakes.scalar_frames("light", np.arange(10) / 10), *fakes.scalar_frames("wheels", np.arange(10) / 10)],
        key=lambda frame: frame.stamp_s,
    )

    seen, counters = run(fakes, frames, missing_s=(0.3, 0.6), sensors=("light",))

    assert {round(f.stamp_s, 1) for f in seen if f.sensor == "light"}.isdisjoint({0.3, 0.4, 0.5})
    assert sum(f.sensor == "wheels" for f in seen) == 10
    assert counters["source.s.perturb.missing"] == 3


def test_a_late_sensor_arrives_among_the_others_in_order(fakes) -> None:
    frames = sorted(
        [*fakes.image_frames("floor", np.arange(5) / 10), *fakes.scalar_frames("wheels", np.arange(50) / 100)],
        key=lambda frame: frame.stamp_s,
    )
    options = {"s": SourceConfig(perturb=Perturbation(sensors=("floor",), late_s=0.025))}

    seen = [step.frame for step in Pipeline(fakes.plan({"s": fakes.Recording(frames)}, options=options))]

    stamps = [frame.stamp_s for frame in seen]
    assert stamps == sorted(stamps)
    np.testing.assert_allclose([f.stamp_s for f in seen if f.sensor == "floor"], np.arange(5) / 10 + 0.025)
    assert sum(f.sensor == "wheels" for f in seen) == 50


def test_a_sensor_that_is_not_there_is_refused(fakes) -> None:
    options = {"s": SourceConfig(perturb=Perturbation(sensors=("flor",), noise=1.0))}

    with pytest.raises(ConfigError, match=r"sources.s.perturb.sensors: the source has no sensor 'flor'; it has floor"):
        list(Pipeline(fakes.plan({"s": fakes.Recording(pictures(1))}, options=options)))


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ValidationError, match="cannot be lost in runs of 1: they must be 4 long at least"):
        Perturbation(dropped=0.8, dropped_in_a_row=1.0)
    with pytest.raises(ValidationError, match=r"missing_s is \[from, to\]"):
        Perturbation(missing_s=(2.0, 1.0))


def test_a_wrong_calibration_is_believed_and_the_pictures_stay(fakes) -> None:
    eye = fakes.Scripted()
    info = SensorInfo(
        "floor", "image", pose_base_sensor=Pose3(0.1, yaw=math.pi / 2), calibration=GroundPlane((1e-3, 2e-3))
    )
    wrong = WrongCalibration(scale=1.02, x_m=0.01, yaw_deg=2.0)
    options = {"s": SourceConfig(perturb=Perturbation(wrong=wrong))}
    plan = fakes.plan({"s": fakes.Recording(pictures(2), [info])}, {"eye": eye}, options=options)

    seen = [step.frame.payload.pixels for step in Pipeline(plan)]

    believed = eye.session.sensors["floor"]
    assert believed.calibration.metres_per_pixel == pytest.approx((1.02e-3, 2.04e-3))
    assert believed.pose_base_sensor.x == pytest.approx(0.11)
    assert believed.pose_base_sensor.yaw == pytest.approx(math.pi / 2 + math.radians(2.0))
    assert all((pixels == GREY).all() for pixels in seen)


def test_the_scale_of_other_cameras_is_their_focal_length() -> None:
    info = SensorInfo("front", "image", calibration=Pinhole(500.0, 500.0, 320.0, 240.0))

    assert misjudged(info, WrongCalibration(scale=0.9)).calibration.fx == pytest.approx(450.0)
    assert misjudged(info, WrongCalibration()) == info
