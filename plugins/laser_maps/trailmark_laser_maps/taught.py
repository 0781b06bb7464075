"""The scans that a localizer remembered while it was taught, as a path store keeps them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np

from trailmark.errors import ConfigError
from trailmark.interfaces import Session
from trailmark.stores import SqlitePathStore, SqliteStoreConfig
from trailmark.stores.survey import describe_store
from trailmark_laser_maps.carving import PlacedScan

__all__ = ["taught_scans"]

_POINTS = "points"


def taught_scans(path: Path, localizer: str | None = None) -> list[PlacedScan]:
    """Return the scans of a taught place, where they were taken.

    Any localizer's keyframes do that hold an array ``points``, (N, 2), in base axes, as `grid_mcl` and ``laser_icp``
    keep them.

    Parameters
    ----------
    path : Path
        The path store.
    localizer : str, optional
        Name of the localizer that remembered them; left out, the only one that remembers scans.

    Raises
    ------
    ConfigError
        If no localizer, or more than one, remembers scans there.
    StoreError
        If the file is no path store.
    """
    owners = [row["owner"] for row in describe_store(path)["drawers"] if row["keyframes"]]
    store = SqlitePathStore(SqliteStoreConfig(path=str(path), access="read"))
    store.start(Session())
    with closing(store):
        laser = _laser_base(store)
        found = {owner: list(_scans_of(store, owner, laser)) for owner in owners if localizer in (None, owner)}
    remembering = [owner for owner, scans in found.items() if scans]
    if not remembering:
        whom = "nothing of a localizer" if localizer is None else f"no localizer {localizer!r}"
        raise ConfigError(f"{path} holds {whom} that remembers scans; see 'trailmark store info {path}'")
    if len(remembering) > 1:
        raise ConfigError(f"{path} holds scans of {' and '.join(remembering)}: say which with --localizer")
    return found[remembering[0]]


def _scans_of(store: SqlitePathStore, owner: str, laser: tuple[float, float]) -> Iterator[PlacedScan]:
    for keyframe in store.localizer_map(owner).keyframes():
        points = keyframe.arrays.get(_POINTS)
        if points is not None and points.ndim == 2 and points.shape[1] == 2:
            yield PlacedScan.at(keyframe.pose_map_base, points.astype(np.float64), laser)


def _laser_base(store: SqlitePathStore) -> tuple[float, float]:
    """Return where the laser sits on base; in its middle if the store does not tell [m].

    Raises
    ------
    ConfigError
        If there are several, in several places: keyframes do not say which of them saw what.
    """
    lasers = [info for info in store.sensors().values() if info.kind == "scan"]
    mountings = {(pose.x, pose.y) for pose in (info.pose_base_sensor.planar() for info in lasers)}
    if len(mountings) > 1:
        names = ", ".join(sorted(info.name for info in lasers))
        raise ConfigError(f"the place was taught with several lasers ({names}): teach with one to draw its map")
    return mountings.pop() if mountings else (0.0, 0.0)
