"""Which of several writers of one topic is listened to."""

from __future__ import annotations

__all__ = ["WriterChoice"]

#: A writer that was not heard for so long has left the topic to the others [s].
_GONE_S = 3.0


class WriterChoice:
    """Tells the messages of one writer from those of others on its topic.

    A program that is started again is another writer, and counts at its first message. One message of the one before
    may come late; where it speaks twice, there are two programs: the one that was heard first counts, until it has been
    silent for a while.

    Attributes
    ----------
    is_contested : bool
        Whether two writers speak at once.
    """

    def __init__(self) -> None:
        self.is_contested = False
        self._current: int | None = None
        self._heard_s: dict[int, float] = {}  # in the order in which they were first heard
        self._spoke_once: set[int] = set()  # others, since the current one took over

    def counts(self, writer: int, came_s: float) -> bool:
        """Return whether a message counts.

        Parameters
        ----------
        writer : int
            Who wrote it.
        came_s : float
            When it came, in monotonic time [s].
        """
        is_new = writer not in self._heard_s
        self._heard_s[writer] = came_s
        self._heard_s = {other: heard_s for other, heard_s in self._heard_s.items() if came_s - heard_s <= _GONE_S}
        if len(self._heard_s) == 1:
            self.is_contested = False
        if writer != self._current and not self.is_contested:
            if is_new or len(self._heard_s) == 1:
                self._current, self._spoke_once = writer, set()
            else:
                self.is_contested = writer in self._spoke_once
                self._spoke_once.add(writer)
        if self.is_contested:
            self._current = next(iter(self._heard_s))
        return writer == self._current
