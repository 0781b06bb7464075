"""Messages of ROS 1 that are decoded here are what rosbags makes of them."""

from __future__ import annotations

import contextlib
import struct
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import ReaderError
from rosbags.typesys import Stores, get_typestore

from trailmark_datasets.bagfile import _KnownHeads
from trailmark_datasets.ros1_decoding import DECODERS

STORE = get_typestore(Stores.ROS1_NOETIC)


def _message(name: str, rng: np.random.Generator) -> Any:
    types = STORE.types
    header = types["std_msgs/msg/Header"](
        seq=7, stamp=types["builtin_interfaces/msg/Time"](sec=1_400_000_000, nanosec=999_999_999), frame_id="bäse"
    )
    vectors = [types["geometry_msgs/msg/Vector3"](*rng.normal(size=3).tolist()) for _ in range(2)]
    quaternion = types["geometry_msgs/msg/Quaternion"](*rng.normal(size=4).tolist())
    if name == "sensor_msgs/msg/Imu":
        covariances = rng.normal(size=(3, 9))
        return types[name](header, quaternion, covariances[0], vectors[0], covariances[1], vectors[1], covariances[2])
    point = types["geometry_msgs/msg/Point"](*rng.normal(size=3).tolist())
    pose, twist = types["geometry_msgs/msg/Pose"](point, quaternion), types["geometry_msgs/msg/Twist"](*vectors)
    return types[name](
        header,
        "wheels",
        types["geometry_msgs/msg/PoseWithCovariance"](pose, rng.normal(size=36)),
        types["geometry_msgs/msg/TwistWithCovariance"](twist, rng.normal(size=36)),
    )


def _leaves(value: Any, names: Any = None) -> Any:
    """Return a message as nested dictionaries, of the attributes that rosbags gives it."""
    if isinstance(value, (str, float, int)):
        return value
    if isinstance(value, np.ndarray) or (isinstance(value, tuple) and not hasattr(value, "_fields")):
        return [float(number) for number in value]
    fields = getattr(value, "_fields", None) or value.__dataclass_fields__
    return {name: _leaves(getattr(value, name)) for name in fields if not name.startswith("__")}


@pytest.mark.parametrize("name", ["sensor_msgs/msg/Imu", "nav_msgs/msg/Odometry"])
def test_a_message_is_decoded_as_rosbags_does(name: str) -> None:
    decode = DECODERS[STORE.generate_msgdef(name, ros_version=1)[1]]
    for seed in range(3):
        raw = bytes(STORE.serialize_ros1(_message(name, np.random.default_rng(seed)), name))

        for message in (raw, raw[:4] + b"\xff" * 4 + raw[8:]):  # and one second before the epoch
            assert _leaves(decode(message)) == _leaves(STORE.deserialize_ros1(message, name))


@pytest.mark.parametrize("name", ["sensor_msgs/msg/Imu", "nav_msgs/msg/Odometry"])
@pytest.mark.parametrize("cut", [-1, 3, 18])
def test_a_message_that_does_not_fit_is_left_to_rosbags(name: str, cut: int) -> None:
    decode = DECODERS[STORE.generate_msgdef(name, ros_version=1)[1]]
    raw = bytes(STORE.serialize_ros1(_message(name, np.random.default_rng(0)), name))

    for damaged in (raw[:cut], raw + b"\0"):
        with contextlib.suppress(struct.error, UnicodeDecodeError):
            assert decode(damaged) is None


def _record(time: bytes, number: int, data: bytes) -> bytes:
    fields = (b"op=\x02", b"conn=" + struct.pack("<I", number), b"time=" + time)
    head = b"".join(struct.pack("<I", len(field)) + field for field in fields)
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


def test_known_heads_are_read_as_unknown_ones_are() -> None:
    times = [struct.pack("<II", 5, 10), struct.pack("<II", 6, 999_999_999)] * 2
    records = [_record(time, i % 2 + 3, bytes([i]) * i) for i, time in enumerate(times)]
    chunk, heads = b"".join(records), _KnownHeads({3: "three", 4: "four"})
    offsets = [sum(map(len, records[:i])) for i in range(4)]
    ns = [5_000_000_010, 6_999_999_999] * 2

    read = [heads.read(chunk, offset, time_ns) for offset, time_ns in zip(offsets, ns, strict=True)]

    assert read == [(("three", "four")[i % 2], ns[i], bytes([i]) * i) for i in range(4)]
    assert len(heads._known) == 2
    with pytest.raises(AssertionError):
        heads.read(chunk, offsets[2], 5_000_000_011)  # the index says another time than the record
    with pytest.raises(Exception, match="Got only"):
        heads.read(chunk[:-1], offsets[3], ns[3])
    with pytest.raises(ReaderError):
        heads.read(chunk[: offsets[3] - 6], offsets[2], ns[2])  # it ends before the length of two bytes
