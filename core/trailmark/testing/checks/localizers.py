"""The contract of localizers."""

from __future__ import annotations

import gc
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import cycle
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from trailmark.config import PluginConfig
from trailmark.errors import StoreError, TrailmarkError
from trailmark.estimates import Estimate, Fix, Lost, Motion, PathOffset
from trailmark.frames import Frame
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Localizer
from trailmark.pipeline.teaching.localizer_maps import VersionedMap, check_format
from trailmark.testing.checks.configs import common_checks
from trailmark.testing.checks.freshness import freshness_checks
from trailmark.testing.checks.lives import (
    LocalizerCase,
    answers,
    arrays_of,
    document_of,
    spoil_frame,
    true_belief,
)
from trailmark.testing.checks.parametrize import Check, parametrize, skip
from trailmark.testing.checks.payloads import Spoil, payloads_of_other_size, spoil
from trailmark.testing.checks.timing_and_state import timing_and_state_checks
from trailmark.testing.memory_map import MemoryMap
from trailmark.testing.runs import AnyRun

if TYPE_CHECKING:
    import pytest

__all__ = ["localizer_checks", "parametrize_with_localizer_checks"]

_MEMORY_MIB = 24.0
_MOST_SIGMAS = 6.0
_HONEST_SHARE = 0.8
_CHAIN = 10
_SPOILED_FRAMES = 5


def parametrize_with_localizer_checks(
    localizer: type[Localizer],
    *,
    config: PluginConfig,
    frames: AnyRun | Callable[[], AnyRun],
    expected_failures: Mapping[str, str] | None = None,
    memory_frames: int = 10_000,
) -> pytest.MarkDecorator:
    """Parametrize a test over the contract of localizers. ::

        @parametrize_with_localizer_checks(Gyro, config=GyroConfig(), frames=imu_run())
        def test_the_contract(check):
            check()

    Parameters
    ----------
    localizer : type
        The class.
    config : PluginConfig
        Its config; sensors that it leaves open are filled in.
    frames : AnyRun or callable
        A run that it understands, as from `room_run`, `ground_run` or `odometry_run`, or what returns one: it is taught
        over it, and then asked again in replay. Everything is checked on this run, so let it be long enough to say
        something.
    expected_failures : mapping of str to str
        Checks that it is known not to pass, by name, and why.
    memory_frames : int
        Over how many frames its memory must stay bounded.
    """
    return parametrize(localizer_checks(localizer, config, frames, memory_frames), expected_failures)


def localizer_checks(
    localizer: type[Localizer], config: PluginConfig, frames: AnyRun | Callable[[], AnyRun], memory_frames: int = 10_000
) -> dict[str, Check]:
    """Return the checks by name; arguments as of `parametrize_with_localizer_checks`."""
    case = LocalizerCase(localizer, config, frames)
    spoils: tuple[Spoil, ...] = ("black", "white", "noise", "truncated")
    return common_checks(case.make, lambda: config) | {
        "starts_or_says_why": lambda: _starts_or_says_why(case),
        "says_something": lambda: _says_something(case),
        "estimates_are_well_formed": lambda: _are_well_formed(case),
        "health_is_a_line": lambda: _health_is_a_line(case),
        "errors_fit_the_information": lambda: _errors_fit(case),
        "same_seed_same_answers": lambda: _same_seed_same_answers(case),
        "started_again_is_as_new": lambda: _is_as_new(case),
        "frames_are_left_alone": lambda: _leaves_frames_alone(case),
        "finish_works_from_the_map_alone": lambda: _finishes_from_the_map(case),
        "a_map_survives_the_store": lambda: _survives_the_store(case),
        "a_map_of_a_newer_format_is_refused": lambda: _refuses_a_newer_map(case),
        **{f"{how}_frames_are_no_answer": partial(_survives_spoiled, case, how) for how in spoils},
        "another_size_is_a_typed_error": lambda: _refuses_another_size(case),
        "memory_is_bounded": lambda: _is_bounded(case, memory_frames),
        **timing_and_state_checks(case),
        **freshness_checks(case),
    }


