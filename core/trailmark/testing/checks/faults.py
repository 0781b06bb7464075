"""The contract of faults."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from hashlib import sha256
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from trailmark.config import PluginConfig
from trailmark.frames import RGBD, Frame, Image, Payload, Scan, SensorInfo, payload_kind
from trailmark.interfaces import Fault, Session
from trailmark.pipeline.sources.perturbing import Perturber
from trailmark.testing.checks.configs import common_checks
from trailmark.testing.checks.lives import arrays_of
from trailmark.testing.checks.parametrize import Check, parametrize
from trailmark.testing.checks.payloads import Spoil, spoil
from trailmark.testing.room import room_run
from trailmark.testing.runs import imu_run, landmark_run, light_run, odometry_run

if TYPE_CHECKING:
    import pytest

__all__ = ["fault_checks", "parametrize_with_fault_checks"]

_N_FRAMES = 8
_BESIDE = "beside"


def parametrize_with_fault_checks(
    fault: type[Fault], *, config: PluginConfig, expected_failures: Mapping[str, str] | None = None
) -> pytest.MarkDecorator:
    """Parametrize a test over the contract of faults; the test takes ``check`` and calls it.

    Parameters
    ----------
    fault : type
        The class.
    config : PluginConfig
        Its config, with which it does something within the first second.
    expected_failures : mapping of str to str
        Checks that it is known not to pass, by name, and why.
    """
    return parametrize(fault_checks(fault, config), expected_failures)


def fault_checks(fault: type[Fault], config: PluginConfig) -> dict[str, Check]:
    """Return the checks by name; arguments as of `parametrize_with_fault_checks`."""

    def make() -> Fault:
        return fault(config)

    return common_checks(make, lambda: config) | {
        "it_does_something": lambda: _does_something(make),
        "same_seed_same_frames": lambda: _is_deterministic(make),
        "frames_are_left_alone": lambda: _leaves_frames_alone(make),
        "frames_stay_of_their_kind": lambda: _keeps_kind_and_size(make),
        "stamps_strictly_increase": lambda: _keeps_order(make),
        "other_sensors_are_left_alone": lambda: _leaves_others_alone(make),
        "black_white_and_noise_are_taken": lambda: _takes_bad_days(make),
        "starts_again": lambda: _starts_again(make),
    }


@cache
def _all_frames() -> Mapping[str, Sequence[Frame]]:
    """Return frames by sensor: every kind of payload, and pictures grey, in colour and with 16 bits."""
    runs = [room_run(kind, n_frames=_N_FRAMES) for kind in ("image", "rgbd", "scan")]
    others = [maker(n_frames=_N_FRAMES) for maker in (odometry_run, imu_run, light_run, landmark_run)]
    found = {run.frames[0].sensor: tuple(run.frames) for run in (*runs, *others)}
    colour = next(frames for frames in found.values() if isinstance(frames[0].payload, RGBD))
    for name, change in (("grey_8", _grey), ("grey_16", _deep), ("colour", _colour)):
        found[name] = tuple(Frame(name, frame.stamp_s, change(frame.payload)) for frame in colour)
    return found


def _grey(payload: Any) -> Image:
    return Image(np.ascontiguousarray(payload.bgr[:, :, 1]))


def _deep(payload: Any) -> Image:
    return Image(payload.bgr[:, :, 1].astype(np.uint16) * np.uint16(257))


def _colour(payload: Any) -> Image:
    return Image(payload.bgr)


def _fitting(make: Callable[[], Fault]) -> Mapping[str, Sequence[Frame]]:
    """Return the frames of the kinds of sensor that the fault applies to."""
    kinds = make().kinds
    frames = {
        name: frames
        for name, frames in _all_frames().items()
        if not kinds or _info(frames).kind in kinds  # a Record's kind is the source's own word
    }
    assert frames, f"it befalls sensors of kind {', '.join(sorted(kinds))}, and none is known to the checks"
    return frames


def _info(frames: Sequence[Frame]) -> SensorInfo:
    return SensorInfo(frames[0].sensor, payload_kind(frames[0].payload))


def _surviving_frames(
    make: Callable[[], Fault], frames: Sequence[Frame], others: Sequence[Frame] = (), seed: int = 0
) -> list[Frame]:
    """Return what a source with the fault gives of some frames, and of others of a sensor without the fault.

    The source has sensors of every kind: an option that changes nothing of this one changes another.
    """
    befallen = {found[0].sensor: _info(found) for found in (*_all_frames().values(), frames)}
    perturber = Perturber("checked", {"fault": make}, list(befallen))
    sensors = befallen | ({others[0].sensor: _info(others)} if others else {})
    perturber.start(Session("checked", rng=np.random.default_rng(seed)), sensors)
    try:
        merged = sorted([*frames, *others], key=lambda frame: frame.stamp_s)
        return list(perturber.frames(iter(merged)))
    finally:
        perturber.close()


def _digests(frames: Sequence[Frame]) -> list[tuple[Any, ...]]:
    """Return short digests of frames: a comparison that fails is shown in full."""
    return [(frame.sensor, frame.stamp_s, _digest(frame.payload)) for frame in frames]


def _digest(payload: Payload) -> Any:
    arrays = list(arrays_of(payload))
    return sha256(b"".join(array.tobytes() for array in arrays)).hexdigest() if arrays else payload


def _does_something(make: Callable[[], Fault]) -> None:
    for frames in _fitting(make).values():
        info = _info(frames)
        if _digests(_surviving_frames(make, frames)) != _digests(frames):
            return
        fault = make()
        fault.start(Session(sensors={info.name: info}))
        if fault.believed(info) != info:
            return
    raise AssertionError("with this config it changes no frame of any sensor")


def _is_deterministic(make: Callable[[], Fault]) -> None:
    for name, frames in _fitting(make).items():
        assert _digests(_surviving_frames(make, frames, seed=1)) == _digests(_surviving_frames(make, frames, seed=1)), (
            f"twice the same seed gives other frames of {name!r}: draw from the generators that it is given"
        )


def _starts_again(make: Callable[[], Fault]) -> None:
    for name, frames in _fitting(make).items():
        again = partial(_same, make())
        first = _digests(_surviving_frames(again, frames))
        assert _digests(_surviving_frames(again, frames)) == first, (
            f"started again it gives other frames of {name!r}: forget in start()"
        )


def _same(fault: Fault) -> Fault:
    return fault


def _leaves_frames_alone(make: Callable[[], Fault]) -> None:
    for name, shared in _fitting(make).items():
        frames = [_copy_of_frame(frame) for frame in shared]  # a fault that writes spoils no other check
        before = _digests(frames)
        _surviving_frames(make, frames)
        assert _digests(frames) == before, f"it changed a frame of {name!r} that it was given: work on a copy"


def _copy_of_frame(frame: Frame) -> Frame:
    payload: Any = frame.payload
    arrays = {name: getattr(payload, name) for name in getattr(type(payload), "__slots__", ())}
    copies = {name: np.array(array) for name, array in arrays.items() if isinstance(array, np.ndarray)}
    return Frame(frame.sensor, frame.stamp_s, replace(payload, **copies)) if copies else frame


def _keeps_kind_and_size(make: Callable[[], Fault]) -> None:
    for name, frames in _fitting(make).items():
        expected = _layout(frames[0].payload)
        for frame in _surviving_frames(make, frames):
            assert _layout(frame.payload) == expected, f"{name!r} was {expected} and became {_layout(frame.payload)}"


def _layout(payload: Payload) -> list[Any]:
    return [type(payload).__name__, *((array.shape, array.dtype.str) for array in arrays_of(payload))]


def _keeps_order(make: Callable[[], Fault]) -> None:
    for name, frames in _fitting(make).items():
        stamps = [frame.stamp_s for frame in _surviving_frames(make, frames)]
        assert all(one < other for one, other in pairwise(stamps)), f"the stamps of {name!r} do not increase: {stamps}"


def _leaves_others_alone(make: Callable[[], Fault]) -> None:
    for frames in _fitting(make).values():
        others = [Frame(_BESIDE, frame.stamp_s + 1e-3, frame.payload) for frame in frames]
        left = [frame for frame in _surviving_frames(make, frames, others) if frame.sensor == _BESIDE]
        assert len(left) == len(others), f"of {len(others)} frames of another sensor {len(left)} are left"
        assert all(one is other for one, other in zip(left, others, strict=True)), "it changed another sensor's frames"


def _takes_bad_days(make: Callable[[], Fault]) -> None:
    hows: tuple[Spoil, ...] = ("black", "white", "noise")
    for name, frames in _fitting(make).items():
        for how in hows:
            spoilt = spoil(frames[0].payload, how, np.random.default_rng(7))
            if spoilt is not None:
                given = [Frame(name, frame.stamp_s, spoilt) for frame in frames]
                for frame in _surviving_frames(make, given):
                    if isinstance(frame.payload, Scan):
                        assert not np.isinf(frame.payload.ranges_m).any(), f"a {how} scan gets infinite ranges"
