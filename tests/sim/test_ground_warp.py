"""The noise of a picture is a hash of the place, computed in 32 bits."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark_sim.ground.warp import _normal32

_LOW32 = (1 << 32) - 1


def twin(start: int, n: int) -> float:
    """Return the number in Python's whole numbers: the counter keeps the bit with which it ran over."""
    counter = start + n
    h = ((counter & _LOW32) ^ (counter >> 16)) * 0x7FEB352D & _LOW32
    h = (h ^ (h >> 15)) * 0x846CA68B & _LOW32
    h ^= h >> 16
    total = sum(h >> shift & 0xFF for shift in (0, 8, 16, 24))
    return (total - 510) / (4.0 * 65535.0 / 12.0) ** 0.5


@pytest.mark.parametrize("start", [0, 0x12345678, 0x7FFFFFF0, _LOW32 - 5])
def test_noise_is_that_of_whole_numbers_even_where_the_counter_runs_over(start):
    found = [_normal32(np.uint32(start), np.uint32(n)) for n in range(40)]

    np.testing.assert_allclose(found, [twin(start, n) for n in range(40)], rtol=1e-6)
