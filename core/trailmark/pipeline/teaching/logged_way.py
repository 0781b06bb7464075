"""Where along the way log a keyframe or a waypoint belongs, also where teaching went on with `--append`."""

from __future__ import annotations

import itertools
from bisect import bisect_left
from collections.abc import Sequence

from trailmark.paths import Keyframe

__all__ = ["LoggedWay"]

# A keyframe that is farther from where the robot was at its stamp is of another teaching [m].
_FITS_M = 1.0
# The log lacks what lies between nodes that are farther apart than this [m].
_GAP_M = 2.0


class LoggedWay:
    """The way log, cut where stamps or stations do not go on.

    Stations go on over all teachings of a path; stamps of each teaching may begin at zero again, and a teaching
    without a localizer that relates keyframes has no nodes.

    Parameters
    ----------
    nodes : sequence of Keyframe
        The way log, at least one.

    Attributes
    ----------
    nodes : sequence of Keyframe
        The way log.
    drives : list of range
        Numbers of nodes over which stamps tell the place.
    """

    def __init__(self, nodes: Sequence[Keyframe]) -> None:
        self.nodes = nodes
        self._stamps = [node.stamp_s for node in nodes]
        self._stations = [node.station_m for node in nodes]
        # The end of a teaching may lie beyond its last waypoint, from which the next one counts on.
        self._farthest = list(itertools.accumulate(self._stations, max))
        cuts = [k for k in range(1, len(nodes)) if self._is_cut(k)]
        self.drives = [range(*ends) for ends in itertools.pairwise((0, *cuts, len(nodes)))]

    def at_station(self, station_m: float) -> tuple[int, int, float]:
        """Return the nodes before and after a station, and its share of the way between them, 0 to 1."""
        after = min(max(bisect_left(self._farthest, station_m), 1), len(self.nodes) - 1)
        return after - 1, after, _share(self._stations, after, station_m)

    def at_stamp(self, stamp_s: float, drive: range | None = None) -> tuple[int, int, float]:
        """Return the same of a stamp, in one drive; None: in all of a way that was taught in one."""
        drive = drive or range(len(self.nodes))
        after = bisect_left(self._stamps, stamp_s, drive.start, drive.stop)
        after = min(max(after, drive.start + 1), drive.stop - 1)
        if len(drive) == 1:
            return drive.start, drive.start, 0.0
        return after - 1, after, _share(self._stamps, after, stamp_s)

    def at_keyframe(self, keyframe: Keyframe) -> tuple[int, int, float]:
        """Return the same of a keyframe: by its stamp in its drive; by its station, where there is none."""
        drive = self.drive_of(keyframe)
        return self.at_station(keyframe.station_m) if drive is None else self.at_stamp(keyframe.stamp_s, drive)

    def drive_of(self, keyframe: Keyframe) -> range | None:
        """Return the drive in which the robot was at the keyframe's station at its stamp; None: it is not logged."""
        fitting = [drive for drive in self.drives if self._off_m(keyframe, drive) <= _FITS_M]
        return min(fitting, key=lambda drive: self._gap_s(keyframe, drive), default=None)

    def _is_cut(self, node: int) -> bool:
        way_m = self._stations[node] - self._stations[node - 1]
        return self._stamps[node] < self._stamps[node - 1] or not 0.0 <= way_m <= _GAP_M

    def _off_m(self, keyframe: Keyframe, drive: range) -> float:
        before, after, _ = self.at_stamp(keyframe.stamp_s, drive)
        station_m = keyframe.station_m
        return max(self._stations[before] - station_m, station_m - self._stations[after], 0.0)

    def _gap_s(self, keyframe: Keyframe, drive: range) -> float:
        return max(self._stamps[drive[0]] - keyframe.stamp_s, keyframe.stamp_s - self._stamps[drive[-1]], 0.0)


def _share(grid: Sequence[float], after: int, value: float) -> float:
    share = (value - grid[after - 1]) / max(grid[after] - grid[after - 1], 1e-12)
    return min(max(share, 0.0), 1.0)
