"""How much the absolute estimates of one localizer say of hypotheses that those of others contradict: one witness.

Poses of one camera err alike, however many come: who lies goes on to lie, and who speaks more often would outvote the
others by its rate. So what one localizer says against a hypothesis counts in full where another one says so, too, or
none contradicts it; else no more than suspicion does, at which the belief covers both. So does, in any case, what one
says against lying itself, where two others or more may outvote it. Who spoke until a moment ago is waited for.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from trailmark.estimation.kalman.diagnosis import RivalFilter
from trailmark.estimation.kalman.windows import WINDOW_S

__all__ = ["SUSPICION", "Testimony", "speaks_against", "with_testimony"]

#: What one witness alone, or suspicion, can say: at odds of 16 to 1 the truth is never further than 4 standard
#: deviations from the mixture, whoever is right.
SUSPICION = math.log(16.0)
# Less is said by noise.
_SAYS = 1.5
# Others are waited for so long: a window of the tests, and as long again [s].
_WAITS_S = 2.0 * WINDOW_S


class Testimony(NamedTuple):
    """What the absolute estimates of one localizer say of a hypothesis, beside the one that they speak for most.

    Attributes
    ----------
    log : float
        Log of the odds; not above 0.
    since_s : float
        Since when they have spoken against it; ``inf`` if they do not [s].
    last_s : float
        The last of them [s].
    """

    log: float = 0.0
    since_s: float = math.inf
    last_s: float = -math.inf


_SILENT = Testimony()


def with_testimony(rivals: Sequence[RivalFilter], source: str, said: Sequence[float]) -> list[RivalFilter]:
    """Return hypotheses after an absolute estimate, each witness counted as far as it does.

    Parameters
    ----------
    rivals : sequence of RivalFilter
        With the weights that they have if all witnesses count in full.
    source : str
        Whose estimate it was.
    said : sequence of float
        What it says of each, beside the one that it speaks for most: logs of odds, none above 0.
    """
    stamp_s = rivals[0].state.stamp_s
    logs = [rival.heard.get(source, _SILENT).log + log for rival, log in zip(rivals, said)]
    most = max(logs)
    heard = [
        {**rival.heard, source: _after(rival.heard.get(source, _SILENT), log - most, stamp_s)}
        for rival, log in zip(rivals, logs)
    ]
    alone = _excess_of_those_alone(rivals, heard)
    return [
        replace(rival, heard=one, log_alone=excess, log_weight=rival.log_weight + excess - rival.log_alone)
        for rival, one, excess in zip(rivals, heard, alone)
    ]


def speaks_against(said: Testimony) -> bool:
    """Return whether absolute estimates say more against a hypothesis than noise does."""
    return said.log < -_SAYS


def _after(before: Testimony, log: float, stamp_s: float) -> Testimony:
    since_s = math.inf if log > -_SAYS else min(before.since_s, stamp_s)
    return Testimony(log, since_s, stamp_s)


def _excess_of_those_alone(rivals: Sequence[RivalFilter], heard: Sequence[Mapping[str, Testimony]]) -> list[float]:
    """Return by how much the witnesses against each hypothesis say more than those may who are alone with it."""
    begun = next((rival.begun for rival in rivals if rival.begun is not None), None)
    if begun is None:
        return [0.0] * len(rivals)
    doubted = [rival.state.diagnosis.absolute_faults.keys() for rival in rivals]
    named = set().union(*doubted) - set(doubted[0]).intersection(*doubted)  # that these lie is a hypothesis
    awaited = {
        source
        for source, fix in begun.rejections.corroborations.items()
        if begun.stamp_s - fix.stamp_s < WINDOW_S and source not in named
    }
    heard_of = sorted({source for one in heard for source in one} - named)
    found = []
    for one, rival in zip(heard, rivals):
        liars = rival.state.diagnosis.absolute_faults.items()
        outvoted = [source for source, fault in liars if fault.contradicted_by]
        excess = 0.0
        for source in dict.fromkeys([*heard_of, *outvoted]):
            said = one.get(source, _SILENT)
            if -said.log > SUSPICION:
                for_most = max(heard, key=lambda other: other.get(source, _SILENT).log)
                others = (awaited | set(heard_of)) - {source}
                if source in outvoted or _is_alone(one, said, for_most, others):
                    excess += -said.log - SUSPICION
        found.append(excess)
    return found


def _is_alone(
    against: Mapping[str, Testimony], said: Testimony, favoured: Mapping[str, Testimony], others: Collection[str]
) -> bool:
    """Return whether no other witness speaks against a hypothesis as one does, and one may contradict it.

    Parameters
    ----------
    against : mapping of str to Testimony
        What all say of the hypothesis.
    said : Testimony
        What the one says of it.
    favoured : mapping of str to Testimony
        What all say of the hypothesis that this one speaks for.
    others : collection of str
        The other witnesses. Who has not been heard since may contradict it, for a while.
    """
    if any(against.get(other, _SILENT).log < -_SAYS for other in others):
        return False
    waits = said.last_s - said.since_s < _WAITS_S
    return any(
        favoured.get(other, _SILENT).log < -_SAYS or (waits and against.get(other, _SILENT).last_s < said.since_s)
        for other in others
    )
