"""The quick median that the alignment of a patch takes is numpy's."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark_ground_vo.alignment import _median


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("n", [1, 2, 3, 361, 1444])
def test_the_quick_median_is_the_median(n: int, dtype: type) -> None:
    values = np.random.default_rng(n).normal(0.0, 900.0, n).astype(dtype)

    found = _median(values)

    assert found == np.median(values)
    assert found.dtype == np.median(values).dtype
