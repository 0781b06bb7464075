"""Whether a calibration holds: fitted to one half of the drive, tried on the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import DataError
from trailmark_calibration.clocks import ClockDrift, find_drift
from trailmark_calibration.contradicting import (
    HALVES,
    Contradiction,
    contradictions_of_rates,
    find_contradictions,
    worse_of,
)
from trailmark_calibration.fitting import PRIOR, Fit, KnownPlacement, fit, values_of_all
from trailmark_calibration.model import DELAY, NAMES, NEUTRAL, YAW, MotionPairs, X, Y
from trailmark_calibration.rivals import Rival, find_rival, widened_by

__all__ = ["STRETCH_S", "Calibration", "HalvesCheck", "calibrate", "neutral_values", "told_values"]

#: Errors are of stretches of this length [s].
STRETCH_S = 5.0


@dataclass(frozen=True, slots=True)
class HalvesCheck:
    """Errors of stretches of `STRETCH_S` in the half of the drive to which the numbers were not fitted.

    Attributes
    ----------
    before, after : (float, float)
        Median error of place and heading with the numbers of the config, and with those of the other half, all that was
        not asked for being as found in both [m, rad].
    n : int
        Stretches.
    """

    before: tuple[float, float]
    after: tuple[float, float]
    n: int


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """What a drive says, and how far that can be believed.

    Attributes
    ----------
    fit : Fit
        Of the whole drive; wider where parts of it contradict each other.
    check : HalvesCheck or None
        None where a half of the drive does not tell by itself what the whole drive does.
    contradictions : mapping of int to Contradiction
        Numbers on which parts of the drive disagree, by index: those parts that do so most surely.
    rival : Rival or None
        What else explains the drive.
    drift : ClockDrift or None
        That the delay changes on the way: then it is as unknown as before the drive.
    """

    fit: Fit
    check: HalvesCheck | None
    contradictions: dict[int, Contradiction]
    rival: Rival | None = None
    drift: ClockDrift | None = None


def calibrate(pairs: MotionPairs, known: KnownPlacement, asked: Sequence[int]) -> Calibration:
    """Fit the numbers to the whole drive and to parts of it: its halves, slow intervals and fast ones.

    Parameters
    ----------
    pairs : MotionPairs
        The motions.
    known : KnownPlacement
        What is known before.
    asked : sequence of int
        The numbers that are asked for, as indices into `model.NAMES`.

    Raises
    ------
    DataError
        If the two localizers do not move as one body.
    """
    whole = fit(pairs, known)
    rival = find_rival(pairs, known, whole)
    drift = find_drift(pairs, whole) if whole.is_told[DELAY] and rival is None else None
    if rival is not None:
        whole = widened_by(whole, rival.apart)
    if drift is not None:
        unknown = np.zeros(len(NAMES))
        unknown[DELAY] = max(PRIOR[DELAY], drift.least_s)  # a delay that moves, nobody knows how far
        whole = widened_by(whole, unknown)
    check, contradictions = _try_on_halves(pairs, known, whole, asked)
    for index, one in contradictions_of_rates(pairs, known, whole).items():
        contradictions[index] = worse_of(one, contradictions.get(index, one))
    apart = np.zeros(len(NAMES))
    for index, one in contradictions.items():
        apart[index] = one.apart
    whole = widened_by(whole, apart)
    if check is None:  # only what is left out may have made them agree
        off = np.abs(values_of_all(pairs, whole) - whole.values)
        whole = widened_by(whole, np.where(whole.is_told, np.hypot(off, whole.sigmas), 0.0))
    return Calibration(whole, check, contradictions, rival, drift)


def _try_on_halves(
    pairs: MotionPairs, known: KnownPlacement, whole: Fit, asked: Sequence[int]
) -> tuple[HalvesCheck | None, dict[int, Contradiction]]:
    """Return how far the numbers of one half of the drive hold on the other, and what the halves contradict on."""
    middle_s = float(np.median(pairs.from_s))
    halves = [pairs.where(pairs.from_s < middle_s), pairs.where(pairs.from_s >= middle_s)]
    try:
        fits = [fit(half, known) for half in halves]
    except DataError:
        return None, {}
    contradictions = find_contradictions(HALVES, fits, whole)
    is_asked = np.isin(np.arange(len(NAMES)), asked) & whole.is_told
    is_checked = all(bool(one.is_told[is_asked].all()) for one in fits)
    # What the whole drive does not tell, its halves do not either: they may have found one answer of several.
    fits = [widened_by(one, np.where(whole.is_told, 0.0, whole.sigmas)) for one in fits]
    return _check_halves(halves, fits, known, asked) if is_checked else None, contradictions


def told_values(found: Fit, known: KnownPlacement) -> Floats:
    """Return the numbers (8,); those that the drive does not determine as they are known."""
    return np.where(found.is_told, found.values, neutral_values(known))


def _check_halves(
    halves: Sequence[MotionPairs], fits: Sequence[Fit], known: KnownPlacement, asked: Sequence[int]
) -> HalvesCheck | None:
    """Return the errors of each half with the numbers of the other."""
    before, after = [], []
    for half, found in zip(halves, reversed(fits)):
        right = told_values(found, known)
        wrong = right.copy()
        wrong[list(asked)] = neutral_values(known)[list(asked)]
        stretches = _stretches(half)
        errors = [stretches.residuals(numbers) for numbers in (wrong, right)]
        is_known = np.isfinite(errors[0]).all(axis=1) & np.isfinite(errors[1]).all(axis=1)
        before.append(errors[0][is_known])
        after.append(errors[1][is_known])
    if not sum(len(errors) for errors in before):
        return None
    return HalvesCheck(_median(np.concatenate(before)), _median(np.concatenate(after)), sum(map(len, before)))


def neutral_values(known: KnownPlacement) -> Floats:
    """Return the numbers (8,) if the config is right."""
    neutral = NEUTRAL.copy()
    neutral[[X, Y, YAW]] = known.mounting
    return neutral


def _stretches(pairs: MotionPairs) -> MotionPairs:
    """Return stretches that begin where every fifth interval begins."""
    from_s = pairs.from_s[::5]
    return replace(pairs, from_s=from_s, to_s=from_s + STRETCH_S)


def _median(errors: Floats) -> tuple[float, float]:
    return float(np.median(np.hypot(errors[:, 0], errors[:, 1]))), float(np.median(np.abs(errors[:, 2])))
