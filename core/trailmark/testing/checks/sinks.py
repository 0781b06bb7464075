"""The contract of sinks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from trailmark.commands import Steer4WS, Stop, Velocity
from trailmark.config import PluginConfig
from trailmark.estimates import (
    Applied,
    Belief,
    Estimate,
    EstimateRecord,
    Fix,
    Lost,
    Motion,
    PathOffset,
    information_from_sigmas,
)
from trailmark.frames import Frame
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import RunEnd, Session, Sink
from trailmark.testing.checks.configs import common_checks
from trailmark.testing.checks.lives import arrays_of
from trailmark.testing.checks.parametrize import Check, parametrize
from trailmark.testing.room import room_run
from trailmark.testing.runs import AnyRun, imu_run, landmark_run, light_run, odometry_run

if TYPE_CHECKING:
    import pytest

__all__ = ["parametrize_with_sink_checks", "sink_checks"]

_ENDS: tuple[Literal["done", "stopped", "interrupted", "failed"], ...] = ("done", "stopped", "interrupted", "failed")
_INFORMATION = information_from_sigmas(0.1, 0.1, 0.1)


def parametrize_with_sink_checks(
    sink: type[Sink], *, config: PluginConfig, expected_failures: Mapping[str, str] | None = None
) -> pytest.MarkDecorator:
    """Parametrize a test over the contract of sinks; the test takes ``check`` and calls it.

    Parameters
    ----------
    sink : type
        The class.
    config : PluginConfig
        Its config.
    expected_failures : mapping of str to str
        Checks that it is known not to pass, by name, and why.
    """
    return parametrize(sink_checks(sink, config), expected_failures)


def sink_checks(sink: type[Sink], config: PluginConfig) -> dict[str, Check]:
    """Return the checks by name; arguments as of `parametrize_with_sink_checks`."""

    def make() -> Sink:
        return sink(config)

    return common_checks(make, lambda: config) | {
        "takes_every_kind_of_news": lambda: _takes_everything(make),
        "takes_beliefs_that_know_nothing": lambda: _takes_ignorance(make),
        "takes_every_kind_of_end": lambda: _takes_every_end(make),
        "frames_are_left_alone": lambda: _leaves_frames_alone(make),
        "starts_again": lambda: _starts_again(make),
    }


def _runs() -> Sequence[AnyRun]:
    rooms = [room_run(kind, n_frames=2) for kind in ("image", "rgbd", "omni", "scan")]
    return (*rooms, odometry_run(n_frames=2), imu_run(n_frames=2), light_run(n_frames=2), landmark_run(n_frames=2))


def _start_sink(make: Callable[[], Sink], runs: Sequence[AnyRun]) -> Sink:
    sensors = {name: info for run in runs for name, info in run.sensors.items()}
    sink = make()
    sink.start(Session("sink", sensors=sensors))
    return sink


def _tell(sink: Sink, frames: Sequence[Frame]) -> None:
    for frame in frames:
        sink.on_frame(frame)
    stamp_s = frames[-1].stamp_s
    estimates: tuple[Estimate, ...] = (
        Motion(stamp_s - 0.1, stamp_s, Pose2(0.1, 0.0, 0.0), _INFORMATION, {"score": 0.5}),
        Fix(stamp_s, Pose2(1.0, 2.0, 3.0), np.zeros((3, 3))),
        PathOffset(stamp_s, 1.0, 0.1, 0.0, _INFORMATION),
        Lost(stamp_s, "checked\nwith 'quotes', \"more\" and ünïcode"),
    )
    for estimate, status in zip(estimates, ("accepted", "gated", "late", "unused"), strict=True):
        outcome = Applied(status, "" if status == "accepted" else "checked", 1.5, 3)  # type: ignore[arg-type]
        sink.on_estimate_record(EstimateRecord(stamp_s, "floor", estimate, outcome))
    sink.on_belief(Belief(stamp_s, Pose2(1.0, 2.0, 3.0), np.eye(3), Pose2(), Twist2(0.3), 1.0, None, 0.1, 0.1))
    for command in (Steer4WS(0.1, -0.1, 0.26), Velocity(0.3, 0.0, 0.1), Stop("arrived", done=True)):
        sink.on_command(stamp_s, command)


def _takes_everything(make: Callable[[], Sink]) -> None:
    runs = _runs()
    sink = _start_sink(make, runs)
    for run in runs:
        _tell(sink, run.frames)
    sink.on_end(RunEnd("done", counters={"frames": 16}))
    sink.close()


def _takes_ignorance(make: Callable[[], Sink]) -> None:
    sink = _start_sink(make, ())
    sink.on_belief(Belief(0.0))
    sink.on_end(RunEnd("done"))
    sink.close()


def _takes_every_end(make: Callable[[], Sink]) -> None:
    for status in _ENDS:
        sink = _start_sink(make, ())
        sink.on_end(RunEnd(status, "because"))
        sink.close()
        sink.close()


def _leaves_frames_alone(make: Callable[[], Sink]) -> None:
    runs = _runs()
    kept = [[np.array(array) for array in arrays_of(frame.payload)] for run in runs for frame in run.frames]
    sink = _start_sink(make, runs)
    for run in runs:
        _tell(sink, run.frames)
    sink.close()
    seen = [arrays_of(frame.payload) for run in runs for frame in run.frames]
    for before, after in zip(kept, seen, strict=True):
        for one, other in zip(before, after, strict=True):
            assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f"), "it changed a frame: work on a copy"


def _starts_again(make: Callable[[], Sink]) -> None:
    runs = _runs()[:1]
    sink = _start_sink(make, runs)
    for _ in range(2):
        _tell(sink, runs[0].frames)
        sink.on_end(RunEnd("done"))
        sink.start(Session("sink", sensors=runs[0].sensors))
    sink.close()
