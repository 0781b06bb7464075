"""Faults of depth, of lasers and of time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from trailmark.frames import RGBD, Frame, Scalar, Scan, SensorInfo
from trailmark_faults.depth import shift_depth
from trailmark_faults.timing import FrozenConfig

DEPTH = np.arange(48, dtype=np.float32).reshape(6, 8) + 1.0


def rgbd(n: int = 1, shape: tuple[int, int] = (120, 160)) -> list[Frame]:
    payload = RGBD(np.full((*shape, 3), 100, np.uint8), np.full(shape, 2.0, np.float32))
    return [Frame("kinect", 0.1 * i, payload) for i in range(n)]


def readings(n: int, rate_hz: float = 10.0) -> list[Frame]:
    return [Frame("light", i / rate_hz, Scalar(float(i))) for i in range(n)]


def values(frames) -> list[float]:
    return [frame.payload.value for frame in frames]


def test_depth_has_holes_of_its_share_and_colour_stays(faulty) -> None:
    first, second = faulty.worsened(rgbd(2), {"depth_holes": {"share": 0.1, "size_px": 12.0}})

    holes = np.isnan(first.payload.depth_m)
    assert holes.mean() == pytest.approx(0.1, abs=0.04)
    assert (holes != np.isnan(second.payload.depth_m)).any()
    assert (first.payload.depth_m[~holes] == 2.0).all()
    assert (first.payload.bgr == 100).all()


@pytest.mark.parametrize(("u", "v"), [(2, 0), (-3, 1), (0, -2), (0, 0)])
def test_depth_moves_to_the_right_and_down(u, v) -> None:
    moved = shift_depth(DEPTH, u, v)

    for row in range(6):
        for column in range(8):
            from_row, from_column = row - v, column - u
            if 0 <= from_row < 6 and 0 <= from_column < 8:
                assert moved[row, column] == DEPTH[from_row, from_column]
            else:
                assert math.isnan(moved[row, column])


def test_depth_that_moves_out_of_the_picture_is_gone() -> None:
    assert np.isnan(shift_depth(DEPTH, 8, 0)).all()
    assert np.isnan(shift_depth(DEPTH, 0, -6)).all()


@pytest.mark.parametrize("centre_deg", [0.0, 175.0, -90.0])
def test_a_sector_of_a_scan_is_blind_round_its_centre(faulty, centre_deg) -> None:
    scan = Scan(np.full(360, 5.0), -math.pi, math.radians(1.0))

    keys = {"width_deg": 61, "centre_deg": centre_deg}  # its edges fall between beams

    (seen,) = faulty.worsened([Frame("laser", 0.0, scan)], {"blind_sector": keys})

    blind = np.isnan(seen.payload.ranges_m)
    away_deg = np.abs((np.degrees(scan.angles()) - centre_deg + 180.0) % 360.0 - 180.0)
    assert (blind == (away_deg <= 30.5)).all()
    assert blind.sum() == 61


def test_a_frozen_sensor_says_the_last_thing_again_with_new_stamps(faulty) -> None:
    perturber = faulty.chain({"frozen": {"from_s": 0.25, "to_s": 0.55}})
    faulty.start(perturber, {"light": SensorInfo("light", "scalar")})

    seen = list(perturber.frames(iter(readings(8))))

    assert values(seen) == [0, 1, 2, 2, 2, 2, 6, 7]
    assert [frame.stamp_s for frame in seen] == [frame.stamp_s for frame in readings(8)]
    assert perturber.counters() == {"perturb.frozen.frozen": 3}


def test_a_sensor_that_is_frozen_from_the_start_says_its_first_reading(faulty) -> None:
    assert values(faulty.worsened(readings(3), {"frozen": {}})) == [0, 0, 0]


def test_a_freeze_ends_after_it_begins() -> None:
    with pytest.raises(ValidationError, match="to_s must be after from_s: 1 is not after 1"):
        FrozenConfig(from_s=1.0, to_s=1.0)


def test_a_share_of_the_readings_is_the_one_before_again(faulty) -> None:
    seen = values(faulty.worsened(readings(4000), {"repeated": {"share": 0.2}}))

    late = np.arange(4000) - np.array(seen)
    assert set(late.tolist()) == {0.0, 1.0}
    assert late.mean() == pytest.approx(0.2, abs=0.02)


def test_jitter_delays_by_its_mean_and_keeps_the_order_of_stamps(faulty) -> None:
    frames = readings(5000)

    seen = faulty.worsened(frames, {"jitter": {"mean_ms": 50.0}})

    stamps = np.array([frame.stamp_s for frame in seen])
    delays = stamps - np.array(values(seen)) / 10
    assert (np.diff(stamps) > 0).all()
    assert delays.min() >= 0.0
    assert delays.mean() == pytest.approx(0.05, rel=0.05)
    assert delays.std() == pytest.approx(0.05, rel=0.1)
