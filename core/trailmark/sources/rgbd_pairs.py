"""Pairs colour and depth while a recording is read."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

__all__ = ["RgbdPairs", "StampedMessage"]

_MAX_WAITING = 100  # pictures without a partner: the other topic has ended or is on another clock


@dataclass(frozen=True, slots=True)
class StampedMessage:
    """A message that waits for its partner.

    Attributes
    ----------
    stamp_s : float
        Its stamp [s].
    where : str
        Topic and number, for messages.
    message : object
        The message.
    """

    stamp_s: float
    where: str
    message: Any


class RgbdPairs:
    """Pairs two streams, each in order of its stamps: a colour picture with the nearest depth picture.

    Parameters
    ----------
    max_difference_s : float
        Pictures farther apart are no pair [s].
    """

    def __init__(self, max_difference_s: float) -> None:
        self.max_difference_s = max_difference_s
        self.unpaired = 0
        self._colour: deque[StampedMessage] = deque()
        self._depth: deque[StampedMessage] = deque()

    def push(self, picture: StampedMessage, is_depth: bool) -> Iterator[tuple[StampedMessage, StampedMessage]]:
        """Take a picture and yield the pairs that are certain now: depth up to the colour's stamp is known."""
        waiting = self._depth if is_depth else self._colour
        waiting.append(picture)
        if len(waiting) > _MAX_WAITING:
            waiting.popleft()
            self.unpaired += 1
        while self._colour and self._depth and self._depth[-1].stamp_s >= self._colour[0].stamp_s:
            yield from self._settle()

    def flush(self) -> Iterator[tuple[StampedMessage, StampedMessage]]:
        """Yield what is left at the end of the recording."""
        while self._colour and self._depth:
            yield from self._settle()
        self.unpaired += len(self._colour) + len(self._depth)
        self._colour.clear()
        self._depth.clear()

    def _settle(self) -> Iterator[tuple[StampedMessage, StampedMessage]]:
        """Pair the oldest colour picture, or give it up."""
        colour = self._colour.popleft()
        nearest = min(self._depth, key=lambda depth: abs(depth.stamp_s - colour.stamp_s))
        if abs(nearest.stamp_s - colour.stamp_s) > self.max_difference_s:
            self.unpaired += 1
            while self._depth and self._depth[0].stamp_s < colour.stamp_s - self.max_difference_s:
                self._depth.popleft()
                self.unpaired += 1
            return
        while (depth := self._depth.popleft()) is not nearest:
            self.unpaired += 1
        yield colour, depth
