"""The keys that stand directly under ``perturb``."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from trailmark.errors import ConfigError
from trailmark.frames import RGBD, Frame, GroundPlane, Image, Pinhole, Scalar, Scan, SensorInfo
from trailmark.geometry import Pose3
from trailmark_faults.basic import BasicConfig
from trailmark_faults.calibration import WrongCalibration, with_wrong_calibration

Run = Callable[..., list[Frame]]


@pytest.fixture(scope="module")
def run(faulty) -> Run:
    """Return the frames that are left with some keys of the fault."""
    return lambda frames, seed=0, **keys: faulty.worsened(frames, {"basic": keys}, seed=seed)


def test_nothing_is_the_same_frame(faulty, run) -> None:
    frames = faulty.pictures(3)

    assert run(frames) == frames


def test_noise_has_the_deviation_that_is_asked_for_and_no_bias(faulty, run) -> None:
    (frame,) = run(faulty.pictures(1, np.full((400, 400), 100, np.uint8)), noise=8.0)

    difference = frame.payload.pixels.astype(float) - 100.0
    assert difference.std() == pytest.approx(8.0, rel=0.02)
    assert difference.mean() == pytest.approx(0.0, abs=0.1)


def test_the_same_seed_gives_the_same_faults_and_another_one_others(faulty, run) -> None:
    keys = {"noise": 5.0, "speckle": 0.01, "flicker": 0.1, "dropped": 0.3, "occluders": {}}

    first, again, other = (run(faulty.pictures(40), seed=seed, **keys) for seed in (1, 1, 2))

    assert [f.payload.pixels.tobytes() for f in first] == [f.payload.pixels.tobytes() for f in again]
    assert [f.payload.pixels.tobytes() for f in first] != [f.payload.pixels.tobytes() for f in other]


def test_dropping_changes_no_frame_that_is_left(faulty, run) -> None:
    all_of_them = {f.stamp_s: f.payload.pixels.tobytes() for f in run(faulty.pictures(40), noise=5.0)}

    left = run(faulty.pictures(40), noise=5.0, dropped=0.4)

    assert all(f.payload.pixels.tobytes() == all_of_them[f.stamp_s] for f in left)
    assert 0 < len(left) < 40


@pytest.mark.parametrize(("in_a_row", "mean_run"), [(None, 1 / 0.7), (5.0, 5.0)])
def test_the_share_and_the_runs_of_what_is_dropped(run, in_a_row, mean_run) -> None:
    frames = [Frame("light", i / 100, Scalar(0.0)) for i in range(20000)]

    seen = run(frames, dropped=0.3, dropped_in_a_row=in_a_row)

    gaps = np.rint(np.diff([f.stamp_s for f in seen]) * 100).astype(int) - 1
    assert len(seen) / 20000 == pytest.approx(0.7, abs=0.03)
    assert gaps[gaps > 0].mean() == pytest.approx(mean_run, rel=0.1)


def test_exposure_cuts_off_at_white(faulty, run) -> None:
    (frame,) = run(faulty.pictures(1, np.array([[10, 100, 200]], np.uint8)), exposure=2.0)

    assert frame.payload.pixels.tolist() == [[20, 200, 255]]


def test_sixteen_bits_stay_sixteen_bits(faulty, run) -> None:
    (frame,) = run(faulty.pictures(1, np.full((200, 200), 30000, np.uint16)), noise=2.0)

    assert frame.payload.pixels.dtype == np.uint16
    assert frame.payload.pixels.std() == pytest.approx(2.0 * 257, rel=0.05)


def test_blur_keeps_the_mean_and_takes_the_contrast(faulty, run) -> None:
    board = (np.indices((60, 80)).sum(axis=0) % 2 * 200).astype(np.uint8)

    (frame,) = run(faulty.pictures(1, board), blur_px=2.0)

    assert frame.payload.pixels.std() < 2.0
    assert frame.payload.pixels.mean() == pytest.approx(100.0, abs=1.0)


def test_speckle_turns_its_share_black_or_white(faulty, run) -> None:
    (frame,) = run(faulty.pictures(1, np.full((300, 300), 100, np.uint8)), speckle=0.1)

    assert (frame.payload.pixels == 0).mean() == pytest.approx(0.05, abs=0.005)
    assert (frame.payload.pixels == 255).mean() == pytest.approx(0.05, abs=0.005)


def test_occluders_cover_a_square_that_moves_on(faulty, run) -> None:
    seen = run(faulty.pictures(30), occluders={"n": 1, "size": 0.5, "speed": 1.0})

    covered = [frame.payload.pixels != 100 for frame in seen]
    assert max(mask.sum() for mask in covered) == pytest.approx(30 * 30, rel=0.05)
    assert any((a != b).any() for a, b in pairwise(covered))


def test_an_occluder_leaves_no_depth(run) -> None:
    rgbd = RGBD(np.full((60, 80, 3), 100, np.uint8), np.full((60, 80), 2.0, np.float32))

    seen = run([Frame("kinect", 0.1 * i, rgbd) for i in range(10)], occluders={"n": 3, "size": 0.5})

    for frame in seen:
        hidden = (frame.payload.bgr != 100).any(axis=2)
        assert np.isnan(frame.payload.depth_m[hidden]).all()
        assert np.isfinite(frame.payload.depth_m).any()


def test_laser_ranges_get_noise_and_stray_beams(run) -> None:
    scan = Scan(np.full(4000, 5.0), 0.0, 0.001, 0.1, 30.0)

    (frame,) = run([Frame("laser", 0.0, scan)], range_noise_m=0.02, speckle=0.05)

    error = frame.payload.ranges_m - 5.0
    assert (np.abs(error) > 0.2).mean() == pytest.approx(0.05, abs=0.01)
    assert np.std(error[np.abs(error) < 0.2]) == pytest.approx(0.02, rel=0.1)


def test_frames_that_are_missing_or_late_are_counted(faulty) -> None:
    frames = [Frame("light", i / 10, Scalar(0.0)) for i in range(10)]
    perturber = faulty.chain({"basic": {"missing_s": (0.3, 0.6), "late_s": 0.025}})
    faulty.start(perturber, {"light": SensorInfo("light", "scalar")})

    seen = list(perturber.frames(iter(frames)))

    np.testing.assert_allclose([f.stamp_s for f in seen], np.array([0, 1, 2, 6, 7, 8, 9]) / 10 + 0.025)
    assert perturber.counters() == {"perturb.missing": 3, "perturb.late": 7}


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ValidationError, match="cannot be lost in runs of 1: they must be 4 long at least"):
        BasicConfig(dropped=0.8, dropped_in_a_row=1.0)
    with pytest.raises(ValidationError, match=r"missing_s is \[from, to\]"):
        BasicConfig(missing_s=(2.0, 1.0))


@pytest.mark.parametrize(
    ("keys", "refused"),
    [({"dropped_in_a_row": 3.0}, "dropped_in_a_row goes with dropped"), ({"wrong": {}}, "wrong says nothing")],
)
def test_a_key_that_says_no_fault_is_refused(keys: dict[str, Any], refused: str) -> None:
    with pytest.raises(ValidationError, match=refused):
        BasicConfig.model_validate(keys)


@pytest.mark.parametrize("keys", [{"dropped": 0.0, "dropped_in_a_row": 3.0}, {"wrong": {"scale": 1.0}}])
def test_the_zero_of_a_sweep_is_taken_also_where_it_is_written_out(keys: dict[str, Any]) -> None:
    config = BasicConfig.model_validate(keys)

    assert BasicConfig.model_validate(config.model_dump(mode="json")) == config


def test_a_wrong_mounting_and_scale_of_a_ground_camera() -> None:
    info = SensorInfo(
        "floor", "image", pose_base_sensor=Pose3(0.1, yaw=math.pi / 2), calibration=GroundPlane((1e-3, 2e-3))
    )

    believed = with_wrong_calibration(info, WrongCalibration(scale=1.02, x_m=0.01, yaw_deg=2.0))

    assert believed.calibration.metres_per_pixel == pytest.approx((1.02e-3, 2.04e-3))
    assert believed.pose_base_sensor.x == pytest.approx(0.11)
    assert believed.pose_base_sensor.yaw == pytest.approx(math.pi / 2 + math.radians(2.0))


def test_the_scale_of_other_cameras_is_their_focal_length() -> None:
    info = SensorInfo("front", "image", calibration=Pinhole(500.0, 500.0, 320.0, 240.0))

    assert with_wrong_calibration(info, WrongCalibration(scale=0.9)).calibration.fx == pytest.approx(450.0)
    assert with_wrong_calibration(info, WrongCalibration()) == info


# --- the same bytes as ever --------------------------------------------------------------------------------------

KINDS = {"grey": "image", "deep": "image", "colour": "image", "rgbd": "rgbd", "scan": "scan", "wide": "scan"}
SENSORS = {name: SensorInfo(name, kind) for name, kind in (KINDS | {"light": "scalar"}).items()}

#: What version 0.1.0 made of `all_payloads`, when these keys were core's own; blur is OpenCV's and left out.
BYTES: dict[str, tuple[dict[str, Any], str]] = {
    "nothing": ({}, "e3dc326cc960ea46"),
    "noise": ({"noise": 8.0}, "3e308a66d683576d"),
    "flicker": ({"flicker": 0.1}, "68da35beeb943e4d"),
    "exposure and noise": ({"exposure": 1.7, "noise": 3.0}, "c13568c1bd0b45e7"),
    "speckle": ({"speckle": 0.1}, "045533639752ddd4"),
    "noise and speckle": ({"speckle": 0.1, "noise": 5.0}, "1f4c3e93de35bc7e"),
    "range noise": ({"range_noise_m": 0.05}, "6a54408637054369"),
    "all of a scan": ({"range_noise_m": 0.05, "speckle": 0.1, "noise": 2.0}, "f1450c2a2b2b84b3"),
    "occluders": ({"occluders": {"n": 3, "size": 0.5, "speed": 0.7}}, "dee0378840f908c2"),
    "dropped": ({"dropped": 0.3, "noise": 4.0}, "3f63765c2a6e37d0"),
    "dropped in a row": ({"dropped": 0.4, "dropped_in_a_row": 3.0, "flicker": 0.05}, "7de1e44ef6816d34"),
    "missing": ({"missing_s": (0.25, 0.6), "noise": 1.0}, "6d4615e20d01e997"),
    "late": ({"late_s": 0.025, "dropped": 0.2}, "93afabf25e9a9fa4"),
    "some sensors": (
        {"sensors": ("grey", "scan"), "noise": 6.0, "range_noise_m": 0.01, "late_s": 0.15},
        "31a9dd1ad17fee30",
    ),
    "all": (
        {
            "noise": 5.0,
            "exposure": 0.8,
            "flicker": 0.2,
            "speckle": 0.05,
            "range_noise_m": 0.02,
            "occluders": {"n": 2},
            "dropped": 0.2,
            "dropped_in_a_row": 2.0,
            "missing_s": (0.5, 0.7),
            "late_s": 0.03,
        },
        "9e9e44800ffef023",
    ),
}


def all_payloads() -> Iterator[Frame]:
    rng = np.random.default_rng(7)
    grey = rng.integers(0, 256, (12, 16), dtype=np.uint8)
    deep = rng.integers(0, 65536, (12, 16), dtype=np.uint16)
    bgr = rng.integers(0, 256, (12, 16, 3), dtype=np.uint8)
    depth = rng.uniform(0.02, 4.0, (6, 8)).astype(np.float32)
    depth[0, 0] = np.nan
    ranges = rng.uniform(0.1, 9.0, 20).astype(np.float32)
    ranges[3] = np.nan
    for i in range(12):
        t = 0.1 * i
        yield Frame("grey", t, Image(grey))
        yield Frame("deep", t + 0.01, Image(deep))
        yield Frame("colour", t + 0.02, Image(bgr))
        yield Frame("rgbd", t + 0.03, RGBD(bgr, depth))
        yield Frame("scan", t + 0.04, Scan(ranges, 0.0, 0.1, 0.15, 8.0))
        yield Frame("wide", t + 0.05, Scan(ranges.astype(float), 0.0, 0.1))
        yield Frame("light", t + 0.06, Scalar(float(i)))


def digest(frames: Iterable[Frame]) -> str:
    hashed = hashlib.sha256()
    for frame in frames:
        hashed.update(frame.sensor.encode())
        hashed.update(np.float64(frame.stamp_s).tobytes())
        for name in ("pixels", "bgr", "depth_m", "ranges_m"):
            array = getattr(frame.payload, name, None)
            if array is not None:
                hashed.update(str(array.dtype).encode())
                hashed.update(np.ascontiguousarray(array).tobytes())
        if isinstance(frame.payload, Scalar):
            hashed.update(np.float64(frame.payload.value).tobytes())
    return hashed.hexdigest()[:16]


@pytest.mark.parametrize("case", BYTES)
def test_a_seed_gives_the_bytes_that_it_always_gave(faulty, case) -> None:
    keys, expected = BYTES[case]
    own = {key: value for key, value in keys.items() if key != "sensors"}
    perturber = faulty.chain({"basic": own}, keys.get("sensors"))
    faulty.start(perturber, SENSORS, seed=3)

    assert digest(perturber.frames(all_payloads())) == expected


@pytest.mark.parametrize(
    ("keys", "kind", "refused"),
    [
        ({"noise": 5.0}, "odometry", "perturb.noise: befalls sensors of kind image or rgbd, not it (odometry)"),
        (
            {"dropped": 0.1, "blur_px": 1.0},
            "scan",
            "perturb.blur_px: befalls sensors of kind image or rgbd, not it (scan)",
        ),
        ({"exposure": 0.5}, "imu", "perturb.exposure: befalls"),
        ({"flicker": 0.1}, "scan", "perturb.flicker: befalls"),
        ({"occluders": {}}, "scan", "perturb.occluders: befalls"),
        ({"speckle": 0.1}, "odometry", "perturb.speckle: befalls sensors of kind image or rgbd or scan, not"),
        ({"range_noise_m": 0.1}, "image", "perturb.range_noise_m: befalls sensors of kind rgbd or scan, not"),
        ({"wrong": {"scale": 1.1}}, "scan", "perturb.wrong.scale: befalls cameras with metres per pixel or focal"),
        ({"wrong": {"yaw_deg": 1.0}}, "odometry", "perturb.wrong.yaw_deg: befalls sensors that see from where they"),
    ],
)
def test_a_key_that_changes_no_sensor_is_refused(faulty, keys: dict[str, Any], kind: str, refused: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(f"sources.robot.{refused}")):
        faulty.start(faulty.chain({"basic": keys}), {"it": SensorInfo("it", kind)})


def test_a_key_is_taken_where_it_changes_one_sensor_of_several(faulty) -> None:
    sensors = {"wheels": SensorInfo("wheels", "odometry"), "floor": SensorInfo("floor", "image")}

    faulty.start(faulty.chain({"basic": {"noise": 5.0, "dropped": 0.1}}), sensors)

    with pytest.raises(ConfigError, match="noise"):
        faulty.start(faulty.chain({"basic": {"noise": 5.0}}, ["wheels"]), sensors)
