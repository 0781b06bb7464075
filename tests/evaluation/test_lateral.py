from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.errors import DataError
from trailmark.evaluation import lateral_error, offsets_from_path
from trailmark.geometry import Pose2, Trajectory
from trailmark.paths import Path, Waypoint


def _straight_path() -> Path:
    return Path(Waypoint(k, 0.5 * k, Pose2(0.5 * k, 0.0, 0.0)) for k in range(21))


def test_a_way_beside_the_path_is_its_distance_off() -> None:
    x = np.linspace(1.0, 9.0, 50)
    beside = Trajectory(np.arange(50.0), np.column_stack([x, np.full(50, -0.02), np.full(50, 0.1)]))

    error = lateral_error(beside, _straight_path())

    assert error.metrics()["lateral_rmse_m[n=50]"] == pytest.approx(0.02)
    assert error.metrics()["path_heading_mean_deg[n=50]"] == pytest.approx(math.degrees(0.1))


def test_left_of_the_path_is_positive_and_stations_run_along() -> None:
    way = Trajectory([0.0, 1.0], [[2.0, 0.1, 0.0], [3.0, -0.1, 0.0]])

    offsets = offsets_from_path(way, _straight_path())

    np.testing.assert_allclose(offsets, [[2.0, 0.1, 0.0], [3.0, -0.1, 0.0]], atol=1e-12)


def test_a_path_that_crosses_itself_is_followed_in_order() -> None:
    phase = np.linspace(0.0, 2.0 * np.pi, 200)
    points = np.column_stack([3.0 * np.sin(phase), 1.5 * np.sin(2.0 * phase)])
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    stations = np.concatenate([[0.0], np.cumsum(steps)])
    headings = np.arctan2(np.gradient(points[:, 1]), np.gradient(points[:, 0]))
    path = Path(Waypoint(k, stations[k], Pose2(*points[k], headings[k])) for k in range(200))
    way = Trajectory(phase, np.column_stack([points, headings]))

    offsets = offsets_from_path(way, path)

    assert (np.diff(offsets[:, 0]) > 0).all()
    assert np.abs(offsets[:, 1:]).max() < 1e-9


def test_an_empty_trajectory_is_refused() -> None:
    with pytest.raises(DataError, match="empty"):
        lateral_error(Trajectory([], np.empty((0, 3))), _straight_path())
