"""Tools for the tests of plugins: synthetic runs with exact ground truth, and the contract of every part. ::

    from trailmark.testing import parametrize_with_localizer_checks, room_run

    @parametrize_with_localizer_checks(MyLocalizer, config=MyConfig(), frames=room_run("image"))
    def test_the_contract(check):
        check()

Importing this package is cheap: what stands behind the names is loaded on first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trailmark.testing.checks import (
        controller_checks,
        estimator_checks,
        fault_checks,
        localizer_checks,
        parametrize_with_controller_checks,
        parametrize_with_estimator_checks,
        parametrize_with_fault_checks,
        parametrize_with_localizer_checks,
        parametrize_with_sink_checks,
        parametrize_with_source_checks,
        parametrize_with_store_checks,
        sink_checks,
        source_checks,
        store_checks,
    )
    from trailmark.testing.ground import GroundCamera, GroundRun, MirroredFloor, ground_run
    from trailmark.testing.memory_map import MemoryMap
    from trailmark.testing.motions import MotionLaw, circle, straight, true_poses, uneven
    from trailmark.testing.room import Room, room_run
    from trailmark.testing.runs import (
        AnyRun,
        SyntheticRun,
        imu_run,
        landmark_run,
        light_run,
        odometry_run,
        pose_run,
    )

__all__ = [
    "AnyRun",
    "GroundCamera",
    "GroundRun",
    "MemoryMap",
    "MirroredFloor",
    "MotionLaw",
    "Room",
    "SyntheticRun",
    "circle",
    "controller_checks",
    "estimator_checks",
    "fault_checks",
    "ground_run",
    "imu_run",
    "landmark_run",
    "light_run",
    "localizer_checks",
    "odometry_run",
    "parametrize_with_controller_checks",
    "parametrize_with_estimator_checks",
    "parametrize_with_fault_checks",
    "parametrize_with_localizer_checks",
    "parametrize_with_sink_checks",
    "parametrize_with_source_checks",
    "parametrize_with_store_checks",
    "pose_run",
    "room_run",
    "sink_checks",
    "source_checks",
    "store_checks",
    "straight",
    "true_poses",
    "uneven",
]

_MODULES = {
    "trailmark.testing.memory_map": ("MemoryMap",),
    "trailmark.testing.ground": ("MirroredFloor", "GroundCamera", "GroundRun", "ground_run"),
    "trailmark.testing.motions": ("MotionLaw", "circle", "straight", "true_poses", "uneven"),
    "trailmark.testing.room": ("Room", "room_run"),
    "trailmark.testing.runs": (
        "AnyRun", "SyntheticRun", "imu_run", "landmark_run", "light_run", "odometry_run", "pose_run",
    ),
}  # fmt: skip
_LAZY = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'trailmark.testing' has no attribute {name!r}")
    return getattr(import_module(_LAZY.get(name, "trailmark.testing.checks")), name)
