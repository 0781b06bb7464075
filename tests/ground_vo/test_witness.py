"""The second opinion on the shift between two pictures."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark_ground_vo.brightness import EVEN_LEVEL
from trailmark_ground_vo.witness import ShiftWitness

SIZE = (256, 240)


def window(picture, u, v):
    """The part of a picture whose content has moved by (u, v)."""
    return np.ascontiguousarray(picture[120 - v : 120 - v + SIZE[1], 120 - u : 120 - u + SIZE[0]])


@pytest.fixture
def picture(ground):
    return np.tile(ground.texture, (1, 1)).astype(np.uint8)


@pytest.mark.parametrize("shift", [(0, 0), (12, -8), (-60, 33), (3, 70)])
def test_the_shift_is_found_wherever_it_is(shift, picture):
    witness = ShiftWitness(SIZE)

    vote = witness.compare(witness.spectrum(window(picture, 0, 0)), witness.spectrum(window(picture, *shift)))

    assert (vote.u, vote.v) == pytest.approx(shift, abs=2.0)
    assert vote.is_clear
    assert vote.support(*shift) == pytest.approx(1.0, abs=0.3)
    assert vote.support(shift[0] + 30, shift[1] + 30) < 0.5


def test_the_second_peak_is_the_ground_behind_marks(picture):
    witness, marks = ShiftWitness(SIZE), np.zeros((SIZE[1], SIZE[0]), np.bool_)
    for v, u in np.random.default_rng(3).integers(8, 230, (60, 2)):
        marks[v : v + 8, u : u + 8] = True

    before, now = (np.where(marks, 250, window(picture, u, 0)).astype(np.uint8) for u in (0, 40))
    peaks = witness.compare(witness.spectrum(before), witness.spectrum(now)).peaks(3)

    assert any(peak == pytest.approx((0.0, 0.0), abs=4.0) for peak in peaks)
    assert any(peak == pytest.approx((40.0, 0.0), abs=4.0) for peak in peaks)


def test_pictures_without_anything_to_see_have_no_clear_shift(picture):
    witness, blank = ShiftWitness(SIZE), np.full((SIZE[1], SIZE[0]), EVEN_LEVEL, np.uint8)

    assert not witness.compare(witness.spectrum(window(picture, 0, 0)), witness.spectrum(blank)).is_clear
    assert not witness.compare(witness.spectrum(blank), witness.spectrum(blank)).is_clear


def test_pictures_of_different_places_have_no_clear_shift(picture):
    witness, other = ShiftWitness(SIZE), np.random.default_rng(2).integers(0, 256, SIZE[::-1], np.uint8)

    assert not witness.compare(witness.spectrum(window(picture, 0, 0)), witness.spectrum(other)).is_clear
