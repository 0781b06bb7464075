"""Checks of stamps, of information that says nothing, and of two localizers at once."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Thread

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Estimate, Fix, Motion, PathOffset
from trailmark.evaluation.association import poses_at
from trailmark.evaluation.relative import between
from trailmark.geometry import wrap_angles
from trailmark.interfaces import Localizer
from trailmark.testing.checks.lives import LocalizerCase, answers, document_of, true_belief
from trailmark.testing.checks.parametrize import Check, skip
from trailmark.testing.memory_map import MemoryMap
from trailmark.testing.runs import AnyRun

__all__ = ["timing_and_state_checks"]

# Delays that are tried, to both sides [s].
_SHIFTS_S = np.arange(-300, 301, 5) * 1e-3
_LATE_S = 0.015
# The truth of another instant must explain the estimates so much better: rounding alone does not.
_EXPLAINED = 0.25
# A drive is uneven when its speed or its turn rate varies by this share of its mean.
_UNEVEN = 0.25
_LEAST = 10
# Sigmas that are so many times the errors are too humble; simulated readings that are not exact have errors in plenty.
_HUMBLEST = 30.0
# Frames that the second of two instances is behind.
_LAG = 3


def timing_and_state_checks(case: LocalizerCase) -> dict[str, Check]:
    """Return the checks by name."""
    return {
        "stamps_are_those_of_the_frames": lambda: _stamps_are_those_of_the_frames(case),
        "information_says_something": lambda: _information_says_something(case),
        "two_instances_share_no_state": lambda: _share_no_state(case),
        "two_instances_work_in_two_threads": lambda: _work_in_two_threads(case),
    }


def _stamps_are_those_of_the_frames(case: LocalizerCase) -> None:
    """No other instant explains what was said of motion and place much better than the one that was stated.

    At constant speed and turn every instant explains it alike, so the drive has to be uneven.
    """
    if not _is_uneven(case.run):
        skip("the drive is even, so that late stamps do not show: use trailmark.testing.uneven")
    told = list(case.life)
    motions = [one for one in told if isinstance(one, Motion)]
    fixes = [one for one in told if isinstance(one, Fix)]
    for name, misses in (("motions", _motion_misses(case.run, motions)), ("fixes", _fix_misses(case.run, fixes))):
        if misses is None:
            continue
        stated, best = misses[len(_SHIFTS_S) // 2], int(np.argmin(misses))
        late_s = -float(_SHIFTS_S[best])
        assert abs(late_s) < _LATE_S or misses[best] > _EXPLAINED * stated, (
            f"its {name} are those of {1e3 * abs(late_s):.0f} ms {'before' if late_s > 0 else 'after'} their stamps:"
            " an estimate is about the stamp of the frame"
        )


def _motion_misses(run: AnyRun, motions: Sequence[Motion]) -> Floats | None:
    """Return the mean square error of motions when the truth is taken from other instants, (S,)."""
    if len(motions) < _LEAST:
        return None
    measured = np.array([np.diag(one.information) > 0.0 for one in motions])
    return _mean_squares([_errors_of_motions(run, motions, shift) for shift in _SHIFTS_S], measured)


def _fix_misses(run: AnyRun, fixes: Sequence[Fix]) -> Floats | None:
    if len(fixes) < _LEAST:
        return None
    measured = np.array([np.diag(one.information) > 0.0 for one in fixes])
    return _mean_squares([_errors_of_fixes(run, fixes, shift) for shift in _SHIFTS_S], measured)


def _errors_of_motions(run: AnyRun, motions: Sequence[Motion], shift_s: float) -> Floats:
    said = np.array([one.pose_since_now.array() for one in motions])
    since, now = (np.array([getattr(one, name) for one in motions]) + shift_s for name in ("since_s", "stamp_s"))
    return np.asarray(said - between(_true(run, since), _true(run, now)))


def _errors_of_fixes(run: AnyRun, fixes: Sequence[Fix], shift_s: float) -> Floats:
    said = np.array([one.pose_map_base.array() for one in fixes])
    return np.asarray(said - _true(run, np.array([one.stamp_s for one in fixes]) + shift_s))


def _mean_squares(errors: list[Floats], measured: Floats) -> Floats | None:
    """Return the mean over what every shift knows; None where that is too little."""
    stacked = np.array(errors)
    stacked[..., 2] = wrap_angles(np.nan_to_num(stacked[..., 2])) + 0.0 * stacked[..., 2]
    known = np.isfinite(stacked).all(axis=(0, 2))
    if known.sum() < _LEAST:
        return None
    return np.asarray((stacked[:, known] ** 2 * measured[known]).sum(axis=2).mean(axis=1))


def _true(run: AnyRun, stamps_s: Floats) -> Floats:
    return poses_at(run.truth, stamps_s, np.inf)


def _is_uneven(run: AnyRun) -> bool:
    truth = run.truth
    if len(truth) < _LEAST:
        return False
    dt_s = np.diff(truth.stamps_s)
    speeds = np.linalg.norm(np.diff(truth.positions, axis=0), axis=1) / dt_s
    turns = np.diff(np.unwrap(truth.headings)) / dt_s
    return any(float(rates.std()) > _UNEVEN * max(float(np.abs(rates).mean()), 1e-3) for rates in (speeds, turns))


def _information_says_something(case: LocalizerCase) -> None:
    """Check that the claimed covariance is smaller than that of the whole drive."""
    told = [one for one in case.life if isinstance(one, Motion | Fix | PathOffset)]
    if not told:
        skip("it said nothing that has information: see says_something")
    diagonal = np.array([np.diag(one.information) for one in told])
    length_m = case.run.truth.length_m()
    for name, unit, own, most in (
        ("position", "m", diagonal[:, :2], length_m),
        ("heading", "rad", diagonal[:, 2:], np.pi),
    ):
        sigmas = 1.0 / np.sqrt(own[own > 0.0])  # as if the other numbers were known: it is not wider than that
        assert not len(sigmas) or np.median(sigmas) <= most, (
            f"its sigma of the {name} is {np.median(sigmas):.3g} {unit} on a drive of {length_m:.2g} m:"
            " the information promises nothing (is it a covariance?)"
        )
    if getattr(case.run, "noise", None):  # else errors may be as small as they are, and sigmas of real readings right
        _is_not_too_humble(case.run, told)


def _is_not_too_humble(run: AnyRun, told: Sequence[Estimate]) -> None:
    """Check that errors are not far smaller than their sigmas, where readings have a noise that is known."""
    motions = [one for one in told if isinstance(one, Motion)]
    fixes = [one for one in told if isinstance(one, Fix)]
    for name, said, errors in (
        ("motions", motions, _errors_of_motions(run, motions, 0.0) if len(motions) >= _LEAST else None),
        ("fixes", fixes, _errors_of_fixes(run, fixes, 0.0) if len(fixes) >= _LEAST else None),
    ):
        if errors is None:
            continue
        errors[:, 2] = wrap_angles(errors[:, 2])
        information = np.array([np.diag(one.information) for one in said])
        squares = (errors**2 * information)[(information > 0.0) & np.isfinite(errors)]
        assert not len(squares) or squares.mean() > _HUMBLEST**-2, (
            f"the sigmas of its {name} are {1.0 / np.sqrt(max(squares.mean(), 1e-12)):.0f} times its errors, though the"
            " noise of its readings is known: who fuses it hardly hears it"
        )


def _share_no_state(case: LocalizerCase) -> None:
    """Two instances asked by turns, the second a few frames behind, say what each says alone."""
    frames = list(case.frames_asked_for())
    alone = [document_of(one) for one in case.life.taught]
    first, second = _ready(case), _ready(case)
    said: tuple[list[Estimate], list[Estimate]] = ([], [])
    for index in range(len(frames) + _LAG):
        for localizer, into, own in ((first, said[0], index), (second, said[1], index - _LAG)):
            if 0 <= own < len(frames):
                into += localizer.observe(frames[own], true_belief(case.run, frames[own].stamp_s))
    for localizer, told in zip((first, second), said, strict=True):
        localizer.close()
        assert [document_of(one) for one in told] == alone, (
            "two instances that work by turns say something else than one alone: they share state"
        )


def _work_in_two_threads(case: LocalizerCase) -> None:
    """Two instances that work at the same time in two threads say what one says alone."""
    alone = [document_of(one) for one in case.life.taught]
    found: dict[int, list[object] | BaseException] = {}

    def work(index: int, localizer: Localizer) -> None:
        try:
            found[index] = [document_of(one) for one in _estimates_over(case, localizer)]
        except BaseException as error:  # told below, in the test's own thread
            found[index] = error

    threads = [Thread(target=work, args=(index, _ready(case)), daemon=True) for index in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=300.0)
    for index in range(2):
        said = found.get(index)
        assert not isinstance(said, BaseException), f"in a thread of its own it raised {said!r}"
        assert said == alone, "two instances in two threads say something else than one alone: they share state"


def _ready(case: LocalizerCase) -> Localizer:
    """Return a localizer that has started to teach; in every mode a run begins like that."""
    localizer = case.make()
    localizer.start(case.session("teach", MemoryMap()))
    return localizer


def _estimates_over(case: LocalizerCase, localizer: Localizer) -> list[Estimate]:
    said = list(answers(localizer, case, case.frames_asked_for(), on_path=False))
    localizer.close()
    return said
