"""Synthetic runs of every kind of sensor, against closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trailmark.errors import ShapeError
from trailmark.frames import RGBD, Image, Imu, Odometry, Record, Scan
from trailmark.testing import Room, circle, imu_run, landmark_run, odometry_run, room_run, straight, uneven

KINDS = ("ground", "image", "rgbd", "omni", "scan", "odometry", "imu", "light", "landmarks")


@pytest.mark.parametrize("kind", KINDS)
def test_the_fixture_gives_a_run_of_every_kind(tiny_run: Callable, kind: str) -> None:
    run = tiny_run(kind)

    assert len(run.frames) == len(run.truth) >= 20
    assert [frame.stamp_s for frame in run.frames] == run.truth.stamps_s.tolist()
    assert {frame.sensor for frame in run.frames} == set(run.sensors)


def test_an_unknown_kind_is_named(tiny_run: Callable) -> None:
    with pytest.raises(ValueError, match=r"no tiny run of 'rgb' \(did you mean 'rgbd'\?\)"):
        tiny_run("rgb")


@pytest.mark.parametrize("kind", ["image", "rgbd", "omni", "scan"])
def test_the_same_arguments_give_the_same_bytes(kind) -> None:
    one, other, differing = (room_run(kind, n_frames=2, seed=seed) for seed in (3, 3, 4))

    def pixels(run) -> bytes:
        payload = run.frames[1].payload
        return (payload.bgr if isinstance(payload, RGBD) else getattr(payload, "pixels", None)
                if isinstance(payload, Image) else payload.ranges_m).tobytes()  # fmt: skip

    assert pixels(one) == pixels(other) != pixels(differing)


def test_ranges_are_those_to_the_walls() -> None:
    run = room_run("scan", straight(0.5), 3, room=Room((8.0, 5.0, 2.6)), noise_sigma=0.0)

    for frame, (_, pose) in zip(run.frames, run.truth, strict=True):
        scan = frame.payload
        assert isinstance(scan, Scan)
        ranges = dict(zip(np.round(np.degrees(scan.angles())).astype(int).tolist(), scan.ranges_m.tolist()))
        assert ranges[0] == pytest.approx(4.0 - pose.x, abs=1e-6)
        assert ranges[-180] == pytest.approx(4.0 + pose.x, abs=1e-6)
        assert ranges[90] == pytest.approx(2.5, abs=1e-6)
        assert ranges[60] == pytest.approx(2.5 / math.sin(math.radians(60)), abs=1e-6)


def test_depth_is_along_the_optical_axis() -> None:
    run = room_run("rgbd", straight(0.5), 2, room=Room((8.0, 5.0, 2.6)))

    payload = run.frames[0].payload
    assert isinstance(payload, RGBD)
    facing = payload.depth_m[60, 40:120]  # the wall ahead fills the middle: its depth is one number
    np.testing.assert_allclose(facing, 4.0, atol=1e-6)


def test_an_omnidirectional_picture_turns_with_the_robot() -> None:
    room = Room()
    ahead = room_run("omni", straight(0.0), 1, room=room, noise_sigma=0.0).frames[0].payload
    turned = room_run("omni", straight(0.0, heading_rad=math.pi / 2), 1, room=room, noise_sigma=0.0).frames[0].payload

    # the robot turns to the left; what it saw ahead (+u) is on its right now, which the picture shows below (+v)
    assert isinstance(ahead, Image)
    assert isinstance(turned, Image)
    back = np.rot90(turned.pixels, 1)
    same = np.all(back == ahead.pixels, axis=2).mean()
    assert same > 0.95


def test_odometry_and_yaw_rate_are_exact() -> None:
    wheels, gyro = odometry_run(circle(0.3, 2.0), 50), imu_run(circle(0.3, 2.0), 50)

    reading = wheels.frames[-1].payload
    assert isinstance(reading, Odometry)
    assert reading.pose_start_base == wheels.truth[0][1].between(wheels.truth[-1][1])
    assert reading.twist is not None
    assert (reading.twist.forward_mps, reading.twist.yaw_radps) == pytest.approx((0.3, 0.15), abs=1e-6)
    inertial = gyro.frames[10].payload
    assert isinstance(inertial, Imu)
    assert inertial.angular_velocity_radps[2] == pytest.approx(0.15, abs=1e-6)


def test_landmarks_are_where_the_calibration_says() -> None:
    run = landmark_run(n_frames=5)

    sensor = run.sensors["sightings"]
    positions = sensor.calibration.arrays["positions_map"]  # type: ignore[union-attr]
    for frame, (_, pose) in zip(run.frames, run.truth, strict=True):
        assert isinstance(frame.payload, Record)
        seen = frame.payload.arrays
        ahead = seen["ranges_m"] * np.exp(1j * (seen["bearings_rad"] + pose.theta))
        np.testing.assert_allclose(np.stack([ahead.real + pose.x, ahead.imag + pose.y], 1), positions, atol=1e-9)


def test_runs_of_the_same_motion_are_merged_by_stamp() -> None:
    run = odometry_run(n_frames=10).with_sensors(imu_run(n_frames=40))

    stamps = [frame.stamp_s for frame in run.frames]
    assert stamps == sorted(stamps)
    assert set(run.sensors) == {"wheels", "imu"}
    assert len(run.frames) == 50


def test_an_uneven_drive_goes_the_same_way_faster_and_slower() -> None:
    even, drive = circle(0.3, 1.0), uneven(circle(0.3, 1.0), share=0.6, period_s=2.0)

    speeds = np.array([drive(t).distance_to(drive(t + 1e-4)) / 1e-4 for t in np.arange(0.0, 2.0, 0.01)])

    assert speeds.min() == pytest.approx(0.3 * 0.4, rel=0.02)
    assert speeds.max() == pytest.approx(0.3 * 1.6, rel=0.02)
    np.testing.assert_allclose(drive(4.0).array(), even(4.0).array(), atol=1e-9)  # after whole periods


@pytest.mark.parametrize(("share", "period_s"), [(-0.1, 1.0), (1.1, 1.0), (0.5, 0.0)])
def test_a_swing_that_cannot_be_is_refused(share: float, period_s: float) -> None:
    with pytest.raises(ValueError, match="between 0 and 1 and the period be positive"):
        uneven(circle(0.3, 1.0), share, period_s)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda run: {"sensors": {}}, "frames of wheels, but the sensors are"),
        (lambda run: {"sensors": {"wheels": replace(run.sensors["wheels"], name="other")}}, "says that it is 'other'"),
        (lambda run: {"frames": run.frames[::-1]}, "in the order of their stamps"),
        (lambda run: {"truth": run.truth.between(5.0, 6.0)}, "one pose at least"),
        (lambda run: {"truth": run.truth.between(0.0, 0.2)}, "the truth covers 0.0 to 0.2 s, but a frame is of 0.25 s"),
    ],
)
def test_a_run_that_does_not_fit_together_is_refused(change: Callable, message: str) -> None:
    run = odometry_run(n_frames=10)

    with pytest.raises(ShapeError, match=message):
        replace(run, **change(run))


def test_the_repr_of_a_run_does_not_flood() -> None:
    text = repr(room_run("image", n_frames=3))

    assert text == "SyntheticRun(3 frames of image; truth Trajectory(3 poses, 0 to 0.2 s, 0.06 m))"
