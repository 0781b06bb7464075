"""The end of teaching: loops are closed, and path and maps put where they lie then."""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence

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

__all__ = ["close_loops", "owners_beside"]

logger = logging.getLogger(__name__)


def close_loops(
    store: PathStore, localizers: Sequence[LocalizerPart], switched_off: Sequence[LocalizerPart] = ()
) -> int:
    """Straighten a taught path, and move what is remembered along it, where places were seen twice.

    All of it is one transaction of the store: a kill leaves the path as it was taught, and it is done anew when the
    teaching is finished. A path that fixes have held in the map is left where they held it. While somebody has
    keyframes there who is not in the run, nothing moves: only the localizer knows what its arrays hold in map axes.

    Parameters
    ----------
    store : PathStore
        Open for writing, with all of the path committed.
    localizers : sequence of LocalizerPart
        Those of the run, started.
    switched_off : sequence of LocalizerPart
        Those that failed in the run: they are not asked about places, but move what they remember.

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
    n_loops = 0
    nodes = store.localizer_map(WAY_LOG).keyframes()
    if len(nodes) >= 2 and not any(bool(node.arrays[FIXED]) for node in nodes):
        search = _search_of(store, nodes, localizers)
        straightened = search.straighten() if search is not None else None
        if search is not None and search.n_left_open:
            logger.warning(
                "%d relations between places were left out, and their loops stay open: places look like others, or"
                " the way between them says that they differ",
                search.n_left_open,
            )
        parts = {part.name: part for part in (*localizers, *switched_off)}
        if missing := owners_beside(store, parts):
            if straightened is not None:
                logger.warning(
                    "places were seen twice (%d), but the path is left as it was taught: %s remembers it too, is not in"
                    " this run, and its map would not fit any more; replay once with it to straighten all",
                    *(straightened.n_loops, ", ".join(missing)),
                )
            return 0
        if straightened is not None and _move(store, straightened, parts):
            n_loops = straightened.n_loops
    store.mark_finished(WAY_LOG)
    store.commit()
    return n_loops


def owners_beside(store: PathStore, names: Collection[str]) -> list[str]:
    """Return which localizers have keyframes in a store, beside those of these names."""
    others = [owner for owner in store.owners() if owner != WAY_LOG and owner not in names]
    return [owner for owner in others if store.localizer_map(owner).keyframes()]


def _search_of(store: PathStore, nodes: Sequence[Keyframe], localizers: Sequence[LocalizerPart]) -> LoopSearch | None:
    relating = [
        RelatingLocalizer(part, store.localizer_map(part.name).keyframes())
        for part in localizers
        if part.localizer.relates_keyframes
    ]
    return LoopSearch(nodes, relating) if relating else None


def _move(store: PathStore, straightened: Straightened, parts: dict[str, LocalizerPart]) -> bool:
    path = store.path()
    assert path is not None  # the log is committed with waypoints
    waypoints = [straightened.at_station(one.station_m, one.pose_map_base) for one in path.waypoints]
    keyframes = {
        owner: [
            _move_keyframe(parts.get(owner), one, straightened.at_keyframe(one))
            for one in store.localizer_map(owner).keyframes()
        ]
        for owner in store.owners()
    }
    has_moved = store.move(waypoints, keyframes)
    if not has_moved:
        logger.warning("the path store cannot move a path: its loops stay open (%d places)", straightened.n_loops)
    return has_moved


def _move_keyframe(part: LocalizerPart | None, keyframe: Keyframe, pose: Pose2) -> Keyframe:
    if part is None:
        return Keyframe(keyframe.station_m, keyframe.stamp_s, pose, keyframe.arrays)
    try:
        return part.localizer.moved(keyframe, pose)
    except BaseException as error:
        raise_failure(error, f"localizer {part.name!r}", "moved", kind=LocalizerFailedError, keeps=StoreFailedError)