def _starts_or_says_why(case: LocalizerCase) -> None:
    """In track and without a store it works, or refuses to start with an error of its own."""
    localizer = case.make()
    try:
        localizer.start(case.session("track", None))
    except TrailmarkError as error:
        message = str(error)
    else:
        message = "started"
        for _ in answers(localizer, case, case.frames_asked_for(), on_path=False):
            pass
    localizer.close()
    assert message.strip(), "it refuses to start in track without a store, and does not say why"


def _says_something(case: LocalizerCase) -> None:
    told = list(case.life)
    assert told, "it said nothing at all over the run, taught or replayed"
    reasons = sorted({estimate.reason for estimate in told if isinstance(estimate, Lost)})
    assert len(reasons) == 0 or any(not isinstance(one, Lost) for one in told), f"it was always lost: {reasons}"


def _are_well_formed(case: LocalizerCase) -> None:
    told = case.life
    for said in (told.taught, told.replayed):
        until_s = -np.inf
        for estimate in said:
            _is_well_formed(estimate)
            if isinstance(estimate, Motion):
                assert estimate.since_s >= until_s - 1e-9, (
                    f"motion since {estimate.since_s} s overlaps the one that ended at {until_s} s"
                )
                until_s = estimate.stamp_s


def _health_is_a_line(case: LocalizerCase) -> None:
    """Before it has seen anything and after each frame, asking for the health is safe and answers with one line."""
    with case.ready() as localizer:
        _assert_is_line(localizer.health())
        for _ in answers(localizer, case, case.frames_asked_for(), on_path=True):
            _assert_is_line(localizer.health())


def _assert_is_line(words: object) -> None:
    assert isinstance(words, str), f"health() returned {type(words).__name__}, not words"
    assert len(words.splitlines()) <= 1, f"health() returned more than one line: {words!r}"


def _is_well_formed(estimate: Estimate) -> None:
    assert np.isfinite(estimate.stamp_s), f"the stamp of {estimate} is not finite"
    if isinstance(estimate, Lost):
        assert estimate.reason.strip(), "Lost without a reason"
        return
    numbers = _numbers(estimate)
    assert np.isfinite(numbers).all(), f"{estimate} is not finite: say Lost"
    information = estimate.information
    assert np.isfinite(information).all(), f"the information of {estimate} is not finite"
    scale = max(float(np.abs(information).max()), 1e-300)
    assert np.abs(information - information.T).max() <= 1e-9 * scale, f"the information of {estimate} is not symmetric"
    lowest = float(np.linalg.eigvalsh(information)[0])
    assert lowest >= -1e-9 * scale, f"the information of {estimate} has the negative eigenvalue {lowest:.3g}"


def _numbers(estimate: Motion | Fix | PathOffset) -> Any:
    match estimate:
        case Motion():
            return estimate.pose_since_now.array()
        case Fix():
            return estimate.pose_map_base.array()
        case PathOffset():
            return np.array([estimate.station_m, estimate.lateral_m, estimate.heading_rad])


def _errors_fit(case: LocalizerCase) -> None:
    """Most errors are such as the information leads one to expect: few further out than six sigmas.

    Motions are judged ten in a row: what jitters from frame to frame and cancels does no harm.
    """
    told = case.life
    sigmas = [_sigmas_off(case, one) for one in told if isinstance(one, Fix | PathOffset)]
    for said in (told.taught, told.replayed):
        sigmas += [_chain_sigmas_off(case, chain) for chain in _chains(said)]
    if not sigmas:
        skip("it said nothing that has an error: see says_something")
    share = float(np.mean(np.array(sigmas) <= _MOST_SIGMAS))
    assert share >= _HONEST_SHARE, (
        f"only {share:.0%} of {len(sigmas)} estimates are within {_MOST_SIGMAS:g} of their own sigmas of the truth "
        f"(median {np.median(sigmas):.1f}): the information promises too much"
    )


def _chains(said: Sequence[Estimate]) -> Iterator[list[Motion]]:
    """Yield motions that follow each other without a gap, ten in a row, or fewer at an end."""
    chain: list[Motion] = []
    for motion in said:
        if not isinstance(motion, Motion):
            continue
        follows = bool(chain) and math.isclose(motion.since_s, chain[-1].stamp_s)
        if chain and (not follows or len(chain) == _CHAIN):
            yield chain
            chain = []
        chain.append(motion)
    if chain:
        yield chain


