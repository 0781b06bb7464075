"""What the comparisons of motions say: of the errors of the belief, as variances, and of the localizers, in words."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from itertools import combinations
from types import MappingProxyType
from typing import NamedTuple

from trailmark.estimation.kalman.gate import SHARE_UNDECIDED
from trailmark.estimation.kalman.lasting_errors import Columns, LastingVariances
from trailmark.estimation.kalman.steady_difference import (
    NO_SCATTER,
    DifferenceEstimate,
    SteadyDifference,
    best_estimate,
)

__all__ = ["EXPLANATIONS", "KINDS", "Kind", "PartingVerdict", "effect_of", "tell"]

# Two that agree may be wrong alike: odds are 1 to 9, where they are 1 to 4 of one.
_SHARE_OF_MOST = 1.0 / 10.0
# By so many standard deviations of their difference two motions part.
_APART = 3.0


class Kind(NamedTuple):
    """One way in which motions part.

    Attributes
    ----------
    unit, per : str, float
        Of what is told, and the factor to it.
    told : float
        Less is not told: calibrations differ by as much.
    plausible : float
        A motion may be wrong by as much (one standard deviation), while few windows say anything of it.
    """

    unit: str
    per: float
    told: float
    plausible: float


_SHARE_OF_WAY = Kind("% of the way", 100.0, 0.015, 0.05)
_VELOCITY = Kind("m/s", 1.0, 0.003, 0.05)
#: By the name of the field of `LastingVariances`.
KINDS = {
    "along": _SHARE_OF_WAY,
    "aside": _SHARE_OF_WAY._replace(unit="% of the way, aside"),
    "turn": Kind("% of the turn", 100.0, 0.015, 0.05),
    "drift": Kind("deg/s", math.degrees(1.0), math.radians(0.1), math.radians(0.5)),
    "ahead": _VELOCITY,
    "left": _VELOCITY._replace(unit="m/s, aside"),
}
# Each explains the same as the other while a robot goes on as it does: by a share, or by a velocity.
EXPLANATIONS = (("along", "ahead"), ("aside", "left"), ("turn", "drift"))


def effect_of(columns: Columns, name: str) -> float:
    """Return the square of how much a unit of an error changes the pose; a metre is as much as a radian."""
    k = 3 * LastingVariances._fields.index(name)
    x, y, theta = columns[k : k + 3]
    return x * x + y * y + theta * theta


class PartingVerdict(NamedTuple):
    """What the comparisons say of one kind of error.

    Attributes
    ----------
    parts, hidden : float
        Variances: of what is seen, and of what may be there and is not seen.
    sigmas : float
        By how many standard deviations the most certain difference is not zero.
    is_told : bool
        Whether it is told.
    seen, sides
        The estimates by localizer, and who differs from whom.
    """

    parts: float = 0.0
    hidden: float = 0.0
    sigmas: float = 0.0
    is_told: bool = False
    seen: Mapping[str, DifferenceEstimate] = MappingProxyType({})
    sides: _Sides | None = None

    @classmethod
    def of(cls, name: str, differences: Mapping[str, SteadyDifference], sources: Collection[str]) -> PartingVerdict:
        """Return it for one kind of error."""
        kind, known = KINDS[name], [source for source in sources if source in differences]
        if len(known) < 2:
            return cls()
        # The belief is one of them, or between them: what the second best tells of it is what is known.
        second = sorted(known, key=lambda source: differences[source].unseen)[1]
        unseen, prior = differences[second].unseen, kind.plausible**2
        hidden = SHARE_UNDECIDED * (prior if unseen == math.inf else prior * unseen / (prior + unseen))
        seen = {source: one for source in known if (one := best_estimate(differences[source])) is not None}
        if len(seen) < 2:
            return cls(hidden=hidden)
        sides = _sides(seen)
        share = _SHARE_OF_MOST if sides.is_belief_of_most else SHARE_UNDECIDED
        are_apart = _sigmas(*(seen[source] for source in sides.pair)) > _APART or second not in seen
        parts = share * (max(one.counts for one in seen.values()) if are_apart else seen[second].counts) ** 2
        sigmas = max(abs(one.value) / (one.sigma + NO_SCATTER) for one in seen.values())
        is_told = any(one.is_sure and abs(one.value) > kind.told for one in seen.values())
        return cls(parts, hidden, sigmas, is_told, seen, sides)


class _Sides(NamedTuple):
    """The two that differ most surely, who of them is outvoted, and whether the belief is with the others then."""

    pair: tuple[str, str]
    outvoted: str | None = None
    is_belief_of_most: bool = False


def _sides(seen: Mapping[str, DifferenceEstimate]) -> _Sides:
    one, other = max(combinations(seen, 2), key=lambda pair: _sigmas(seen[pair[0]], seen[pair[1]]))
    n = {one: 1, other: 1}
    for voter in seen.keys() - n.keys():
        for near, far in ((one, other), (other, one)):
            if _sigmas(seen[voter], seen[near]) < _APART < _sigmas(seen[voter], seen[far]):
                n[near] += 1
    outvoted = one if n[one] == 1 < n[other] else other if n[other] == 1 < n[one] else None
    if outvoted is None:
        return _Sides((one, other))
    ally = other if outvoted == one else one
    return _Sides((one, other), outvoted, abs(seen[ally].value) < abs(seen[outvoted].value))


def _sigmas(one: DifferenceEstimate, other: DifferenceEstimate) -> float:
    return abs(one.value - other.value) / (math.hypot(one.sigma, other.sigma) + NO_SCATTER)


def tell(told: dict[str, str], verdict: PartingVerdict, kind: Kind) -> None:
    """Add in words who disagrees."""
    seen, sides = verdict.seen, verdict.sides
    assert sides is not None
    less, more = sorted(sides.pair, key=lambda source: seen[source].value)
    apart = kind.per * (seen[more].value - seen[less].value)
    reason = f"{less} and {more} disagree by {apart:.{3 if kind.unit.startswith('m/s') else 1}f} {kind.unit}, steadily"
    if sides.outvoted is not None:
        ally = more if sides.outvoted == less else less
        told.setdefault(sides.outvoted, f"{reason}: others agree with {ally}, and the belief covers both")
        return
    for source in sides.pair:
        told.setdefault(source, f"{reason}: nothing decides, and the belief covers both")
