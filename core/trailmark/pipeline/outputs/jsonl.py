"""A sink that writes lines of JSON."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

from trailmark.commands import Command
from trailmark.errors import ConfigError
from trailmark.estimates import Belief, Estimate, EstimateRecord, Fix, Motion, PathOffset
from trailmark.geometry import Pose2
from trailmark.interfaces import RunEnd, Session, Sink
from trailmark.pipeline.outputs.jsonl_config import JsonlConfig

__all__ = ["JsonlSink"]


class JsonlSink(Sink):
    """Writes ``{"type": "belief" | "estimate" | "command" | "end", ...}``, one object a line.

    Poses are ``[x, y, theta]``, null while unknown; so is an age that is infinite. Of estimates, the information, the
    details, ``Motion.is_matched`` and ``Motion.is_guess`` are left out.
    """

    def __init__(self, config: JsonlConfig) -> None:
        super().__init__(config)
        self._config = config
        self._file: TextIO | None = None

    def start(self, session: Session) -> None:
        """Open the file.

        Raises
        ------
        ConfigError
            If it cannot be written.
        """
        self.close()
        match self._config.to:
            case Path() as path:
                try:
                    self._file = path.open("w", encoding="utf-8")
                except OSError as error:
                    raise ConfigError(f"jsonl cannot write to {path}: {error.strerror or error}") from error
            case name:
                self._file = sys.stderr if name == "stderr" else sys.stdout

    def close(self) -> None:
        """Close the file; standard output stays open."""
        if isinstance(self._config.to, Path) and self._file is not None:
            self._file.close()
        self._file = None

    def on_belief(self, belief: Belief) -> None:
        """Write a belief."""
        if self._config.beliefs:
            on_path = belief.on_path
            self._write(
                "belief",
                stamp_s=belief.stamp_s,
                pose_map_base=_pose(belief.pose_map_base),
                pose_odom_base=_pose(belief.pose_odom_base),
                twist=[belief.twist.forward_mps, belief.twist.left_mps, belief.twist.yaw_radps],
                travelled_m=belief.travelled_m,
                on_path=on_path and [on_path.station_m, on_path.lateral_m, on_path.heading_rad],
                fix_age_m=_finite(belief.fix_age_m),
                motion_age_s=_finite(belief.motion_age_s),
            )

    def on_estimate_record(self, record: EstimateRecord) -> None:
        """Write an estimate."""
        if self._config.estimates:
            estimate, outcome = record.estimate, record.outcome
            self._write(
                "estimate",
                source=record.source,
                kind=type(estimate).__name__,
                **_numbers(estimate),
                status=outcome.status,
                reason=outcome.reason,
            )

    def on_command(self, stamp_s: float, command: Command) -> None:
        """Write a command."""
        if self._config.commands:
            self._write("command", stamp_s=stamp_s, kind=type(command).__name__, **asdict(command))

    def on_end(self, end: RunEnd) -> None:
        """Write how the run ended."""
        self._write("end", status=end.status, reason=end.reason)

    def _write(self, what: str, /, **fields: Any) -> None:
        if self._file is None:
            return
        try:
            self._file.write(json.dumps({"type": what, **fields}, separators=(",", ":")) + "\n")
            self._file.flush()  # who listens wants it now
        except BrokenPipeError:  # nobody listens any more: the run goes on without
            self._file = None


def _numbers(estimate: Estimate) -> dict[str, Any]:
    match estimate:
        case Motion():
            pose = _pose(estimate.pose_since_now)
            return {"since_s": estimate.since_s, "stamp_s": estimate.stamp_s, "pose_since_now": pose}
        case Fix():
            return {"stamp_s": estimate.stamp_s, "pose_map_base": _pose(estimate.pose_map_base)}
        case PathOffset():
            on_path = [estimate.station_m, estimate.lateral_m, estimate.heading_rad]
            return {"stamp_s": estimate.stamp_s, "on_path": on_path}
    return {"stamp_s": estimate.stamp_s, "lost": estimate.reason}


def _pose(pose: Pose2 | None) -> list[float] | None:
    return None if pose is None else [pose.x, pose.y, pose.theta]


def _finite(value: float) -> float | None:
    return value if value < float("inf") else None
