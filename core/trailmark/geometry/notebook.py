"""What notebooks ask for: tables of pandas and axes of pyplot, both loaded on first use, and a sketch of a way."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from trailmark.arrays import Floats

__all__ = ["pandas_module", "plane_axes", "way_svg"]

#: Longer side of a sketch, and the most points that one has [px].
_SKETCH_PX, _SKETCH_POINTS = 180.0, 400


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


def way_svg(positions: Floats) -> str:
    """Return a sketch of a way as SVG, x to the right and y up, with a dot where it starts; empty for no positions.

    Parameters
    ----------
    positions : (N, 2) float64
        Positions along the way [m]. A long way is thinned: the SVG has at most 400 points.
    """
    if not len(positions):
        return ""
    kept = np.linspace(0, len(positions) - 1, min(len(positions), _SKETCH_POINTS)).astype(int)
    corner = np.array([positions[:, 0].min(), positions[:, 1].max()])
    offset = np.abs(positions[kept] - corner)
    extent = max(float(offset.max()), 1e-9)
    points = offset * (_SKETCH_PX / extent) + 5.0
    width, height = points.max(axis=0) + 5.0
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    start = f'<circle cx="{points[0, 0]:.1f}" cy="{points[0, 1]:.1f}" r="3" fill="currentColor"/>'
    style = 'fill="none" stroke="currentColor" stroke-width="1.5"'
    return f'<svg width="{width:.0f}" height="{height:.0f}" {style}><polyline points="{line}"/>{start}</svg>'
