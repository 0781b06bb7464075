"""The end of teaching: loops are closed, and path and maps put where they lie then."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from trailmark.errors import StoreFailedError
from trailmark.failures import raise_failure
from trailmark.geometry import Pose2
from trailmark.interfaces import PathStore
from trailmark.paths import Keyframe
from trailmark.pipeline.localizers.runner import LocalizerFailedError
from trailmark.pipeline.parts import LocalizerPart
from trailmark.pipeline.teaching.loops import LoopSearch, RelatingLocalizer
from trailmark.pipeline.teaching.way_graph import Straightened
from trailmark.pipeline.teaching.way_log import FIXED, WAY_LOG

__all__ = ["close_loops"]

logger = logging.getLogger(__name__)


def close_loops(store: PathStore, localizers: Sequence[LocalizerPart]) -> int:
    """Straighten a taught path, and move what is remembered along it, where places were seen twice.

    All of it is one transaction of the store: a kill leaves the path as it was taught, and it is done anew when the
    teaching is finished. A path that fixes have held in the map is left where they held it.

    Parameters
    ----------
    store : PathStore
        Open for writing, with all of the path committed.
    localizers : sequence of LocalizerPart
        Those of the run, started.

    Returns
    -------
    int
        How many relations between places have closed loops; none in a store that cannot move a path.

    Raises
    ------
    LocalizerFailedError
        If a localizer fails to say how places lie to each other, or to move what it remembers.
    """
    if store.is_finished(WAY_LOG):
        return 0
    straightened = _straightened(store, localizers)
    n_loops = 0
    if straightened is not None and _move(store, straightened, {part.name: part for part in localizers}):
        n_loops = straightened.n_loops
    store.mark_finished(WAY_LOG)
    store.commit()
    return n_loops


def _straightened(store: PathStore, localizers: Sequence[LocalizerPart]) -> Straightened | None:
    nodes = store.localizer_map(WAY_LOG).keyframes()
    relating = [
        RelatingLocalizer(part, store.localizer_map(part.name).keyframes())
        for part in localizers
        if part.localizer.relates_keyframes
    ]
    if len(nodes) < 2 or not relating or any(bool(node.arrays[FIXED]) for node in nodes):
        return None
    return LoopSearch(nodes, relating).straighten()


def _move(store: PathStore, straightened: Straightened, parts: dict[str, LocalizerPart]) -> bool:
    path = store.path()
    assert path is not None  # the log is committed with waypoints
    waypoints = [straightened.at_station(one.station_m, one.pose_map_base) for one in path.waypoints]
    keyframes = {
        owner: [
            _moved(parts.get(owner), one, straightened.at_keyframe(one))
            for one in store.localizer_map(owner).keyframes()
        ]
        for owner in store.owners()
    }
    has_moved = store.move(waypoints, keyframes)
    if not has_moved:
        logger.warning("the path store cannot move a path: its loops stay open (%d places)", straightened.n_loops)
    return has_moved


def _moved(part: LocalizerPart | None, keyframe: Keyframe, pose: Pose2) -> Keyframe:
    if part is None:
        return Keyframe(keyframe.station_m, keyframe.stamp_s, pose, keyframe.arrays)
    try:
        return part.localizer.moved(keyframe, pose)
    except BaseException as error:
        raise_failure(error, f"localizer {part.name!r}", "moved", kind=LocalizerFailedError, keeps=StoreFailedError)
