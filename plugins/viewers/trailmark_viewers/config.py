"""Configs of the sinks for viewers."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from trailmark.config import OutputPath, PluginConfig

__all__ = ["FoxgloveConfig"]


class FoxgloveConfig(PluginConfig):
    """A run for Foxglove, in its own message schemas."""

    path: OutputPath | None = None
    """An MCAP file to write; an older one is replaced."""
    live: bool = False
    """Let Foxglove connect while the run goes on: ws://HOST:PORT."""
    host: str = "127.0.0.1"
    """Where to listen; 0.0.0.0 lets other machines connect."""
    port: int = Field(default=8765, ge=0, le=65535)
    """Where to listen; 0: any port that is free."""
    pictures: Literal["jpeg", "raw", "none"] = "jpeg"
    """How pictures are written; 16-bit ones and depth always raw, unless none."""
    jpeg_quality: int = Field(default=80, ge=1, le=100)
    """Of JPEG pictures."""

    @model_validator(mode="after")
    def _goes_somewhere(self) -> Self:
        if self.path is None and not self.live:
            raise ValueError("say path: run.mcap, or live: true, or both: it would go nowhere")
        return self