def _chain_sigmas_off(case: LocalizerCase, chain: list[Motion]) -> float:
    """Return how many sigmas motions in a row are off together; directions that are not measured count nothing."""
    pose, covariance = Pose2(), np.zeros((3, 3))
    for motion in chain:
        pose = pose @ motion.pose_since_now
        back = motion.pose_since_now.inverse().adjoint()
        step = np.linalg.pinv(motion.information, hermitian=True)
        covariance = back @ covariance @ back.T + step
    true = _true_pose(case.run, chain[0].since_s).between(_true_pose(case.run, chain[-1].stamp_s))
    error = np.array(true.between(pose).log())
    if any(np.linalg.matrix_rank(motion.information, hermitian=True) < 3 for motion in chain):
        return float(np.sqrt(max(error @ np.linalg.pinv(covariance, hermitian=True) @ error, 0.0)))
    return float(np.sqrt(error @ np.linalg.solve(covariance, error)))


def _sigmas_off(case: LocalizerCase, estimate: Fix | PathOffset) -> float:
    pose = _true_pose(case.run, estimate.stamp_s)
    if isinstance(estimate, Fix):
        true = pose.array()
    else:
        place = case.path.locate(pose)
        true = np.array([place.station_m, place.lateral_m, place.heading_rad])
    error = _numbers(estimate) - true
    error[2] = wrap_angle(float(error[2]))
    return float(np.sqrt(max(error @ estimate.information @ error, 0.0)))


def _true_pose(run: AnyRun, stamp_s: float) -> Pose2:
    stamps = run.truth.stamps_s
    return run.truth.at([min(max(stamp_s, float(stamps[0])), float(stamps[-1]))])[0][1]


def _same_seed_same_answers(case: LocalizerCase) -> None:
    _assert_same(case.run_life(), case.life, "two runs with the same seed")


def _is_as_new(case: LocalizerCase) -> None:
    localizer = case.make()
    case.run_life(localizer)
    _assert_same(case.run_life(localizer), case.life, "a localizer started again and a fresh one")


def _assert_same(one: Any, other: Any, what: str) -> None:
    before, after = [document_of(said) for said in one], [document_of(said) for said in other]
    assert len(before) == len(after), f"{what}: {len(before)} and {len(after)} estimates"
    different = next((index for index, pair in enumerate(zip(before, after)) if pair[0] != pair[1]), None)
    assert different is None, f"{what} differ first in estimate {different}: {before[different]}, {after[different]}"


def _leaves_frames_alone(case: LocalizerCase) -> None:
    frames = tuple(case.frames_asked_for())
    kept = [[np.array(array) for array in arrays_of(frame.payload)] for frame in frames]
    frozen = LocalizerCase(case.localizer, case.config, _Replayed(frames, case.run))
    frozen.run_life()
    for frame, before in zip(frames, kept):
        for array, copy in zip(arrays_of(frame.payload), before):
            assert np.array_equal(array, copy, equal_nan=array.dtype.kind == "f"), (
                f"the frame of {frame.sensor!r} at {frame.stamp_s} s was changed: work on a copy"
            )


class _Replayed:
    """A run whose frames are held, so that they can be looked at afterwards."""

    def __init__(self, frames: tuple[Frame, ...], run: AnyRun) -> None:
        self.frames, self.sensors, self.truth = frames, run.sensors, run.truth


def _finishes_from_the_map(case: LocalizerCase) -> None:
    """Check that another process can finish a teaching that was cut short, and that finishing twice changes nothing."""
    _skip_without_a_map(case)
    other = MemoryMap()
    localizer = case.make()
    localizer.start(case.session("teach", other))
    for _ in answers(localizer, case, case.frames_asked_for(), on_path=False):
        pass
    localizer.close()
    for _ in range(2):
        another = case.make()
        another.start(case.session("teach", other))
        another.finish()
        another.close()
    _assert_same(case.life.replayed, case.replay(other), "finished at once, and finished later, twice:")


