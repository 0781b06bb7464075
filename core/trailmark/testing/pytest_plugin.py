"""Fixtures for the tests of plugins; pytest loads them wherever Trailmark is installed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from trailmark.testing.runs import AnyRun

__all__ = ["tiny_run"]


@pytest.fixture(scope="session")
def tiny_run() -> Callable[[str], AnyRun]:
    """Return a function that gives a short drive with exact truth, by the kind of sensor.

    Kinds: ``ground`` (a camera that looks down), ``image``, ``rgbd``, ``omni``, ``scan``, ``odometry``, ``imu``,
    ``light`` and ``landmarks``.
    """
    from functools import cache, partial

    from trailmark.plugins.hints import nearest_or_all
    from trailmark.testing import ground, motions, room, runs

    law = motions.circle(0.3, 1.0)
    makers: dict[str, Callable[[], AnyRun]] = {
        "ground": partial(ground.ground_run, law, 20),
        "image": partial(room.room_run, "image", law),
        "rgbd": partial(room.room_run, "rgbd", law),
        "omni": partial(room.room_run, "omni", law),
        "scan": partial(room.room_run, "scan", law),
        "odometry": partial(runs.odometry_run, law),
        "imu": partial(runs.imu_run, law),
        "light": partial(runs.light_run, law),
        "landmarks": partial(runs.landmark_run, law),
    }

    @cache
    def run(kind: str) -> AnyRun:
        if kind not in makers:
            raise ValueError(f"no tiny run of {kind!r}{nearest_or_all(kind, makers, 'kinds')}")
        return makers[kind]()

    return run
