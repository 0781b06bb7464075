"""Config of the sink that writes lines of JSON."""

from __future__ import annotations

from typing import Literal

from trailmark.config import OutputPath, PluginConfig

__all__ = ["JsonlConfig"]


class JsonlConfig(PluginConfig):
    """One JSON object a line, for a program that listens or a file to look into."""

    to: Literal["stdout", "stderr"] | OutputPath = "stdout"
    """Standard output, standard error, or a file, which is overwritten."""
    beliefs: bool = True
    """A line for the belief after every frame."""
    estimates: bool = False
    """A line for every estimate and what became of it."""
    commands: bool = True
    """A line for every command."""
