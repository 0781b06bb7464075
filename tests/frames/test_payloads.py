"""Frames and payloads: checked once, read-only ever after."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.errors import ShapeError
from trailmark.frames import RGBD, Frame, Image, Imu, Odometry, Payload, Record, Scalar, Scan, SensorInfo, payload_kind
from trailmark.geometry import Pose2

BGR = np.zeros((4, 6, 3), np.uint8)
DEPTH = np.ones((4, 6), np.float32)


@pytest.mark.parametrize(
    "pixels", [np.zeros((4, 6), np.uint8), np.zeros((4, 6), np.uint16), BGR, np.zeros((1, 1), np.uint8)]
)
def test_images_are_grey_or_bgr(pixels: npt.NDArray[Any]) -> None:
    image = Image(pixels)

    assert image.size == (pixels.shape[1], pixels.shape[0])
    assert np.shares_memory(image.pixels, pixels)  # a view, not a copy


@pytest.mark.parametrize(
    "pixels",
    [
        np.zeros((4, 6), np.float32),
        np.zeros((4, 6), np.int16),
        np.zeros((4, 6, 4), np.uint8),
        np.zeros((4, 6, 3), np.uint16),
        np.zeros((4, 6, 1), np.uint8),
        np.zeros((0, 6), np.uint8),
        np.zeros(6, np.uint8),
    ],
)
def test_other_pictures_are_refused(pixels: npt.NDArray[Any]) -> None:
    with pytest.raises(ShapeError, match="an image is"):
        Image(pixels)


@pytest.mark.parametrize(
    ("bgr", "depth", "message"),
    [
        (np.zeros((4, 6), np.uint8), DEPTH, "bgr must be"),
        (np.zeros((4, 6, 3), np.uint16), DEPTH, "bgr must be"),
        (np.zeros((0, 6, 3), np.uint8), DEPTH, "bgr must be"),
        (BGR, DEPTH.astype(np.float64), "depth_m must be"),
        (BGR, np.ones((4, 6), np.uint16), "depth_m must be"),
        (BGR, np.ones((4, 6, 1), np.float32), "depth_m must be"),
        (BGR, np.ones((0, 6), np.float32), "depth_m must be"),
    ],
)
def test_colour_and_depth_are_checked(bgr: npt.NDArray[Any], depth: npt.NDArray[Any], message: str) -> None:
    with pytest.raises(ShapeError, match=message):
        RGBD(bgr, depth)


def test_depth_may_be_smaller_than_colour() -> None:
    assert RGBD(BGR, np.ones((2, 3), np.float32)).depth_m.shape == (2, 3)


def test_no_payload_can_be_written() -> None:
    arrays = [
        Image(BGR.copy()).pixels,
        RGBD(BGR, DEPTH).depth_m,
        RGBD(BGR, DEPTH).bgr,
        Scan(np.ones(3), 0.0, 0.1).ranges_m,
        Imu(np.zeros(3)).angular_velocity_radps,
        Record({"ids": np.arange(3)}).arrays["ids"],
    ]

    assert not any(array.flags.writeable for array in arrays)


class TestScan:
    def test_points_leave_out_what_did_not_come_back(self) -> None:
        scan = Scan(np.array([1.0, math.nan, 2.0]), -math.pi / 2, math.pi / 2)

        np.testing.assert_allclose(scan.angles(), [-math.pi / 2, 0.0, math.pi / 2])
        np.testing.assert_allclose(scan.points(), [[0.0, -1.0], [0.0, 2.0]], atol=1e-12)

    @given(st.lists(st.floats(0.0, 80.0, width=32), max_size=20))
    def test_points_lie_as_far_as_their_ranges(self, ranges: list[float]) -> None:
        scan = Scan(np.array(ranges, np.float32), 0.3, 0.01)

        np.testing.assert_allclose(np.hypot(*scan.points().T), ranges, rtol=1e-6, atol=1e-9)

    def test_a_scan_without_returns_has_no_points(self) -> None:
        assert Scan(np.full(4, math.nan), 0.0, 0.1).points().shape == (0, 2)

    def test_returns_too_near_or_too_far_are_left_out(self) -> None:
        scan = Scan(np.array([0.1, 1.0, 4.0, 9.0]), 0.0, math.pi / 2, range_min_m=0.2, range_max_m=8.0)

        np.testing.assert_allclose(scan.points_within(5.0), [[0.0, 1.0], [-4.0, 0.0]], atol=1e-12)
        np.testing.assert_allclose(scan.points_within(100.0), [[0.0, 1.0], [-4.0, 0.0]], atol=1e-12)
        np.testing.assert_allclose(scan.points_within(2.0), [[0.0, 1.0]], atol=1e-12)

    @pytest.mark.parametrize("ranges", [np.zeros((2, 2)), np.zeros(3, np.int64)])
    def test_ranges_are_a_row_of_floats(self, ranges: npt.NDArray[Any]) -> None:
        with pytest.raises(ShapeError, match="ranges_m must be"):
            Scan(ranges, 0.0, 0.1)


def test_odometry_needs_a_pose_or_a_distance() -> None:
    assert Odometry(Pose2()).distance_m is None
    assert Odometry(distance_m=0.0).pose_start_base is None
    with pytest.raises(ShapeError, match="a pose or a distance"):
        Odometry()


def test_inertial_readings_have_their_lengths() -> None:
    imu = Imu(np.zeros(3, np.float32), quat_xyzw=np.array([0.0, 0.0, 0.0, 1.0]))

    assert imu.angular_velocity_radps.dtype == np.float64
    assert imu.linear_acceleration_mps2 is None
    with pytest.raises(ShapeError, match=r"quat_xyzw must have shape \(4,\), not \(3,\)"):
        Imu(np.zeros(3), quat_xyzw=np.zeros(3))
    with pytest.raises(ShapeError, match="angular_velocity_radps"):
        Imu(np.zeros(2))


@pytest.mark.parametrize("stamp_s", [math.nan, math.inf])
def test_a_frame_has_a_time(stamp_s: float) -> None:
    with pytest.raises(ShapeError, match="the stamp of a frame of 'floor' is not finite"):
        Frame("floor", stamp_s, Scalar(1.0))


@pytest.mark.parametrize(
    ("payload", "kind"),
    [
        (Image(BGR), "image"),
        (RGBD(BGR, DEPTH), "rgbd"),
        (Scan(np.ones(3), 0.0, 0.1), "scan"),
        (Odometry(Pose2()), "odometry"),
        (Imu(np.zeros(3)), "imu"),
        (Scalar(0.5), "scalar"),
        (Record({}), "record"),
    ],
)
def test_every_payload_has_its_kind(payload: Any, kind: str) -> None:
    assert payload_kind(payload) == kind


@pytest.mark.parametrize("name", ["floor", "camera_2", "a"])
def test_sensor_names_are_plain_words(name: str) -> None:
    assert SensorInfo(name, "image").name == name


@pytest.mark.parametrize("name", ["", "Floor", "2nd", "_a", "a-b", "a b", "a/b", "ä", "floor\n"])
def test_other_sensor_names_are_refused(name: str) -> None:
    with pytest.raises(ShapeError, match="use lower-case letters, digits and underscores"):
        SensorInfo(name, "image")


@dataclass(frozen=True, slots=True, eq=False)
class Foreign(Payload):
    """A payload of somebody else, who did not think of how it prints."""

    kind: ClassVar[str] = "record"
    spectrum: npt.NDArray[Any]
    gain: float = 2.0


@pytest.mark.parametrize(
    ("payload", "shown"),
    [
        (Image(np.zeros((480, 640), np.uint8)), "Image(pixels=<480 x 640 uint8>)"),
        (Foreign(np.zeros(5000)), "Foreign(spectrum=<5000 float64>, gain=2.0)"),
        (Record({"ids": np.arange(2), "ranges": np.zeros(90)}), "Record(arrays={ids: [0, 1], ranges: <90 float64>})"),
        (Scalar(3.0), "Scalar(value=3.0)"),
        (Odometry(distance_m=1.0), "Odometry(pose_start_base=None, distance_m=1.0, twist=None)"),
    ],
)
def test_a_frame_is_shown_in_one_line_whatever_it_carries(payload: Payload, shown: str) -> None:
    assert repr(payload) == shown
    assert repr(Frame("eye", 1.5, payload)) == f"Frame(sensor='eye', stamp_s=1.5, payload={shown})"
