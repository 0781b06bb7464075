from __future__ import annotations

import numpy as np
import pytest

from trailmark.errors import DataError
from trailmark.evaluation import percentiles


def test_percentiles_by_hand() -> None:
    found = percentiles(np.arange(101) / 1000.0)

    assert found.document() == pytest.approx(
        {"n": 101, "mean_ms": 50.0, "p50_ms": 50.0, "p95_ms": 95.0, "p99_ms": 99.0, "max_ms": 100.0}
    )


def test_no_duration_has_no_percentiles() -> None:
    with pytest.raises(DataError, match="at least one duration"):
        percentiles(np.array([]))
