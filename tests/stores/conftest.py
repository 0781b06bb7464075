"""A small taught place, and ways to open it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from trailmark.frames import GroundPlane, SensorInfo
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Session
from trailmark.paths import Keyframe, Waypoint
from trailmark.stores import SqlitePathStore, SqliteStoreConfig

SENSORS = {
    "floor": SensorInfo("floor", "image", (512, 480), 70.0, Pose3(x=0.05, yaw=0.5), GroundPlane((3.9e-4, 3.9e-4)))
}
META = {"trailmark": "0.1.0", "git": {"commit": "abc", "dirty": False}}


@contextmanager
def opened(path: Path, access: str = "read") -> Iterator[SqlitePathStore]:
    """Open a store for the length of a block."""
    store = SqlitePathStore(SqliteStoreConfig(path=str(path), access=access))
    store.start(Session())
    try:
        yield store
    finally:
        store.close()


def waypoint(index: int) -> Waypoint:
    """Waypoint `index` of a path that turns to the left."""
    return Waypoint(index, 0.05 * index, Pose2(0.05 * index, 0.001 * index**2, 0.01 * index))


def keyframe(number: int, size: int = 44) -> Keyframe:
    """Keyframe `number`: a patch of the ground, and three numbers."""
    rng = np.random.default_rng(number)
    patch = rng.integers(0, 256, (size, size), dtype=np.uint8)
    arrays = {"patch": patch, "offset": rng.normal(size=3)}
    return Keyframe(0.05 * number + 0.01, 100.0 + 0.1 * number, Pose2(0.05 * number, 0.2, 0.3), arrays)


def teach(store: SqlitePathStore, n_waypoints: int, start: int = 0) -> None:
    """Lay waypoints, with a keyframe and a commit each."""
    drawer = store.localizer_map("floor")
    for index in range(start, start + n_waypoints):
        drawer.add(keyframe(index))
        store.append(waypoint(index))
        store.commit()


def contents(path: Path) -> tuple[object, ...]:
    """Return all that a store holds, in values that compare exactly."""
    with opened(path) as store:
        taught = store.path()
        drawers = []
        for owner in store.owners():
            drawer = store.localizer_map(owner)
            keyframes = [
                (
                    k.station_m,
                    k.stamp_s,
                    k.pose_map_base,
                    {n: (a.dtype, a.shape, a.tobytes()) for n, a in k.arrays.items()},
                )
                for k in drawer.keyframes()
            ]
            saved = drawer.load("map")
            drawers.append((owner, store.is_finished(owner), keyframes, saved and saved["points"].tobytes()))
        return (None if taught is None else taught.waypoints), drawers, repr(store.sensors()), store.meta()


@pytest.fixture(scope="session")
def place() -> SimpleNamespace:
    """The helpers of this file."""
    return SimpleNamespace(
        SENSORS=SENSORS, META=META, opened=opened, waypoint=waypoint, keyframe=keyframe, teach=teach, contents=contents
    )


@pytest.fixture
def taught(tmp_path: Path) -> Path:
    """A closed store with 12 waypoints, two drawers, sensors and provenance."""
    path = tmp_path / "place.trail"
    with opened(path, "create") as store:
        store.set_sensors(SENSORS)
        store.set_meta(META)
        teach(store, 12)
        store.localizer_map("laser").save("map", {"points": np.arange(40.0).reshape(20, 2), "n": np.array(20)})
        store.mark_finished("laser")
        store.commit()
    return path
