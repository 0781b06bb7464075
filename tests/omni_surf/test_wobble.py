"""How answers scatter about the motion between them, and what that is not."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.geometry import Pose2
from trailmark_omni_surf.wobble import Wobble

INTERVAL_S = 0.1
BENT = Pose2(0.05, 0.0, 0.02)


def scatter_of(offs: list[float], step: Pose2 = BENT, heading: float = 0.0):
    """Return what is said at the last of answers that are off to the left, seen from the map, along a bent way."""
    wobble, pose, scatter = Wobble(), Pose2(), None
    for k, off in enumerate(offs):
        answer = Pose2(pose.x, pose.y + off, pose.theta + heading * off)
        scatter = wobble.add(INTERVAL_S * k, answer, pose)
        pose = pose @ step
    return scatter


def test_too_few_tell_nothing() -> None:
    assert scatter_of([0.0] * 4) is None
    assert scatter_of([0.0] * 5) is not None


@given(x=st.floats(-50, 50), y=st.floats(-50, 50), theta=st.floats(-3, 3))
def test_answers_that_follow_the_motion_do_not_scatter_wherever_odometry_begins(
    x: float, y: float, theta: float
) -> None:
    wobble, origin, pose, scatter = Wobble(), Pose2(x, y, theta), Pose2(), None
    for k in range(20):
        scatter = wobble.add(INTERVAL_S * k, origin @ pose, pose)
        pose = pose @ Pose2(0.1, 0.0, 0.1)

    np.testing.assert_allclose(scatter, 0.0, atol=1e-18)


def test_answers_that_alternate_scatter_by_as_much() -> None:
    scatter = scatter_of([0.1 * (k % 2) for k in range(40)])

    assert scatter is not None
    assert 0.05 < math.sqrt(scatter[1, 1]) < 0.1 / math.sqrt(2.0)  # half of them are off by 0.1, and a line fits some
    assert scatter[0, 0] == pytest.approx(0.0, abs=1e-4)


def test_what_changes_steadily_may_be_the_wheels() -> None:
    """A fix must not widen by what tells of wheels that slip."""
    np.testing.assert_allclose(scatter_of([0.03 * k for k in range(40)], Pose2(0.05, 0.0, 0.0)), 0.0, atol=1e-12)


def test_a_jump_is_seen_and_forgotten() -> None:
    offs = [0.0] * 30 + [0.2] * 70

    assert scatter_of(offs[:33], heading=1.0)[2, 2] > 0.08**2
    np.testing.assert_allclose(scatter_of(offs), 0.0, atol=1e-12)


def test_the_last_answer_and_the_motion_tell_where_base_is_for_a_while() -> None:
    wobble = Wobble()
    assert wobble.expected(0.0, Pose2()) is None
    wobble.add(0.0, Pose2(1.0, 2.0, math.pi / 2), Pose2(5.0, 5.0, 0.0))

    expected = wobble.expected(1.0, Pose2(5.5, 5.0, 0.1))

    assert expected is not None
    np.testing.assert_allclose(expected.array(), [1.0, 2.5, math.pi / 2 + 0.1])
    assert wobble.expected(7.0, Pose2()) is None
    wobble.clear()
    assert wobble.expected(1.0, Pose2()) is None
