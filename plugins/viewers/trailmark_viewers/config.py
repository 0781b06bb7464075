"""Configs of the sinks for viewers."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from trailmark.config import OutputPath, PluginConfig

__all__ = ["FoxgloveConfig", "RerunConfig"]


class _ViewerConfig(PluginConfig):
    """What every viewer takes."""

    pictures: Literal["jpeg", "raw", "none"] = "jpeg"
    """How pictures are written; 16-bit ones and depth always raw, unless none."""
    jpeg_quality: int = Field(default=80, ge=1, le=100)
    """Of JPEG pictures."""


class FoxgloveConfig(_ViewerConfig):
    """A run for Foxglove, in its own message schemas."""

    path: OutputPath | None = None
    """An MCAP file to write; an older one is replaced."""
    live: bool = False
    """Let Foxglove connect while the run goes on: ws://HOST:PORT."""
    host: str = "127.0.0.1"
    """Where to listen; 0.0.0.0 lets other machines connect."""
    port: int = Field(default=8765, ge=0, le=65535)
    """Where to listen; 0: any port that is free."""

    @model_validator(mode="after")
    def _goes_somewhere(self) -> Self:
        if self.path is None and not self.live:
            raise ValueError("say path: run.mcap, or live: true, or both: it would go nowhere")
        return self


class RerunConfig(_ViewerConfig):
    """A run for Rerun, as its own archetypes."""

    path: OutputPath | None = None
    """A recording (.rrd) to write; an older one is replaced."""
    live: bool = False
    """Send it, while the run goes on, to the viewer that listens at HOST:PORT."""
    spawn: bool = False
    """Open a viewer on this machine for it, or take the one that listens at PORT already."""
    host: str = "127.0.0.1"
    """Where the viewer is."""
    port: int = Field(default=9876, ge=1, le=65535)
    """Where the viewer listens."""

    @model_validator(mode="after")
    def _goes_somewhere(self) -> Self:
        if self.path is None and not (self.live or self.spawn):
            raise ValueError("say path: run.rrd, or live: true, or spawn: true: it would go nowhere")
        if self.spawn and self.host not in ("127.0.0.1", "localhost"):
            raise ValueError(f"spawn opens a viewer on this machine, not on {self.host!r}: leave out one of the two")
        return self
