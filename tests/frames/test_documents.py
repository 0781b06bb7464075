"""Sensors and calibrations as documents."""

from __future__ import annotations

import dataclasses
import io
import json
import math
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ruamel.yaml import YAML

from trailmark.errors import ConfigError
from trailmark.frames import Arrays, Calibration, DepthCamera, GroundPlane, Omni, Pinhole, SensorInfo
from trailmark.frames.documents import (
    calibration_from_document,
    calibration_to_document,
    sensor_from_document,
    sensor_to_document,
)
from trailmark.geometry import Pose3

finite = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(min_value=1e-9, max_value=1e9)
poses = st.builds(Pose3, finite, finite, finite, finite, finite, finite)
pinholes = st.builds(
    Pinhole, positive, positive, finite, finite, st.sampled_from([0, 4, 5, 8]).map(lambda n: tuple(range(n)))
)
calibrations = st.one_of(
    pinholes,
    st.builds(Omni, st.none() | finite, st.none() | finite, turns=st.sampled_from(["clockwise", "counterclockwise"])),
    st.builds(GroundPlane, st.tuples(positive, positive), st.none() | pinholes),
    st.builds(DepthCamera, pinholes, st.none() | pinholes, poses, st.sampled_from(["z", "range"])),
)
sensors = st.builds(
    SensorInfo,
    st.from_regex(r"[a-z][a-z0-9_]{0,9}", fullmatch=True),
    st.sampled_from(["image", "rgbd", "scan", "beacons"]),
    st.none() | st.tuples(st.integers(1, 9999), st.integers(1, 9999)),
    st.none() | positive,
    poses,
    st.none() | calibrations,
)

PINHOLE = {"fx": 800.0, "fy": 790.0, "cx": 319.5, "cy": 239.5}


def same(left: object, right: object) -> bool:
    """Compare values that may hold arrays, exactly."""
    if isinstance(left, np.ndarray) and isinstance(right, np.ndarray):
        return left.dtype == right.dtype and left.shape == right.shape and left.tobytes() == right.tobytes()
    if dataclasses.is_dataclass(left) and type(left) is type(right):
        return all(same(getattr(left, f.name), getattr(right, f.name)) for f in dataclasses.fields(left))
    if hasattr(left, "items") and hasattr(right, "items"):
        return list(left) == list(right) and all(same(left[key], right[key]) for key in left)
    return left == right


@given(sensors)
def test_a_sensor_comes_back_from_json_as_it_was(sensor: SensorInfo) -> None:
    text = json.dumps(sensor_to_document(sensor), allow_nan=False)

    assert same(sensor_from_document(json.loads(text)), sensor)


@given(calibrations)
def test_a_calibration_comes_back_from_yaml_as_it_was(calibration: Calibration) -> None:
    yaml, stream = YAML(typ="safe"), io.StringIO()

    yaml.dump(calibration_to_document(calibration), stream)

    assert same(calibration_from_document(yaml.load(stream.getvalue())), calibration)


def test_arrays_keep_shape_dtype_and_every_bit() -> None:
    arrays = {
        "lut": np.arange(12, dtype=">u2").reshape(3, 4).astype("uint16"),
        "nan": np.array([math.nan, -0.0, math.inf]),
        "flag": np.array([[True], [False]]),
        "scalar": np.array(3, dtype=np.int8),
        "nothing": np.empty((0, 7), dtype=np.float32),
    }

    back = calibration_from_document(json.loads(json.dumps(calibration_to_document(Arrays(arrays)))))

    assert same(back, Arrays(arrays))


def test_the_flat_field_travels_inside_the_document() -> None:
    ground = GroundPlane((4e-4, 5e-4), flat_field=np.linspace(0.5, 1.5, 12, dtype=np.float32).reshape(3, 4))

    assert same(calibration_from_document(calibration_to_document(ground)), ground)


