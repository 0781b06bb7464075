"""Shadows, mains and sun: how bright it is, where and when."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark_faults.light import MainsConfig, mains_gain, shadow_gain

LEVEL = np.full((60, 80), 100, np.uint8)


def means(frames) -> np.ndarray:
    return np.array([frame.payload.pixels.mean() for frame in frames])


def test_the_light_beside_the_edge_of_a_shadow() -> None:
    gain = shadow_gain((4, 100), (0.0, 0.0), depth=0.5, edge=0.2)

    assert gain[0, 0] == 1.0
    assert gain[0, -1] == pytest.approx(0.5)
    assert gain[0, 50] == pytest.approx(0.75, abs=0.01)  # half of the penumbra
    assert (np.diff(gain[0]) <= 0).all()
    assert (gain == gain[0]).all()


def test_an_edge_along_the_rows_lies_across_the_columns() -> None:
    gain = shadow_gain((100, 4), (math.pi / 2, 0.0), depth=0.5, edge=0.5)

    assert gain[0, 0] == 1.0
    assert gain[-1, 0] == pytest.approx(0.5)


def test_a_shadow_swings_as_far_and_as_fast_as_it_is_told(faulty) -> None:
    keys = {"depth": 0.5, "edge": 0.02, "reach": 0.25, "speed": 0.5, "angle_deg": 0.0}
    frames = faulty.pictures(400, np.full((2, 400), 200, np.uint8), rate_hz=50.0)

    seen = faulty.worsened(frames, {"wandering_shadow": keys})

    edges = np.array([(frame.payload.pixels[0] > 150).sum() for frame in seen]) / 400 - 0.5
    assert [edges.min(), edges.max()] == pytest.approx([-0.25, 0.25], abs=0.01)
    assert np.abs(np.diff(edges)).max() * 50.0 == pytest.approx(0.5, rel=0.3)  # edges count in whole columns


def test_the_mean_light_of_an_exposure_is_the_integral() -> None:
    config = MainsConfig(hz=120, depth=0.4, exposure_ms=3.0)
    times = 0.0123 + np.linspace(0.0, 3e-3, 20001)

    integral = np.mean(1.0 + 0.4 * np.cos(2 * math.pi * 120 * times + 0.7))

    assert mains_gain(np.array([0.0123]), config, 0.7)[0] == pytest.approx(integral, abs=1e-5)


def test_an_exposure_of_a_whole_swing_sees_nothing_of_it(faulty) -> None:
    frames = faulty.pictures(20, LEVEL, rate_hz=33.0)

    assert np.ptp(means(faulty.worsened(frames, {"mains": {"hz": 100, "exposure_ms": 10.0}}))) == 0.0
    assert np.ptp(means(faulty.worsened(frames, {"mains": {"hz": 100, "exposure_ms": 1.0}}))) > 40.0


def test_a_camera_in_step_with_the_mains_sees_constant_light(faulty) -> None:
    frames = faulty.pictures(20, LEVEL, rate_hz=50.0)

    assert np.ptp(means(faulty.worsened(frames, {"mains": {"hz": 100}}))) == 0.0


def test_a_rolling_shutter_makes_bands_along_the_rows(faulty) -> None:
    (rolling,) = faulty.worsened(faulty.pictures(1, LEVEL), {"mains": {"exposure_ms": 1.0, "readout_ms": 20.0}})
    (at_once,) = faulty.worsened(faulty.pictures(1, LEVEL), {"mains": {"exposure_ms": 1.0}})

    assert (rolling.payload.pixels == rolling.payload.pixels[:, :1]).all()
    power = np.abs(np.fft.rfft(rolling.payload.pixels[:, 0] - 100.0))
    assert np.argmax(power[1:]) + 1 == 2  # 20 ms are two swings
    assert np.ptp(at_once.payload.pixels) == 0


def test_the_camera_gets_used_to_the_sun(faulty) -> None:
    frames = faulty.pictures(500, np.full((4, 4), 40, np.uint8), rate_hz=100.0)

    seen = means(faulty.worsened(frames, {"over_exposure": {"gain": 3.0, "every_s": 2.0, "settle_s": 0.3}}))

    assert 40 * 3 ** math.exp(-0.01 / 0.3) - 1 <= seen.max() <= 120  # it may begin 10 ms before a picture
    assert seen.min() == 40.0
    begins = np.nonzero(np.diff(seen) > 20)[0]
    assert np.diff(begins).tolist() == [200] * (len(begins) - 1)
    assert len(begins) >= 2
    assert seen[begins[0] + 1 + 30] == pytest.approx(40 * 3 ** math.exp(-1), abs=2.0)


def test_a_fixed_exposure_never_gets_used_to_it(faulty) -> None:
    frames = faulty.pictures(400, np.full((4, 4), 40, np.uint8), rate_hz=100.0)

    seen = means(faulty.worsened(frames, {"over_exposure": {"gain": 2.0, "every_s": 2.0, "settle_s": 0.0}}))

    assert set(seen.tolist()) == {40.0, 80.0}
    assert (seen == 80.0).mean() == pytest.approx(0.5, abs=0.01)
