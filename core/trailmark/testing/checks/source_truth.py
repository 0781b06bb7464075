"""What a source claims against what it gives: rates, turn rates beside its truth, frames beside those of another."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice, zip_longest

import numpy as np

from trailmark.frames import Frame, Imu
from trailmark.interfaces import FrameSource, Session
from trailmark.testing.checks.lives import arrays_of
from trailmark.testing.checks.parametrize import Check, skip

__all__ = ["bytes_of", "source_truth_checks"]

# A claimed rate is off by no more than this factor.
_RATE_OFF = 1.5
# Frames of a sensor that tell its rate, and readings of a gyroscope that tell its unit.
_LEAST = 5
# A robot that turns by less tells nothing; degrees for radians are a factor of 57 [rad/s].
_TURNS_RADPS, _UNIT_OFF = 0.05, 5.0


def source_truth_checks(make: Callable[[], FrameSource], n_frames: int) -> dict[str, Check]:
    """Return the checks by name."""
    return {
        "rates_are_as_claimed": lambda: _keeps_its_rates(make, n_frames),
        "turn_rates_are_in_radians": lambda: _turns_like_its_truth(make, n_frames),
        "two_instances_share_no_frames": lambda: _shares_no_frames(make, n_frames),
    }


def _keeps_its_rates(make: Callable[[], FrameSource], n_frames: int) -> None:
    """Check that a sensor with a rate keeps it, in the median."""
    if make().is_live:
        skip("a device may be slow here")
    source = make()
    source.start(Session("source"))
    stamps: dict[str, list[float]] = {}
    for frame in islice(source.frames(), n_frames):
        stamps.setdefault(frame.sensor, []).append(frame.stamp_s)
    claimed = {name: info.rate_hz for name, info in source.sensors.items()}
    source.close()
    told = {name: own for name, own in stamps.items() if claimed[name] and len(own) >= _LEAST}
    if not told:
        skip("no sensor says its rate and gives frames enough to tell it")
    for name, own in told.items():
        rate_hz, claim_hz = 1.0 / float(np.median(np.diff(own))), claimed[name] or 0.0
        assert claim_hz / _RATE_OFF <= rate_hz <= claim_hz * _RATE_OFF, (
            f"{name!r} says {claim_hz:g} Hz and gives {rate_hz:.3g} Hz"
        )


def _turns_like_its_truth(make: Callable[[], FrameSource], n_frames: int) -> None:
    """Check that a gyroscope turns as the true heading does; fifty times as fast is degrees."""
    source = make()
    source.start(Session("source"))
    frames = list(islice(source.frames(), n_frames))
    truth = source.ground_truth()
    source.close()
    readings = [(f.stamp_s, float(f.payload.angular_velocity_radps[2])) for f in frames if isinstance(f.payload, Imu)]
    if truth is None or len(truth) < 2 or len(readings) < _LEAST:
        skip("it has no gyroscope, or knows no truth")
    inside = [one for one in readings if truth.stamps_s[0] <= one[0] <= truth.stamps_s[-1]]
    stamps_s = np.array([stamp_s for stamp_s, _ in inside])
    rates = np.gradient(np.unwrap(truth.headings), truth.stamps_s)
    true_radps = float(np.abs(np.interp(stamps_s, truth.stamps_s, rates)).mean()) if len(inside) else 0.0
    if true_radps < _TURNS_RADPS:
        skip("it hardly turns")
    told_radps = float(np.mean([abs(rate) for _, rate in inside]))
    assert told_radps <= _UNIT_OFF * true_radps, (
        f"its gyroscope turns at {told_radps:.3g} rad/s and its truth at {true_radps:.3g}: are these degrees?"
    )


def _shares_no_frames(make: Callable[[], FrameSource], n_frames: int) -> None:
    """Two instances that are read by turns give what one gives alone."""
    if make().is_live:
        skip("a device gives other frames each time")
    alone, first, second = make(), make(), make()
    try:
        alone.start(Session("source"))
        expected = [bytes_of(frame) for frame in islice(alone.frames(), n_frames)]
        alone.close()
        for one in (first, second):
            one.start(Session("source"))
        pairs = zip_longest(islice(first.frames(), n_frames), islice(second.frames(), n_frames))
        said = [(None if a is None else bytes_of(a), None if b is None else bytes_of(b)) for a, b in pairs]
    finally:
        for one in (alone, first, second):
            one.close()
    for index, told in enumerate(zip(*said)):
        assert [one for one in told if one is not None] == expected, (
            f"read by turns with another instance, the {'first' if index == 0 else 'second'} gives other frames than"
            " alone: they share state"
        )


def bytes_of(frame: Frame) -> tuple[object, ...]:
    """Return what two frames must have in common to be equal to the last bit."""
    arrays = tuple(array.tobytes() for array in arrays_of(frame.payload))
    return frame.sensor, frame.stamp_s, arrays, "" if arrays else repr(frame.payload)
