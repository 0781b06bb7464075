"""The contract of frame sources."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from trailmark.commands import Stop
from trailmark.config import PluginConfig
from trailmark.frames import payload_kind
from trailmark.frames.sensors import PAYLOAD_KINDS
from trailmark.interfaces import Drivable, FrameSource, Session
from trailmark.testing.checks.configs import common_checks
from trailmark.testing.checks.lives import arrays_of
from trailmark.testing.checks.parametrize import Check, parametrize, skip
from trailmark.testing.checks.source_truth import bytes_of, source_truth_checks

if TYPE_CHECKING:
    import pytest

__all__ = ["parametrize_with_source_checks", "source_checks"]

_STANDING_FRAMES = 200
_STANDING_M = 1e-6


def parametrize_with_source_checks(
    source: type[FrameSource],
    *,
    config: PluginConfig | Callable[[], PluginConfig],
    n_frames: int = 50,
    expected_failures: Mapping[str, str] | None = None,
) -> pytest.MarkDecorator:
    """Parametrize a test over the contract of frame sources; the test takes ``check`` and calls it.

    Parameters
    ----------
    source : type
        The class.
    config : PluginConfig or callable
        Its config, with a recording that is there; or what returns it, so that the recording is made only when the
        test runs.
    n_frames : int
        How many frames of it are looked at.
    expected_failures : mapping of str to str
        Checks that it is known not to pass, by name, and why.
    """
    return parametrize(source_checks(source, config, n_frames), expected_failures)


def source_checks(
    source: type[FrameSource], config: PluginConfig | Callable[[], PluginConfig], n_frames: int = 50
) -> dict[str, Check]:
    """Return the checks by name; arguments as of `parametrize_with_source_checks`."""

    def settle_config() -> PluginConfig:
        return config if isinstance(config, PluginConfig) else config()

    def make() -> FrameSource:
        return source(settle_config())

    return common_checks(make, settle_config) | {
        "sensors_are_known_after_start": lambda: _knows_its_sensors(make),
        "frames_are_in_order": lambda: _are_in_order(make, n_frames),
        "frames_are_what_the_sensors_say": lambda: _are_as_told(make, n_frames),
        "frames_are_read_only": lambda: _are_read_only(make, n_frames),
        "same_frames_each_time": lambda: _are_the_same(make, n_frames),
        "close_ends_the_frames": lambda: _ends_when_closed(make),
        "truth_spans_the_frames": lambda: _has_truth(make),
        "a_stopped_robot_stands": lambda: _stands(make),
        **source_truth_checks(make, n_frames),
    }


@contextmanager
def _start_source(make: Callable[[], FrameSource]) -> Iterator[FrameSource]:
    source = make()
    source.start(Session("source"))
    try:
        yield source
    finally:
        source.close()


def _knows_its_sensors(make: Callable[[], FrameSource]) -> None:
    with _start_source(make) as source:
        assert source.sensors, "it has no sensors"
        for name, info in source.sensors.items():
            assert info.name == name, f"the sensor under {name!r} calls itself {info.name!r}"


def _are_in_order(make: Callable[[], FrameSource], n_frames: int) -> None:
    last: dict[str, float] = {}
    newest_s = -np.inf
    with _start_source(make) as source:
        for frame in islice(source.frames(), n_frames):
            assert source.is_live or frame.stamp_s >= newest_s, (
                f"{frame.sensor!r} at {frame.stamp_s} s comes after {newest_s} s"
            )
            newest_s = frame.stamp_s
            assert frame.stamp_s > last.get(frame.sensor, -np.inf), (
                f"two frames of {frame.sensor!r} at {frame.stamp_s} s: readings of one instant are one frame"
            )
            last[frame.sensor] = frame.stamp_s
    assert last, "it gives no frame"


def _are_as_told(make: Callable[[], FrameSource], n_frames: int) -> None:
    with _start_source(make) as source:
        for frame in islice(source.frames(), n_frames):
            assert frame.sensor in source.sensors, f"a frame of {frame.sensor!r}, which is none of its sensors"
            info = source.sensors[frame.sensor]
            kind = payload_kind(frame.payload)
            assert kind == info.kind or (kind == "record" and info.kind not in PAYLOAD_KINDS), (
                f"{frame.sensor!r} is of kind {info.kind!r} and gives {kind!r}"
            )
            size = frame.payload.size
            assert size is None or info.size is None or size == info.size, (
                f"{frame.sensor!r} is {info.size} pixels and gives {size}"
            )


def _are_read_only(make: Callable[[], FrameSource], n_frames: int) -> None:
    with _start_source(make) as source:
        for frame in islice(source.frames(), n_frames):
            writable = [array.shape for array in arrays_of(frame.payload) if array.flags.writeable]
            assert not writable, f"{frame.sensor!r} gives arrays {writable} that can be written to"


def _are_the_same(make: Callable[[], FrameSource], n_frames: int) -> None:
    if make().is_live:
        skip("a device gives other frames each time")
    with _start_source(make) as source:
        first = [bytes_of(frame) for frame in islice(source.frames(), n_frames)]
        source.close()
        source.start(Session("source"))
        again = [bytes_of(frame) for frame in islice(source.frames(), n_frames)]
    with _start_source(make) as source:
        fresh = [bytes_of(frame) for frame in islice(source.frames(), n_frames)]
    assert first == again, "started again it gives other frames"
    assert first == fresh, "a second one gives other frames"


def _ends_when_closed(make: Callable[[], FrameSource]) -> None:
    with _start_source(make) as source:
        frames = source.frames()
        next(frames)
        source.close()
        left = sum(1 for _ in islice(frames, 3))
    assert left <= 1, "closed, it goes on giving frames"


def _has_truth(make: Callable[[], FrameSource]) -> None:
    with _start_source(make) as source:
        stamps = [frame.stamp_s for frame in islice(source.frames(), 20)]
        truth = source.ground_truth()
    if truth is None or len(truth) == 0:
        skip("it knows no truth")
    assert truth.stamps_s[0] <= stamps[-1], f"truth begins at {truth.stamps_s[0]} s, after the frames"
    assert truth.stamps_s[-1] >= stamps[0], f"truth ends at {truth.stamps_s[-1]} s, before the frames"


def _stands(make: Callable[[], FrameSource]) -> None:
    with _start_source(make) as source:
        if not isinstance(source, Drivable):
            skip("it is no robot")
        assert Stop in source.accepts, "every robot takes Stop"
        if source.drives_itself:
            skip("it drives itself")
        for index, _ in enumerate(source.frames()):
            source.drive(Stop("checked"))
            if index == _STANDING_FRAMES:
                break
        truth = source.ground_truth()
    if truth is None:
        skip("it knows no truth")
    moved_m = truth[-1][1].distance_to(truth[-min(10, len(truth))][1])
    assert moved_m <= _STANDING_M, f"told to stop for {_STANDING_FRAMES} frames it still moved by {moved_m:.2g} m"
