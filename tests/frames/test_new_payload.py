"""A kind of reading that Trailmark does not know: one class, and checks, recorder and mailbox take it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from trailmark.errors import SourceError
from trailmark.frames import (
    PAYLOAD_KINDS,
    RGBD,
    Frame,
    Image,
    Imu,
    Odometry,
    Payload,
    Record,
    Scalar,
    Scan,
    SensorInfo,
    payload_kind,
)
from trailmark.geometry import Pose2
from trailmark.pipeline.instruments import Counters
from trailmark.pipeline.sources.checks import FrameChecks
from trailmark.recording.dataset import DatasetWriter


@pytest.fixture
def beacon() -> Iterator[type[Payload]]:
    """A distance to a beacon, known for the time of a test."""

    @dataclass(frozen=True, slots=True)
    class Beacon(Payload):
        """Which beacon, and how far it is."""

        kind: ClassVar[str] = "beacon"

        number: int
        range_m: float
        label: str = "north"

    yield Beacon
    del PAYLOAD_KINDS["beacon"]


def test_the_kinds_are_those_of_the_classes() -> None:
    assert {
        "image": Image,
        "rgbd": RGBD,
        "scan": Scan,
        "odometry": Odometry,
        "imu": Imu,
        "scalar": Scalar,
    } == PAYLOAD_KINDS
    assert payload_kind(Record({})) == "record"


def test_a_new_payload_brings_its_kind(beacon) -> None:
    assert PAYLOAD_KINDS["beacon"] is beacon
    assert payload_kind(beacon(3, 1.5)) == "beacon"


def test_frames_of_it_are_checked(beacon) -> None:
    checks = FrameChecks("robot", {"tag": SensorInfo("tag", "beacon")}, skips=False, counters=Counters())

    assert checks.accept(Frame("tag", 0.0, beacon(3, 1.5)))
    with pytest.raises(SourceError, match="carries scalar, but the sensor is of kind beacon"):
        checks.accept(Frame("tag", 0.1, Scalar(1.5)))


def test_it_is_recorded_as_a_row_of_its_numbers(beacon, tmp_path: Path) -> None:
    writer = DatasetWriter(tmp_path / "out", {"tag": SensorInfo("tag", "beacon")})
    writer.write(Frame("tag", 0.5, beacon(3, 1.25)))
    writer.close(None)

    assert (tmp_path / "out" / "tag.csv").read_text() == "t,number,range_m\n0.5,3.0,1.25\n"


def test_it_is_no_picture_and_none_of_it_is_worthless(beacon) -> None:
    payload = beacon(3, 1.5)

    assert (payload.picture, payload.size, payload.layout) == (None, None, ())
    assert not payload.is_snapshot


@pytest.mark.parametrize(
    ("payload", "numbers"),
    [
        (Scalar(2.0), {"value": 2.0}),
        (Odometry(Pose2(1.0, 2.0, 0.5)), {"x": 1.0, "y": 2.0, "theta": 0.5}),
        (Odometry(distance_m=3.0), {"distance": 3.0}),
        (
            Imu(np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0])),
            {"wx": 1.0, "wy": 2.0, "wz": 3.0, "ax": 4.0, "ay": 5.0, "az": 6.0},
        ),
        (Record({"ids": np.array([1])}), {}),
        (Image(np.zeros((2, 3), np.uint8)), {}),
    ],
)
def test_a_reading_as_numbers(payload, numbers) -> None:
    assert payload.numbers() == numbers


def test_pictures_tell_what_must_not_change() -> None:
    rgbd = RGBD(np.zeros((2, 3, 3), np.uint8), np.zeros((4, 5), np.float32))

    assert rgbd.size == (3, 2)
    assert rgbd.layout == ((2, 3, 3), (4, 5))
    assert rgbd.picture is rgbd.bgr
    assert Image(np.zeros((2, 3), np.uint16)).layout == ((2, 3), np.dtype(np.uint16))
