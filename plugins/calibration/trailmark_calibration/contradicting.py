"""Whether parts of a drive contradict each other: its two halves, slow turns and fast ones, slow ways and fast ones."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.errors import DataError
from trailmark_calibration.fitting import Fit, KnownPlacement, fit_from, weights_of
from trailmark_calibration.model import DELAY, TURN, TURN_PER_M, WAY, YAW, MotionPairs
from trailmark_calibration.rigid import log_of

__all__ = ["HALVES", "Contradiction", "contradictions_of_rates", "find_contradictions", "worse_of"]

#: What is compared, in words.
HALVES, _TURNS, _WAYS = "the halves of the drive", "slow and fast turns", "slow and fast ways"
#: So many sigmas apart, two parts contradict each other.
_APART = 4.0
#: Shares of what tells a scale that lie in slow intervals: where wheels begin to slip, nobody knows.
_SHARES = (0.2, 0.5)
#: What slips with each; a place or a delay does not change with speed.
_SLIPPING = {_TURNS: (TURN,), _WAYS: (WAY, TURN_PER_M)}
#: Fewer intervals are no part of a drive.
_LEAST_PAIRS = 10


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Two parts of a drive that tell a number otherwise.

    Attributes
    ----------
    parts : str
        Which they are, in words.
    sigmas : float
        How far apart they are, in their common standard deviation.
    apart : float
        How far the farther one is from the whole drive, in the unit of the number.
    """

    parts: str
    sigmas: float
    apart: float


def find_contradictions(parts: str, fits: Sequence[Fit], whole: Fit) -> dict[int, Contradiction]:
    """Return the numbers that two parts of a drive tell, and not as one, by index.

    Parameters
    ----------
    parts : str
        Which they are, in words.
    fits : sequence of Fit
        One for each of both.
    whole : Fit
        Of the whole drive.
    """
    found = {}
    for index in np.flatnonzero(fits[0].is_told & fits[1].is_told & whole.is_told).tolist():
        off = _difference(fits[0].values[index], fits[1].values[index], index)
        sigmas = off / math.hypot(fits[0].sigmas[index], fits[1].sigmas[index])
        if sigmas > _APART:
            farther = max(_difference(one.values[index], whole.values[index], index) for one in fits)
            found[index] = Contradiction(parts, float(sigmas), farther)
    return found


def contradictions_of_rates(pairs: MotionPairs, known: KnownPlacement, whole: Fit) -> dict[int, Contradiction]:
    """Return the scales on which slow and fast intervals contradict each other, by index.

    Wheels that slip in fast turns alone do so in both halves of a drive.

    Parameters
    ----------
    pairs : MotionPairs
        The motions.
    known : KnownPlacement
        What is known before.
    whole : Fit
        Of the whole drive.
    """
    found: dict[int, Contradiction] = {}
    delay_s = float(whole.values[DELAY]) if whole.is_told[DELAY] else None
    for parts, is_slow, is_fast in _splits(pairs, whole):
        try:
            fits = [fit_from(pairs.where(rows), known, delay_s) for rows in (is_slow, is_fast)]
        except DataError:
            continue
        for index, one in find_contradictions(parts, fits, whole).items():
            if index in _SLIPPING[parts]:
                found[index] = worse_of(one, found.get(index, one))
    return found


def worse_of(one: Contradiction, other: Contradiction) -> Contradiction:
    """Return the surer of two contradictions on a number, as far apart as the farther one."""
    surer = max(one, other, key=lambda each: each.sigmas)
    return replace(surer, apart=max(one.apart, other.apart))


def _splits(pairs: MotionPairs, whole: Fit) -> Iterator[tuple[str, Bools, Bools]]:
    """Return slow and fast intervals, of turns and of ways, by what a should have said.

    That is the mean of both by their noise, which tells nothing of their difference: intervals that are chosen by the
    rates of one alone are those in which its noise is large, and what is left is no longer nothing on average.
    """
    _, _, base = weights_of(pairs, whole.values, whole.spread)
    rates = np.abs(log_of(base)) / (pairs.to_s - pairs.from_s)[:, None]
    kinds = [(_TURNS, rates[:, 2])]
    if pairs.a.measures_way and pairs.b.measures_way:
        kinds.append((_WAYS, rates[:, 0]))
    for (parts, of_kind), share in product(kinds, _SHARES):
        limit = _limit_of(of_kind, share)
        is_slow, is_fast = np.asarray(of_kind < limit), np.asarray(of_kind >= limit)
        if min(is_slow.sum(), is_fast.sum()) >= _LEAST_PAIRS:
            yield parts, is_slow, is_fast


def _limit_of(rates: Floats, share: float) -> float:
    """Return the rate below which lies a share of what tells a scale: of the squares of rates."""
    squares = np.sort(np.nan_to_num(rates) ** 2)
    told = np.cumsum(squares)
    return math.sqrt(squares[np.searchsorted(told, share * told[-1])])


def _difference(a: float, b: float, index: int) -> float:
    return abs(math.remainder(a - b, 2.0 * math.pi)) if index == YAW else abs(a - b)
