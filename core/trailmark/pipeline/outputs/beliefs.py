"""What was believed, and how surely: a table that stays small however long a run is."""

from __future__ import annotations

from collections.abc import Sequence

from trailmark.estimates import Belief

__all__ = ["BELIEF_COLUMNS", "BeliefLog", "beliefs_text"]

#: Columns of ``beliefs.csv``: the pose in the map and its covariance [m, m, rad].
BELIEF_COLUMNS = ("stamp_s", "x", "y", "theta", "cov_xx", "cov_xy", "cov_xt", "cov_yy", "cov_yt", "cov_tt")

_N_KEPT = 2000


class BeliefLog:
    """Keeps a thousand to two thousand beliefs, evenly over a run.

    When there is one too many every second is let go, and only half as many are taken from then on. Of several beliefs
    of one stamp, as where two sensors read at once, the last counts: it knows what all of them said.
    """

    def __init__(self) -> None:
        self._kept: list[Belief] = []
        self._stride = 1
        self._n_seen = 0
        self._stamp_s: float | None = None

    def add(self, belief: Belief) -> None:
        """Add a belief; one without pose or covariance is left out."""
        if belief.pose_map_base is None or belief.covariance is None:
            return
        if belief.stamp_s == self._stamp_s:
            if self._kept[-1].stamp_s == belief.stamp_s:
                self._kept[-1] = belief
            return
        self._stamp_s = belief.stamp_s
        if self._n_seen % self._stride == 0:
            self._kept.append(belief)
        self._n_seen += 1
        if len(self._kept) > _N_KEPT:
            self._kept, self._stride = self._kept[::2], 2 * self._stride

    def text(self) -> str:
        """Return the table as CSV; empty when nothing was believed with a covariance."""
        return beliefs_text(self._kept) if self._kept else ""


def beliefs_text(beliefs: Sequence[Belief]) -> str:
    """Return ``beliefs.csv`` of beliefs that have a pose and a covariance."""
    lines = [",".join(BELIEF_COLUMNS)]
    lines += [",".join(repr(value) for value in _row(belief)) for belief in beliefs]
    return "\n".join(lines) + "\n"


def _row(belief: Belief) -> list[float]:
    assert belief.pose_map_base is not None
    assert belief.covariance is not None
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = belief.covariance.tolist()
    pose: list[float] = belief.pose_map_base.array().tolist()
    return [float(belief.stamp_s), *pose, xx, xy, xt, yy, yt, tt]
