"""Stamps of live messages."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from trailmark.errors import SourceError
from trailmark_ros2.stamping import Stamper


def message(stamp_s: float) -> SimpleNamespace:
    return SimpleNamespace(header=SimpleNamespace(stamp=SimpleNamespace(sec=int(stamp_s), nanosec=0)))


def test_one_stamp_of_the_future_is_refused_and_those_after_it_are_not() -> None:
    stamper = Stamper("/odom", "header", 1.0)
    for k in range(1, 11):
        stamper.stamp_s(message(k), float(k))

    with pytest.raises(SourceError, match="its stamp is 4000000000 s ahead of those before it"):
        stamper.stamp_s(message(4_000_000_011), 11.0)

    assert stamper.stamp_s(message(12.0), 12.0) == 12.0


def test_where_arrivals_count_no_stamp_is_refused() -> None:
    stamper = Stamper("/odom", "receive", 1.0)
    for k in range(1, 11):
        stamper.stamp_s(message(k), float(k))

    assert stamper.stamp_s(message(4_000_000_011), 11.0) == 11.0
