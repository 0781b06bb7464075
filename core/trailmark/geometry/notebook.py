"""What notebooks ask for: tables of pandas and axes of pyplot, both loaded on first use."""

from __future__ import annotations

from importlib import import_module
from typing import Any

__all__ = ["pandas_module", "plane_axes"]


def pandas_module() -> Any:
    """Return pandas, which nothing else here needs.

    Raises
    ------
    ImportError
        If it is not installed; the message says how it comes.
    """
    try:
        return import_module("pandas")
    except ImportError as error:
        raise ImportError("to_frame needs pandas, which is not installed: pip install 'trailmark[notebook]'") from error


def plane_axes(axes: Any) -> Any:
    """Return axes with equal scales and names: those that are given, or the current ones of pyplot."""
    if axes is None:
        axes = import_module("matplotlib.pyplot").gca()
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    return axes
