"""With whom a noisy motion votes: it may agree with each of two that contradict each other, but better with one.

Of hypotheses that believe as many motions, the one whose motions agree best among themselves is the most probable. What
they have said since the question came up counts, so a lie that goes on is decided, however little each second says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from trailmark.estimation.kalman.agreement import Tolerance, disagreement_within, motion_since, whole_motions
from trailmark.estimation.kalman.diagnosis import RivalFilter
from trailmark.estimation.kalman.windows import WINDOW_S

__all__ = ["with_votes"]

# Motion alone says no more than this of two hypotheses: absolute estimates must be able to overturn it.
_MOST = 9.0


def with_votes(
    rivals: Sequence[RivalFilter], tolerance: Tolerance, before: Sequence[RivalFilter] = ()
) -> list[RivalFilter]:
    """Return hypotheses with what motion says of them until now, in place of what it said before.

    Parameters
    ----------
    rivals : sequence of RivalFilter
        The hypotheses of a question.
    tolerance : Tolerance
        By how much honest localizers differ.
    before : sequence of RivalFilter
        The same hypotheses a moment ago, if there were any: who has told of all since then is not late.
    """
    judged = _judged(rivals, before)
    if judged is None:
        return list(rivals)
    sides: list[tuple[tuple[int, int], float]] = []
    for rival in rivals:
        faults, nis = rival.state.diagnosis.faults, 0.0
        believed = [source for source in judged if source not in faults]
        if rival.begun is not None:
            nis = disagreement_within(rival.state, rival.begun, believed, tolerance)
        n_believed = sum(source not in faults for source in rival.state.diagnosis.sums)
        sides.append(((n_believed, len(believed)), nis))
    best: dict[tuple[int, int], float] = {}
    for size, nis in sides:
        best[size] = min(nis, best.get(size, nis))
    voted = []
    for rival, (size, nis) in zip(rivals, sides):
        log_votes = max(0.5 * (best[size] - nis), -_MOST)
        log_weight = rival.log_weight + log_votes - rival.log_votes
        voted.append(replace(rival, log_weight=log_weight, log_votes=log_votes))
    return voted


def _judged(rivals: Sequence[RivalFilter], before: Sequence[RivalFilter]) -> list[str] | None:
    """Return who has told of all of the question in every hypothesis; None while one that votes is a step late.

    A localizer that is silent, or was for a part of the question, does not vote: it would hold up all other votes.
    """
    sources = [s for s in rivals[0].state.diagnosis.sums if any(s not in r.state.diagnosis.faults for r in rivals)]
    judged = sources
    for rival in rivals:
        if rival.begun is None:
            continue
        whole = whole_motions(rival.state, rival.begun, sources)
        missing = [source for source in sources if source not in whole]
        if any(_is_late(rival, before, source) for source in missing):
            return None
        judged = [source for source in judged if source in whole]
    return judged


def _is_late(rival: RivalFilter, before: Sequence[RivalFilter], source: str) -> bool:
    """Return whether a localizer will tell of this instant later: neither is it silent, nor is what it misses past."""
    state, begun = rival.state, rival.begun
    motion = None if begun is None else motion_since(state, begun, source)
    if begun is None or motion is None or state.stamp_s - begun.stamp_s - motion.covered_s > WINDOW_S:
        return False
    return not before or source not in whole_motions(state, before[0].state, [source])
