"""Where frames wait for a localizer that is busy."""

from __future__ import annotations

from trailmark.estimates import Belief
from trailmark.frames import Frame
from trailmark.pipeline.instruments import Counters

__all__ = ["MOST_WAITING", "Mailbox"]

#: So many frames wait for a localizer that asks for all.
MOST_WAITING = 256
#: A frame, and what was believed at its stamp.
Letter = tuple[Frame, Belief]


class Mailbox:
    """Keeps the newest frame of each sensor: a busy localizer that took them all would answer about ever older ones.

    Parameters
    ----------
    keeps_all : bool
        Whether all frames wait, up to `MOST_WAITING`; then the oldest gives way.
    """

    def __init__(self, keeps_all: bool = False) -> None:
        self._letters: dict[object, Letter] = {}  # in order of stamps
        self._keeps_all = keeps_all
        self._n_put = 0

    def __len__(self) -> int:
        return len(self._letters)

    def put(self, frame: Frame, belief: Belief) -> bool:
        """Leave a frame; returns whether it took the place of an older one."""
        self._n_put += 1
        key: object = self._n_put if self._keeps_all else frame.sensor
        is_overwritten = self._letters.pop(key, None) is not None
        if len(self._letters) >= MOST_WAITING:
            self.take()
            is_overwritten = True
        self._letters[key] = (frame, belief)
        return is_overwritten

    def take(self) -> Letter | None:
        """Take the oldest frame out; None if there is none."""
        if not self._letters:
            return None
        return self._letters.pop(next(iter(self._letters)))

    def give_up(self, counters: Counters, name: str) -> None:
        """Throw away what waits, and count it as ``localizer.NAME.given_up``."""
        if self._letters:
            counters[f"localizer.{name}.given_up"] += len(self._letters)
        self._letters.clear()
