"""With whom a noisy motion votes: it may agree with each of two that contradict each other, but better with one.

Of hypotheses that believe as many motions, the one whose motions agree best among themselves is the most probable. What
they have said since the question came up counts, so a lie that goes on is decided, however little each second says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from trailmark.estimation.kalman.agreement import Tolerance, disagreement_within, whole_motions
from trailmark.estimation.kalman.diagnosis import RivalFilter

__all__ = ["with_votes"]

# Motion alone says no more than this of two hypotheses: absolute estimates must be able to overturn it.
_MOST = 9.0


def with_votes(rivals: Sequence[RivalFilter], tolerance: Tolerance) -> list[RivalFilter]:
    """Return hypotheses with what motion says of them until now, in place of what it said before.

    Parameters
    ----------
    rivals : sequence of RivalFilter
        The hypotheses of a question.
    tolerance : Tolerance
        By how much honest localizers differ.
    """
    nis_of: list[tuple[int, float]] = []
    for rival in rivals:
        state, begun = rival.state, rival.begun
        believed = [source for source in state.diagnosis.sums if source not in state.diagnosis.faults]
        nis = 0.0
        if begun is not None and len(believed) > 1:
            if len(whole_motions(state, begun, believed)) < len(believed):
                return list(rivals)  # one tells of this instant later
            nis = disagreement_within(state, begun, believed, tolerance)
        nis_of.append((len(believed), nis))
    best: dict[int, float] = {}
    for n_believed, nis in nis_of:
        best[n_believed] = min(nis, best.get(n_believed, nis))
    voted = []
    for rival, (n_believed, nis) in zip(rivals, nis_of):
        log_votes = max(0.5 * (best[n_believed] - nis), -_MOST)
        log_weight = rival.log_weight + log_votes - rival.log_votes
        voted.append(replace(rival, log_weight=log_weight, log_votes=log_votes))
    return voted
