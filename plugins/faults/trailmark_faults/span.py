"""A fault that is there for a time."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from trailmark.config import PluginConfig

__all__ = ["TimeSpanConfig"]


class TimeSpanConfig(PluginConfig):
    """When a fault begins and ends."""

    from_s: float = Field(default=0.0, ge=0)
    """From when on, since the first frame [s]."""
    to_s: float | None = None
    """Until when; left out: for ever [s]."""

    @model_validator(mode="after")
    def _ends_after_it_begins(self) -> Self:
        if self.to_s is not None and self.to_s <= self.from_s:
            raise ValueError(f"to_s must be after from_s: {self.to_s:g} is not after {self.from_s:g}")
        return self

    def includes(self, since_s: float) -> bool:
        """Return whether the fault is there at a time.

        Parameters
        ----------
        since_s : float
            Time since the first frame [s].

        Returns
        -------
        bool
            True from `from_s` on, and until `to_s`.
        """
        return since_s >= self.from_s and (self.to_s is None or since_s < self.to_s)
