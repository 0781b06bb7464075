"""What the matches of both groups say together."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.moves import TwoViews

DISTANCE_PX = 192.0


def test_the_lower_group_comes_first_in_a_turn() -> None:
    """A swapped pair turns the robot the other way, which a drive that sways and comes back does not tell."""
    turned = ImageMotion(3.0, -2.0, math.radians(1.0))
    nothing: Any = None
    views = TwoViews(nothing, nothing, DISTANCE_PX, 1.0)
    lower, upper = (
        SimpleNamespace(motion=turned.about(0.0, offset, 1.0)) for offset in (DISTANCE_PX / 2, -DISTANCE_PX / 2)
    )
    matches: Any = (lower, upper)

    combined = views.combine(matches)

    assert combined.turn_rad == pytest.approx(turned.turn_rad)
    assert (combined.u, combined.v) == pytest.approx((turned.u, turned.v))
