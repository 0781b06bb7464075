"""Faults of time: frames that are lost, late, or the same again."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydantic import Field

from trailmark.config import PluginConfig
from trailmark.frames import Frame, Payload
from trailmark.interfaces import Fault, Session
from trailmark_faults.span import TimeSpanConfig

__all__ = ["FrameLoss", "Frozen", "FrozenConfig", "Jitter", "JitterConfig", "Repeated", "RepeatedConfig"]


class FrameLoss:
    """Decides which frames are lost: each by itself, or in runs.

    Runs are a chain of two states, left with the chances that give share and length.

    Parameters
    ----------
    share : float
        Of the frames that are lost.
    in_a_row : float or None
        How many are lost at a time, on average; None: each by itself.
    """

    def __init__(self, share: float, in_a_row: float | None) -> None:
        self._share, self._in_a_row = share, in_a_row
        self._was_lost = False

    def loses(self, rng: np.random.Generator) -> bool:
        """Return whether the next frame is lost; one number is drawn in any case."""
        share, run = self._share, self._in_a_row
        chance = rng.random()  # even for a share of 0: the noise of a frame does not depend on what is dropped
        if run is None or not share:
            return bool(chance < share)
        self._was_lost = bool(chance >= 1.0 / run if self._was_lost else chance < share / (run * (1.0 - share)))
        return self._was_lost


class FrozenConfig(TimeSpanConfig):
    """A driver that hangs: the last reading again and again, with new stamps."""


class Frozen(Fault):
    """Gives the last reading before the time that it hangs; stamps go on."""

    config: FrozenConfig

    def start(self, session: Session) -> None:
        """Forget the reading of the run before."""
        self._last: Payload | None = None
        self._n = 0

    def counters(self) -> Mapping[str, int]:
        """Return how many frames were ``frozen``."""
        return {"frozen": self._n} if self._n else {}

    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame:
        """Return the frame, or its stamp with the last reading."""
        hangs = self.config.includes(since_s)
        if not hangs or self._last is None:
            self._last = frame.payload
            return frame
        self._n += 1
        return Frame(frame.sensor, frame.stamp_s, self._last)


class RepeatedConfig(PluginConfig):
    """Readings that come twice: the second time with the stamp of the one that they take the place of."""

    share: float = Field(default=0.1, ge=0, lt=1)
    """Share of the readings that are the one before again."""


class Repeated(Fault):
    """Gives the reading before again, now and then."""

    config: RepeatedConfig

    def start(self, session: Session) -> None:
        """Forget the reading of the run before."""
        self._last: Payload | None = None
        self._n = 0

    def counters(self) -> Mapping[str, int]:
        """Return how many frames were ``repeated``."""
        return {"repeated": self._n} if self._n else {}

    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame:
        """Return the frame, or its stamp with what the frame before held."""
        before, self._last = self._last, frame.payload
        if before is None or rng.random() >= self.config.share:
            return frame
        self._n += 1
        return Frame(frame.sensor, frame.stamp_s, before)


class JitterConfig(PluginConfig):
    """Stamps that say when a frame arrived, and it took now shorter, now longer."""

    mean_ms: float = Field(default=5.0, gt=0)
    """How long, on average; exponentially distributed [ms]."""


class Jitter(Fault):
    """Delays frames by times of their own; where one overtakes another, it comes first."""

    config: JitterConfig

    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame:
        """Return the frame with a later stamp."""
        return Frame(frame.sensor, frame.stamp_s + self.config.mean_ms / 1e3 * rng.exponential(), frame.payload)
