"""Trajectories of a run: the fused one, and one of each localizer by itself."""

from __future__ import annotations

import logging
import weakref
from array import array
from collections.abc import Iterable, Mapping
from tempfile import TemporaryFile
from typing import IO

import numpy as np

from trailmark.estimates import Belief, EstimateRecord, Fix, Lost, Motion
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.estimation.information import checked_information, measured_directions
from trailmark.geometry import Pose2, Trajectory
from trailmark.interfaces import Session, Sink

__all__ = ["Track", "Tracks"]

logger = logging.getLogger(__name__)

_COLUMNS = 4
#: Poses of a track that are held in memory; older ones wait in a file.
_N_HELD = 1 << 14


class Track:
    """Poses over time as they become known: what was said about the past later does not change it.

    A run of hours has millions of them, so all but the latest wait in a temporary file without a name. Where none can
    be written they stay in memory.
    """

    def __init__(self) -> None:
        self._rows = array("d")
        self._last_s = -np.inf
        self._n_held = _N_HELD
        self._file: IO[bytes] | None = None
        self._n_filed = 0

    def __len__(self) -> int:
        return self._n_filed + len(self._rows) // _COLUMNS

    def add(self, stamp_s: float, pose: Pose2) -> None:
        """Add a pose; of one stamp the last counts, and an older one does not."""
        if stamp_s < self._last_s:
            return
        if stamp_s == self._last_s:
            del self._rows[-_COLUMNS:]
        self._rows.extend((stamp_s, pose.x, pose.y, pose.theta))
        self._last_s = stamp_s
        if len(self._rows) > _COLUMNS * self._n_held:
            self._file_older()

    def trajectory(self) -> Trajectory:
        """Return what there is."""
        filed = b""
        if self._file is not None:
            self._file.seek(0)
            filed = self._file.read(8 * _COLUMNS * self._n_filed)
        table = np.concatenate([np.frombuffer(filed), np.array(self._rows, dtype=np.float64)]).reshape(-1, _COLUMNS)
        return Trajectory(table[:, 0], table[:, 1:])

    def _file_older(self) -> None:
        """Move all rows but the last, which may still be replaced, to the file."""
        older = self._rows[:-_COLUMNS]
        try:
            if self._file is None:
                self._file = TemporaryFile()  # noqa: SIM115 - open as long as the track is there
                weakref.finalize(self, self._file.close)
            self._file.seek(8 * _COLUMNS * self._n_filed)
            self._file.write(older.tobytes())
            self._file.flush()
        except OSError as error:
            logger.warning("trajectories stay in memory: no temporary file can be written: %s", error)
            self._n_held = 1 << 60
            return
        self._n_filed += len(older) // _COLUMNS
        del self._rows[:-_COLUMNS]


class _OwnTrack:
    """A dead reckoning of one localizer's estimates, used or not.

    A fix that says a single number (one range, one bearing) is no pose: without motions between them such fixes would
    be taken to wherever the track happens to be, and not to where they hold.
    """

    def __init__(self, session: Session) -> None:
        self._estimator = DeadReckoning(DeadReckoningConfig(), poses_alone=True)
        self._estimator.start(session)
        self._in_map, self._in_odom = Track(), Track()
        self._has_motion = False

    def add(self, record: EstimateRecord) -> None:
        self._has_motion |= isinstance(record.estimate, Motion)
        if not self._has_motion and isinstance(record.estimate, Fix) and _says_one_number(record.estimate):
            return
        if self._estimator.apply(record.source, record.estimate).status == "refused":
            return
        stamp_s, pose_map_base, pose_odom_base = self._estimator.poses_at(record.estimate.stamp_s)
        if pose_map_base is not None:
            self._in_map.add(stamp_s, pose_map_base)
        else:
            self._in_odom.add(stamp_s, pose_odom_base)

    def trajectory(self) -> Trajectory:
        """Return the way in the map; of a localizer that never knew where it started, the way from its start."""
        return (self._in_map if len(self._in_map) else self._in_odom).trajectory()


def _says_one_number(fix: Fix) -> bool:
    information = checked_information(fix.information)
    return not isinstance(information, str) and measured_directions(information).rank == 1


class Tracks(Sink):
    """Collects ``fused`` and a trajectory of each localizer.

    Parameters
    ----------
    names : iterable of str
        The localizers.
    session : Session
        Where a localizer's own dead reckoning starts: `path` and `start_pose`.
    """

    def __init__(self, names: Iterable[str], session: Session) -> None:
        super().__init__(None)
        self._fused = Track()
        self._own = {name: _OwnTrack(session) for name in names}

    def on_estimate_record(self, record: EstimateRecord) -> None:
        """Add the estimate to the localizer's own dead reckoning."""
        if not isinstance(record.estimate, Lost):
            self._own[record.source].add(record)

    def on_belief(self, belief: Belief) -> None:
        """Add to the fused trajectory."""
        if belief.pose_map_base is not None:
            self._fused.add(belief.stamp_s, belief.pose_map_base)

    def trajectories(self) -> Mapping[str, Trajectory]:
        """Return all trajectories by name; a localizer that said nothing has an empty one."""
        return {name: own.trajectory() for name, own in self._own.items()} | {"fused": self._fused.trajectory()}
