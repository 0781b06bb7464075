"""From frames to grey pictures of even brightness."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from trailmark.errors import ConfigError, ShapeError
from trailmark.frames import Frame, GroundPlane, Image, Pinhole, Scalar, SensorInfo
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Session
from trailmark.testing.ground import GroundCamera, MirroredFloor
from trailmark_ground_vo.picture import PictureReader, camera_of, ground_plane

SENSOR = SensorInfo("floor", "image", (64, 48), 70.0, calibration=GroundPlane((4e-4, 4e-4)))


def frame_of(pixels, stamp_s=1.5):
    return Frame("floor", stamp_s, Image(pixels))


def test_a_grey_picture_comes_through_unchanged_and_writable():
    pixels = np.random.default_rng(0).integers(0, 256, (48, 64), np.uint8)

    picture = PictureReader(SENSOR).read(frame_of(pixels))

    np.testing.assert_array_equal(picture, pixels)
    assert picture.flags.writeable
    assert picture.flags.c_contiguous


def test_colour_becomes_grey():
    pixels = np.zeros((48, 64, 3), np.uint8)
    pixels[..., 1] = 100

    np.testing.assert_array_equal(PictureReader(SENSOR).read(frame_of(pixels)), 59)


def test_twelve_bits_are_brought_to_eight():
    pixels = np.full((48, 64), 1600, np.uint16)
    pixels[0, 0] = 4095

    picture = PictureReader(SENSOR).read(frame_of(pixels))

    assert picture[5, 5] == 100
    assert picture[0, 0] == 255


def test_the_flat_field_evens_out_a_vignette():
    camera = GroundCamera((128, 96), vignette=0.3)
    ground = MirroredFloor.procedural(seed=1, size_px=256)
    reader = PictureReader(camera.sensor_info("floor"))

    picture = reader.read(frame_of(camera.image(ground, Pose2())))

    even = replace(camera, vignette=0.0).view(ground, Pose2()) * camera.flat_field.mean()
    assert np.abs(picture - even).max() < 1.5


def test_the_lens_is_undone():
    lens = Pinhole(300.0, 300.0, 63.5, 47.5, (-0.3, 0.05, 0.0, 0.0))
    camera = GroundCamera((128, 96), lens=lens)
    ground = MirroredFloor.procedural(seed=1, size_px=256, grain_px=3.0)
    reader = PictureReader(camera.sensor_info("floor"))

    picture = reader.read(frame_of(camera.image(ground, Pose2())))

    ideal = replace(camera, lens=None).view(ground, Pose2())
    assert np.sqrt(np.mean((picture - ideal)[10:-10, 10:-10] ** 2)) < 0.8
    assert cv2.norm(picture, camera.image(ground, Pose2())) > 100


def test_a_change_of_size_or_kind_names_both_and_the_stamp():
    reader = PictureReader(SENSOR)
    reader.read(frame_of(np.zeros((48, 64), np.uint8)))

    with pytest.raises(ShapeError, match=r"'floor' changed from 64 x 48 uint8 to 32 x 48 uint8 at 1\.500000 s"):
        reader.read(frame_of(np.zeros((48, 32), np.uint8)))
    with pytest.raises(ShapeError, match="to 64 x 48 uint16"):
        reader.read(frame_of(np.zeros((48, 64), np.uint16)))


def test_a_frame_that_is_no_picture_is_refused():
    with pytest.raises(ShapeError, match="gave Scalar"):
        PictureReader(SENSOR).read(Frame("floor", 0.0, Scalar(1.0)))


def test_a_camera_without_a_scale_is_told_how_to_get_one():
    with pytest.raises(ConfigError, match=r"no calibration.*metres_per_pixel"):
        ground_plane(replace(SENSOR, calibration=None))
    with pytest.raises(ConfigError, match="calibration of a Pinhole"):
        ground_plane(replace(SENSOR, calibration=Pinhole(1.0, 1.0, 0.0, 0.0)))


def test_a_mounting_that_is_not_level_is_refused():
    with pytest.raises(ConfigError, match=r"pitch 1\.57 rad, but a ground camera is level"):
        ground_plane(replace(SENSOR, pose_base_sensor=Pose3(pitch=1.57)))


def test_a_flat_field_of_another_size_is_refused_before_the_first_frame():
    flat = np.ones((40, 60), np.float32)

    with pytest.raises(ConfigError, match="flat field of sensor 'floor' is 60 x 40, but its pictures are 64 x 48"):
        PictureReader(replace(SENSOR, calibration=GroundPlane((4e-4, 4e-4), flat_field=flat)))


def test_a_flat_field_of_another_size_is_refused_at_the_first_frame_of_a_source_that_did_not_tell():
    flat = np.ones((40, 60), np.float32)
    reader = PictureReader(replace(SENSOR, size=None, calibration=GroundPlane((4e-4, 4e-4), flat_field=flat)))

    with pytest.raises(ConfigError, match="its pictures are 64 x 48"):
        reader.read(frame_of(np.zeros((48, 64), np.uint8)))


def test_the_only_camera_needs_no_name():
    session = Session(name="vo", sensors={"floor": SENSOR, "light": SensorInfo("light", "scalar")})

    assert camera_of(session, "") is SENSOR
    assert camera_of(session, "floor") is SENSOR
    with pytest.raises(ConfigError, match="no camera 'front' of kind image; there are: floor"):
        camera_of(session, "front")