@pytest.mark.parametrize(
    ("document", "expected"),
    [
        ({"metres_per_pixel": 3.9e-4}, GroundPlane((3.9e-4, 3.9e-4))),
        ({"metres_per_pixel": [3.9e-4, 4e-4], "lens": PINHOLE}, GroundPlane((3.9e-4, 4e-4), Pinhole(**PINHOLE))),
        (PINHOLE, Pinhole(**PINHOLE)),
        (PINHOLE | {"distortion": [1, 2, 3, 4]}, Pinhole(**PINHOLE, distortion=(1.0, 2.0, 3.0, 4.0))),
        ({"turns": "clockwise", "centre_u": 320, "centre_v": None}, Omni(320.0, turns="clockwise")),
        ({"colour": PINHOLE, "depth_kind": "range"}, DepthCamera(Pinhole(**PINHOLE), depth_kind="range")),
        ({"arrays": {"beacons": [[1, 2], [3.5, 4]]}}, Arrays({"beacons": np.array([[1.0, 2.0], [3.5, 4.0]])})),
    ],
)
def test_the_model_follows_from_the_keys(document: dict[str, Any], expected: Calibration) -> None:
    assert same(calibration_from_document(document), expected)


def test_people_may_write_angles_in_degrees() -> None:
    document = {"colour": PINHOLE, "pose_colour_depth": {"x": 0.025, "yaw_deg": 90}}

    camera = calibration_from_document(document)

    assert same(camera, DepthCamera(Pinhole(**PINHOLE), pose_colour_depth=Pose3(x=0.025, yaw=math.pi / 2)))


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ({}, "calibration is empty"),
        (3, "calibration must be a mapping"),
        ({"metre_per_pixel": 1}, "unknown key 'metre_per_pixel'; did you mean 'metres_per_pixel'"),
        ({"metres_per_pixel": 1, "fx": 800}, "mixes 'fx' of Pinhole with 'metres_per_pixel' of GroundPlane"),
        ({"fx": 800, "fy": 800}, "calibration lacks cx, cy, which Pinhole needs"),
        ({"metres_per_pixel": 1, "lens": {"fx": 1, "gy": 1}}, "calibration.lens has an unknown key 'gy'"),
        ({"metres_per_pixel": "a"}, "calibration.metres_per_pixel must be a list of numbers, not 'a'"),
        ({"metres_per_pixel": [1, 2, 3]}, "metres_per_pixel must be two positive numbers"),
        ({"metres_per_pixel": True}, "metres_per_pixel must be a finite number, not True"),
        ({"metres_per_pixel": 1e300}, "calibration.metres_per_pixel must be from 1e-09 to"),
        ({"metres_per_pixel": [4e-4, 1e-300]}, "calibration.metres_per_pixel must be from 1e-09 to"),
        (PINHOLE | {"fx": math.nan}, "calibration.fx must be a finite number, not nan"),
        (PINHOLE | {"fx": 10**400}, "calibration.fx must be a finite number"),
        (PINHOLE | {"fx": -1}, "focal lengths must be positive"),
        (PINHOLE | {"distortion": [1]}, "distortion has 4, 5 or 8 numbers"),
        ({"turns": "left"}, "calibration.turns must be clockwise or counterclockwise, not 'left'"),
        ({"colour": PINHOLE, "pose_colour_depth": {"yaw": 1}}, "unknown key 'yaw'; did you mean 'yaw_"),
        ({"colour": PINHOLE, "pose_colour_depth": {"yaw_deg": 1, "yaw_rad": 1}}, "gives yaw twice"),
        ({"metres_per_pixel": 1, "flat_field": "flat.npy"}, "this document may not read files"),
        ({"arrays": {"a": [[1], [1, 2]]}}, "arrays.a"),
        ({"arrays": {"a": ["x"]}}, "calibration.arrays.a must be numbers"),
        ({"arrays": {"a": {"shape": [1], "dtype": "int8"}}}, "has the keys shape, dtype and base64"),
    ],
)
def test_a_wrong_document_is_refused_by_its_key(document: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        calibration_from_document(document)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dtype": "object"}, "unknown dtype 'object'"),
        ({"dtype": 3}, "must be text"),
        ({"shape": [2]}, "does not fit 1 bytes"),
        ({"shape": [-1]}, "is not that of an array"),
        ({"shape": [1.0]}, "whole numbers"),
        ({"shape": 1}, "whole numbers"),
        ({"shape": [1] * 40}, "is not that of an array"),
        ({"shape": [2**62, 0], "base64": ""}, None),
        ({"shape": [2**62, 2**62, 0], "base64": ""}, "is not that of an array"),
        ({"shape": [2**62]}, "does not fit"),
        ({"base64": "AA"}, "adding"),
        ({"base64": "é"}, "ASCII"),
        ({"dtype": "bool", "base64": "Ag=="}, "neither 0 nor 1"),
    ],
)
def test_a_hostile_array_is_refused_before_it_costs_anything(change: dict[str, Any], message: str | None) -> None:
    array = {"shape": [1], "dtype": "uint8", "base64": "Bw=="} | change

    if message is None:
        assert calibration_from_document({"arrays": {"a": array}}).arrays["a"].size == 0
        return
    with pytest.raises(ConfigError, match=message):
        calibration_from_document({"arrays": {"a": array}})


