"""What several localizers say of the motion between any two stamps.

Their intervals are cut at each other's ends. Within a shared piece each says a step, that of its constant twist. What
motions of *one* localizer say of the same time counts once (`MotionTrack`). `weighing` makes one step of several.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from trailmark.deprecation import deprecated_name
from trailmark.estimation.kalman.motion_steps import MotionStep, StatedMotion
from trailmark.estimation.kalman.motion_track import MotionTrack
from trailmark.estimation.symmetric import ZERO, Sym3

__all__ = ["MotionStep", "Motions", "StatedMotion"]


class Motions:
    """All motions of a window of time.

    Parameters
    ----------
    drift : Sym3
        Covariance of a step of 1 s that nobody measured.

    Attributes
    ----------
    n_added : int
        Grows with every motion: what was predicted with fewer is out of date.
    """

    def __init__(self, drift: Sym3 = ZERO) -> None:
        self.n_added = 0
        self._drift = drift
        self._tracks: dict[str, MotionTrack] = {}
        self._changed_since_s = math.inf
        self._asked = math.nan, math.nan, 0
        self._steps: Sequence[tuple[str, MotionStep]] = ()

    def add(self, source: str, motion: StatedMotion) -> bool:
        """Keep a motion; False if this localizer has told of the same interval already."""
        self.n_added += 1
        track = self._tracks.get(source)
        if track is None:
            # In the order of names: the sum of several steps is then the same, to the last bit, whoever came first.
            self._tracks = dict(sorted((self._tracks | {source: (track := MotionTrack(self._drift))}).items()))
        self._changed_since_s = min(self._changed_since_s, track.changed_by(motion))
        return track.add(motion)

    def take_changed_since_s(self) -> float:
        """Return since when steps have changed after the last such question; ``inf`` if nothing was told [s]."""
        changed_since_s, self._changed_since_s = self._changed_since_s, math.inf
        return changed_since_s

    def cuts(self, since_s: float, stamp_s: float) -> list[float]:
        """Return the stamps strictly inside an interval at which a motion begins or ends, in order."""
        found = [at for track in self._tracks.values() for at in track.cuts(since_s, stamp_s)]
        return sorted(set(found)) if found else found

    def steps(self, since_s: float, stamp_s: float) -> Sequence[tuple[str, MotionStep]]:
        """Return what each localizer says of an interval without cuts; empty: nobody measured it."""
        asked = since_s, stamp_s, self.n_added
        if asked != self._asked:  # the filters of a question ask one after the other
            told = [
                (source, motion)
                for source, track in self._tracks.items()
                if (motion := track.covering(since_s, stamp_s)) is not None
            ]
            if len(told) > 1:
                told = _without_guesses(told)
            self._asked, self._steps = asked, [(source, motion.between(since_s, stamp_s)) for source, motion in told]
        return self._steps

    def begins(self, source: str, since_s: float, stamp_s: float) -> bool:
        """Return whether a motion of a localizer begins where an interval without cuts does that it covers."""
        return self._tracks[source].begins(since_s, stamp_s)

    def uses(self, source: str, motion: StatedMotion) -> bool:
        """Return whether a motion that was added counts, at least for a part of its time."""
        return self._tracks[source].uses(motion)

    def n_overlaps(self) -> dict[str, int]:
        """Return how many motions had much of their time in common with another one, by localizer."""
        return {source: track.n_overlaps for source, track in self._tracks.items() if track.n_overlaps}

    def overlapping(self, since_s: float) -> list[str]:
        """Return the localizers that have told of the same time twice since a stamp."""
        return [source for source, track in self._tracks.items() if track.overlapped_s >= since_s]

    def forget(self, horizon_s: float) -> None:
        """Drop what lies before a stamp."""
        for track in self._tracks.values():
            track.forget(horizon_s)


def _without_guesses(told: list[tuple[str, StatedMotion]]) -> list[tuple[str, StatedMotion]]:
    """Return motions without guesses, where another one measures the whole way."""
    measured = [one for one in told if not one[1].origin.is_guess]
    return measured if any(motion.is_whole for _, motion in measured) else told


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"Step": MotionStep})
