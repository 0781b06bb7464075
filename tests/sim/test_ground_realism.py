"""Built-in floors against photographs of real ones. Their parameters are fixed by this, not by what tracks well."""

from __future__ import annotations

import math
from dataclasses import asdict
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from trailmark.errors import ShapeError
from trailmark_sim.ground.ground import Floor
from trailmark_sim.ground.statistics import PHOTOGRAPHS, floor_statistics, photographed_statistics
from trailmark_sim.realism import PictureStatistics, picture_statistics, spectral_slope


@pytest.mark.data
@pytest.mark.parametrize("floor", sorted(PHOTOGRAPHS))
def test_a_floor_lies_within_the_span_of_real_ones(floor: str, data_folder: Path) -> None:
    real = photographed_statistics(floor, data_folder / "ground")

    ours = asdict(floor_statistics(Floor(floor)))

    for key, value in ours.items():
        seen = [asdict(statistics)[key] for statistics in real]
        assert 0.8 * min(seen) <= value <= 1.25 * max(seen), (
            f"{key}: {value:.3g}, real {min(seen):.3g} to {max(seen):.3g}"
        )


def test_wood_has_little_contrast_as_real_wood() -> None:
    ours = floor_statistics(Floor("wood"))

    assert 5.0 <= ours.std <= 14.0
    assert ours.distinct < 4.0


@cache
def noise(exponent: float) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    rng = np.random.default_rng(7)
    frequency = np.hypot(np.fft.fftfreq(512)[:, None], np.fft.fftfreq(512)[None, :])
    frequency[0, 0] = 1.0
    shaped = np.fft.ifft2(np.fft.fft2(rng.standard_normal((512, 512))) * frequency ** (-exponent / 2.0)).real
    return np.clip(128 + 12 * shaped / shaped.std(), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("exponent", [0.0, 1.0, 2.0])
def test_the_slope_of_a_spectrum_is_found(exponent: float) -> None:
    assert spectral_slope(noise(exponent)) == pytest.approx(exponent, abs=0.12)


def test_a_flat_picture_has_nothing() -> None:
    flat = picture_statistics(np.full((300, 300), 90, np.uint8))

    assert (flat.std, flat.sift, flat.corners, flat.edges) == (0.0, 0.0, 0.0, 0.0)
    assert flat.distinct == pytest.approx(1.0, abs=0.05)


def test_noise_is_distinct_and_a_period_is_not() -> None:
    u, v = np.meshgrid(np.arange(320), np.arange(320))
    periodic = (128 + 50 * np.sin(u * math.pi / 8) * np.sin(v * math.pi / 8)).astype(np.uint8)

    assert picture_statistics(noise(0.0)).distinct > 5.0
    assert picture_statistics(periodic).distinct < 1.5


def test_the_mean_of_statistics_is_taken_number_by_number() -> None:
    mean = PictureStatistics.mean([PictureStatistics(1, 2, 3, 4, 5, 6), PictureStatistics(3, 4, 5, 6, 7, 8)])

    assert mean == PictureStatistics(2, 3, 4, 5, 6, 7)


def test_a_picture_too_small_or_in_colour_is_refused() -> None:
    with pytest.raises(ShapeError, match="96 x 96 at least"):
        picture_statistics(np.zeros((300, 80), np.uint8))
    with pytest.raises(ShapeError, match="grey picture"):
        picture_statistics(np.zeros((300, 300, 3), np.uint8))