def _survives_the_store(case: LocalizerCase) -> None:
    _skip_without_a_map(case)
    with case.store() as reopen:
        _assert_same(case.life.replayed, case.replay(reopen().localizer_map("checked")), "from memory and from a file")


def _skip_without_a_map(case: LocalizerCase) -> None:
    if case.taught_map().is_empty:
        skip("it remembers nothing")


def _refuses_a_newer_map(case: LocalizerCase) -> None:
    """Check that its map stores its format, and that the pipeline starts it on no newer one."""
    _skip_without_a_map(case)
    localizer_map, localizer = case.taught_map(), case.make()
    own = localizer.map_format
    assert isinstance(own, int), f"map_format is {own!r}, not a whole number"
    assert own >= 1, f"map_format is {own}: formats count from 1"
    check_format(localizer_map, "checked", localizer)
    newer = MemoryMap()
    VersionedMap(newer, own + 1).save("map", {})
    try:
        check_format(newer, "checked", localizer)
    except StoreError as error:
        story = str(error)
    else:
        raise AssertionError(f"a map of format {own + 1} is taken, and it reads up to {own}")
    assert str(own + 1) in story, f"refusing a newer map it does not name the format: {story}"


def _survives_spoiled(case: LocalizerCase, how: Spoil) -> None:
    """Pictures with nothing in them give no answer; with any picture, every answer is well formed, and it goes on."""
    rng = np.random.default_rng(0)
    frames = list(case.frames_asked_for())
    if spoil(frames[0].payload, how, rng) is None:
        skip("no sensor of the run gives pictures or ranges")
    middle = len(frames) // 2
    with case.ready() as localizer:
        for index, frame in enumerate(frames):
            is_spoiled = middle <= index < middle + _SPOILED_FRAMES
            shown = spoil_frame(frame, spoil(frame.payload, how, rng)) if is_spoiled else frame
            for estimate in localizer.observe(shown, true_belief(case.run, frame.stamp_s, case.path)):
                _is_well_formed(estimate)
                if is_spoiled and how in ("black", "white") and index > middle:
                    assert isinstance(estimate, Lost), f"a {how} picture gave {estimate}"


def _refuses_another_size(case: LocalizerCase) -> None:
    frames = list(case.frames_asked_for())
    others = payloads_of_other_size(frames[0].payload)
    if not others:
        skip("no sensor of the run gives pictures or ranges")
    for number in range(len(others)):
        with case.ready() as localizer:
            for frame in frames[:3]:
                localizer.observe(frame, true_belief(case.run, frame.stamp_s, case.path))
            frame = frames[3]
            try:
                said = localizer.observe(
                    spoil_frame(frame, payloads_of_other_size(frame.payload)[number]),
                    true_belief(case.run, frame.stamp_s, case.path),
                )
            except TrailmarkError:
                continue
            for estimate in said:
                _is_well_formed(estimate)


def _is_bounded(case: LocalizerCase, n_frames: int) -> None:
    """Past its first tenth, a long replay takes no more memory."""
    if not FilePath("/proc/self/statm").exists():
        skip("memory is measured on Linux only")
    with case.ready() as localizer:
        warm, before_mib = n_frames // 10, 0.0
        for index, frame in enumerate(_endless(case)):
            if index == warm:
                before_mib = _resident_mib()
            if index == n_frames:
                break
            localizer.observe(frame, true_belief(case.run, frame.stamp_s, case.path))
        grown_mib = _resident_mib() - before_mib
    assert grown_mib <= _MEMORY_MIB, f"{n_frames - warm} frames took {grown_mib:.0f} MiB and kept them"


def _endless(case: LocalizerCase) -> Iterator[Frame]:
    """Yield the run's frames again and again, at stamps that go on."""
    frames = list(case.frames_asked_for())
    span_s = frames[-1].stamp_s - frames[0].stamp_s + 0.1
    for index, frame in enumerate(cycle(frames)):
        yield replace(frame, stamp_s=frame.stamp_s + index // len(frames) * span_s)


def _resident_mib() -> float:
    gc.collect()
    pages = int(FilePath("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20
