"""CARMEN logs: planar laser and odometry."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial

from trailmark.errors import SourceError
from trailmark.frames import Odometry, SensorInfo
from trailmark.geometry import Pose2, Pose3, Trajectory
from trailmark.sources import Reading, Readings, RecordedSource
from trailmark_datasets.carmen_lines import CarmenLine, OdomLine, ScanLine, TruePoseLine, parse_line
from trailmark_datasets.config import CarmenLogConfig
from trailmark_datasets.textfiles import lines_of, number

__all__ = ["CarmenLog", "OdometryChain"]

_SCAN_KINDS = {"FLASER", "ROBOTLASER1"}
_SAME_M, _SAME_RAD = 0.02, 0.02  # a laser that moves more than this against the robot was corrected


class OdometryChain:
    """Joins the odometry of a log to poses since its start.

    Logs corrected by SLAM restate the corrected pose in an ``ODOM`` line behind every scan, with a stamp that means
    nothing, and go on from there. Such a line is no odometry: it only sets the pose from which the next steps
    count, so that the wheels' own drift stays and the truth does not leak into it.
    """

    def __init__(self) -> None:
        self.corrected = False
        self._pose_start_reference = Pose2()
        self._pose_odom_reference: Pose2 | None = None
        self._pose_odom_base = Pose2()
        self._scan: ScanLine | None = None

    def see_scan(self, scan: ScanLine) -> None:
        """Note a scan: the next line may restate its pose."""
        self._scan = scan

    def step(self, line: OdomLine) -> Pose2 | None:
        """Return `pose_start_base` of an odometry line, or None where it restates a corrected pose."""
        if self._restates(line):
            self._pose_start_reference = self.pose_start_base()
            self._pose_odom_reference = self._pose_odom_base = line.pose
            return None
        if self._pose_odom_reference is None:
            self._pose_odom_reference = line.pose
        self._pose_odom_base = line.pose
        return self.pose_start_base()

    def pose_start_base(self) -> Pose2:
        """Return the pose of the last line as seen from the start."""
        if self._pose_odom_reference is None:
            return Pose2()
        return self._pose_start_reference @ (self._pose_odom_reference.inverse() @ self._pose_odom_base)

    def _restates(self, line: OdomLine) -> bool:
        scan, self._scan = self._scan, None
        if scan is None or line.pose != scan.laser_pose:
            return False
        self.corrected = self.corrected or line.stamp_s < scan.stamp_s  # a robot at rest repeats itself, but later
        return self.corrected


class CarmenLog(RecordedSource):
    """The sensors ``laser`` and ``odometry`` of a log."""

    config: CarmenLogConfig
    reorder_s = 5.0
    _odometry_from_scans = False
    _laser_offset_m = 0.0

    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        kinds = self._look()
        self._odometry_from_scans = "ODOM" not in kinds and self.config.scan_poses == "odometry"
        if kinds & _SCAN_KINDS:
            yield SensorInfo("laser", "scan", pose_base_sensor=Pose3(x=self._laser_offset_m))
        if "ODOM" in kinds or self._odometry_from_scans:
            yield SensorInfo("odometry", "odometry")

    def _look(self) -> set[str]:
        """Return the kinds of line that give frames, and note where the laser sits."""
        kinds: set[str] = set()
        for line, text in lines_of(self.config.path):
            kind, _, rest = text.partition(" ")
            if kind == "ODOM" or kind in _SCAN_KINDS:
                kinds.add(kind)
            elif kind == "PARAM" and rest.startswith("robot_frontlaser_offset "):
                self._laser_offset_m = number(rest.split()[1], "the laser's offset", f"{self.config.path}:{line}")
        if not kinds:
            raise SourceError(f"{self.config.path}: no ODOM, FLASER or ROBOTLASER1 line, so no CARMEN log")
        return kinds

    def readings(self) -> Readings:
        chain = OdometryChain()
        first_pose: Pose2 | None = None
        for line in self._lines():
            if isinstance(line, SourceError):
                yield line
            elif isinstance(line, ScanLine):
                chain.see_scan(line)
                yield Reading("laser", line.stamp_s, line.where, line.scan)
                if self._odometry_from_scans:
                    first_pose = first_pose or line.robot_pose
                    pose = first_pose.inverse() @ line.robot_pose
                    yield Reading("odometry", line.stamp_s, line.where, partial(Odometry, pose))
            elif isinstance(line, OdomLine):
                moved = chain.step(line)
                if moved is None:
                    self.counted["restated"] += 1
                else:
                    yield Reading("odometry", line.stamp_s, line.where, partial(Odometry, moved))

    def _lines(self) -> Iterator[CarmenLine | SourceError]:
        for line, text in lines_of(self.config.path):
            try:
                parsed = parse_line(
                    text, f"{self.config.path}:{line}", self.config.range_max_m, self.config.angle_step_deg
                )
            except SourceError as error:
                yield error
            else:
                if parsed is not None:
                    yield parsed

    def ground_truth(self) -> Trajectory | None:
        """Return TRUEPOS lines, else the corrected poses of the scans, else None."""
        lines = [line for line in self._lines() if not isinstance(line, SourceError)]
        true_poses = [(line.stamp_s, line.pose) for line in lines if isinstance(line, TruePoseLine)]
        if true_poses:
            return _increasing(true_poses)
        scans = [line for line in lines if isinstance(line, ScanLine)]
        if self.config.scan_poses == "odometry" or (self.config.scan_poses == "auto" and not _is_corrected(lines)):
            return None
        offset = Pose2(-self._laser_offset_m)
        return _increasing(
            (scan.stamp_s, scan.laser_pose if scan.laser_pose == scan.robot_pose else scan.laser_pose @ offset)
            for scan in scans
        )


def _is_corrected(lines: list[CarmenLine]) -> bool:
    """Return whether the log's laser poses differ from its odometry."""
    chain = OdometryChain()
    mounted: Pose2 | None = None
    for line in lines:
        if isinstance(line, OdomLine):
            chain.step(line)
            if chain.corrected:
                return True
        elif isinstance(line, ScanLine):
            chain.see_scan(line)
            seen = line.robot_pose.inverse() @ line.laser_pose
            mounted = mounted or seen
            moved = mounted.inverse() @ seen
            if max(abs(moved.x), abs(moved.y)) > _SAME_M or abs(moved.theta) > _SAME_RAD:
                return True
    return False


def _increasing(stamped: Iterable[tuple[float, Pose2]]) -> Trajectory | None:
    """Return the trajectory without poses whose stamp does not come after those before; None if nothing is left."""
    kept: list[tuple[float, Pose2]] = []
    for stamp_s, pose in stamped:
        if not kept or stamp_s > kept[-1][0]:
            kept.append((stamp_s, pose))
    return Trajectory.from_poses(kept) if kept else None
