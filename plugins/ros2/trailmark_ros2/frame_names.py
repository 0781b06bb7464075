"""Which frames the messages of one topic are of."""

from __future__ import annotations

from typing import Any

from trailmark.errors import SourceError

__all__ = ["FrameNames"]

#: So many messages of one writer in a row that are of other frames are no mistake: it has begun anew.
_N_BELIEVED = 5


class FrameNames:
    """Tells when messages are of other frames than those before: their numbers are of another origin or place.

    Attributes
    ----------
    frame_id, child_frame_id : str
        Frames of the messages that count; empty before the first, and where they say none.
    """

    def __init__(self) -> None:
        self.frame_id = self.child_frame_id = ""
        self._writer: int | None = None
        self._others = ("", "")
        self._n_others = 0

    def note_message(self, message: Any, writer: int) -> bool:
        """Take note of a message; return whether its frames are others from now on.

        Those of another writer count at once, those of the same one after a few in a row.

        Raises
        ------
        SourceError
            If it is of other frames, and does not count.
        """
        now = str(message.header.frame_id).lstrip("/"), str(getattr(message, "child_frame_id", "")).lstrip("/")
        known = self.frame_id, self.child_frame_id
        differing = [pair for pair in zip(now, known, strict=True) if all(pair) and pair[0] != pair[1]]
        if differing and writer == self._writer:
            self._n_others = self._n_others + 1 if now == self._others else 1
            self._others = now
            if self._n_others < _N_BELIEVED:
                name, before = differing[0]
                raise SourceError(f"its frame is {name!r}, and that of the messages before it was {before!r}")
        if differing:
            known = ("", "")
        self._writer, self._n_others = writer, 0
        self.frame_id, self.child_frame_id = known[0] or now[0], known[1] or now[1]
        return bool(differing)
