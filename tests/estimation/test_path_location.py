"""Finding a belief on its path again after a fix has moved it far along the path."""

from __future__ import annotations

import pytest

from trailmark.geometry import Pose2
from trailmark.paths import Path, Waypoint


def test_a_pose_that_jumped_along_the_path_is_found_again() -> None:
    path = Path(Waypoint(i, 0.05 * i, Pose2(0.05 * i, 0.0, 0.0)) for i in range(2000))

    located = path.locate(Pose2(60.0, 0.02, 0.0), near_station_m=50.0)  # 10 m ahead: lateral alone looks fine

    assert located.station_m == pytest.approx(60.0)
    assert located.lateral_m == pytest.approx(0.02)


def test_a_pose_beyond_the_end_stays_at_the_end() -> None:
    path = Path([Waypoint(0, 0.0, Pose2()), Waypoint(1, 1.0, Pose2(1.0, 0.0, 0.0))])

    located = path.locate(Pose2(1.4, 0.1, 0.0), near_station_m=0.9)

    assert located.station_m == 1.0
    assert located.lateral_m == pytest.approx(0.1)
