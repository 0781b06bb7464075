"""How far apart keyframes are."""

from __future__ import annotations

import math

import pytest

from trailmark.geometry import Pose2
from trailmark_omni_surf.spacing import KeyframeSpacing


@pytest.fixture
def spacing() -> KeyframeSpacing:
    return KeyframeSpacing(0.5, math.radians(20.0))


def test_the_first_place_is_new(spacing: KeyframeSpacing) -> None:
    assert spacing.is_new_place(0.0, Pose2())


@pytest.mark.parametrize(
    ("travelled_m", "heading_deg", "is_new"), [(0.49, 19.0, False), (0.51, 0.0, True), (0.0, 21.0, True)]
)
def test_a_place_is_new_after_enough_way_or_a_turn(
    spacing: KeyframeSpacing, travelled_m: float, heading_deg: float, is_new: bool
) -> None:
    spacing.add(3.0, Pose2(1.0, 2.0, 0.3))

    pose = Pose2(1.0, 2.0, 0.3 - math.radians(heading_deg))

    assert spacing.is_new_place(3.0 + travelled_m, pose) is is_new


def test_asking_takes_no_keyframe(spacing: KeyframeSpacing) -> None:
    spacing.is_new_place(0.0, Pose2())

    assert spacing.is_new_place(0.0, Pose2())