def test_an_array_may_stand_in_a_file_beside_the_document(tmp_path: Path) -> None:
    flat = np.linspace(0.5, 1.5, 6, dtype=np.float32).reshape(2, 3)
    np.save(tmp_path / "flat.npy", flat)

    ground = calibration_from_document({"metres_per_pixel": 1e-3, "flat_field": "flat.npy"}, tmp_path)

    assert same(ground, GroundPlane((1e-3, 1e-3), flat_field=flat))


def test_a_picture_of_a_uniform_surface_is_divided_by_its_mean(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "flat.png"), np.array([[50, 150], [100, 100]], np.uint8))

    ground = calibration_from_document({"metres_per_pixel": 1e-3, "flat_field": "flat.png"}, tmp_path)

    np.testing.assert_array_equal(ground.flat_field, np.array([[0.5, 1.5], [1.0, 1.0]], np.float32))


def test_files_that_are_no_arrays_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "objects.npy", np.array([{}]), allow_pickle=True)
    np.save(tmp_path / "short.npy", np.zeros(10_000))
    raw = (tmp_path / "short.npy").read_bytes()
    (tmp_path / "short.npy").write_bytes(raw[:500])
    (tmp_path / "junk.npy").write_bytes(b"junk")
    (tmp_path / "junk.png").write_bytes(b"junk")
    header = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 30_000, 30_000)
    (tmp_path / "bomb.png").write_bytes(header + bytes(100))
    (tmp_path / "cut.png").write_bytes(header[:16] + struct.pack(">II", 8, 8) + bytes(100))

    for name, message in {
        "objects.npy": "cannot read",
        "short.npy": "cannot read",
        "junk.npy": "cannot read",
        "junk.png": "not a PNG picture",
        "bomb.png": "more than a calibration needs",
        "cut.png": "damaged",
        "missing.png": "no file",
        "flat.pickle": "neither .npy nor .png",
    }.items():
        with pytest.raises(ConfigError, match=message):
            calibration_from_document({"metres_per_pixel": 1, "flat_field": name}, tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "Floor"}, "sensor name 'Floor'"),
        ({"name": None}, "sensor lacks name"),
        ({"kind": 3}, "sensor.kind must be a word"),
        ({"size": [640]}, "sensor.size must be"),
        ({"size": [0, 1]}, "sensor.size must be"),
        ({"rate": 3}, "unknown key 'rate'; did you mean 'rate_hz'"),
        ({"pose_base_sensor": [1]}, "sensor.pose_base_sensor must be a mapping"),
        ({"calibration": {"fx": 1}}, "sensor.calibration lacks fy"),
        ({"calibration": {"metres_per_pixel": 1, "flat_field": "/etc/passwd.npy"}}, "may not read files"),
    ],
)
def test_a_wrong_sensor_is_refused_by_its_key(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        sensor_from_document({"name": "floor", "kind": "image"} | change)
