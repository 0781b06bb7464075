"""The figures of the paper, redrawn from our runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from trailmark.arrays import Float32s, Floats
from trailmark.geometry import Trajectory
from trailmark.report.drawing import BLUE, MUTED, RED
from trailmark_papers.kit import panels

if TYPE_CHECKING:
    from trailmark_papers.perroni2014.drives import Deviation

__all__ = ["draw_clutter", "draw_corners", "draw_likelihood", "draw_shifts", "draw_ways"]

_LEFT, _RIGHT, _NONE = BLUE, RED, MUTED
#: A way without an answer that is longer than this is a gap in a line [m].
_SILENCE_M = 0.25


def draw_ways(path: Path, ways: Mapping[float, Sequence[Deviation]]) -> None:
    """Draw Fig. 5: offset over station, all seeds of every start."""
    with panels(path, 3.4, "offset from the taught way, left is up [m]", xlabel="way [m]") as (figure, (axes,)):
        for turned_deg, several in ways.items():
            colour = _LEFT if turned_deg > 0 else _RIGHT
            width = 0.4 + abs(turned_deg) / 8.0
            for k, way in enumerate(several):
                thin = slice(None, None, 10)
                label = f"{turned_deg:+g}°" if k == 0 else None
                axes.plot(
                    way.stations_m[thin], way.lateral_m[thin], color=colour, linewidth=width, alpha=0.5, label=label
                )
        axes.axhline(0.0, color=_NONE, linewidth=1.0, linestyle="dotted")
        figure.legend(loc="outside lower center", ncols=6)


def draw_corners(path: Path, taught: Trajectory, ways: Sequence[Deviation]) -> None:
    """Draw the taught way with its corners, and the offsets of all replays."""
    titles = ("the taught way [m]", "offset from it, left is up [m]")
    with panels(path, 5.6, *titles, xlabel="way [m]") as (_, (above, below)):
        above.plot(*taught.positions[::10].T, color=_NONE)
        above.set_aspect("equal", adjustable="datalim")
        for way in ways:
            below.plot(way.stations_m[::10], way.lateral_m[::10], color=_LEFT, linewidth=0.8, alpha=0.6)


def draw_shifts(path: Path, drives: Mapping[float, Mapping[str, Floats]]) -> None:
    """Draw Fig. 3 or 4: said and true shift over the way.

    Parameters
    ----------
    drives : mapping
        For each start [deg]: ``station``, ``said`` and ``true``, (N,) each [m, columns, columns].
    """
    title = "shift, to the right is up; dotted: true median displacement [columns]"
    with panels(path, 3.6, title, xlabel="way [m]") as (figure, (axes,)):
        for turned_deg, drive in drives.items():
            colour = _NONE if turned_deg == 0.0 else _LEFT if turned_deg > 0.0 else _RIGHT
            label = f"{turned_deg:+g}°" if turned_deg else "0°"
            axes.plot(*_break_at_gaps(drive["station"], drive["said"]), color=colour, linewidth=1.2, label=label)
            axes.plot(drive["station"], drive["true"], color=colour, linewidth=1.0, linestyle="dotted")
        figure.legend(loc="outside lower center", ncols=3)


def _break_at_gaps(stations_m: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Break a line where nothing was said for a while: a line across would look like answers."""
    silent = np.flatnonzero(np.diff(stations_m) > _SILENCE_M) + 1
    return np.insert(stations_m, silent, np.nan), np.insert(values, silent, np.nan)


def draw_likelihood(path: Path, maps: Mapping[str, Floats], paths: Mapping[str, Floats], reach: int) -> None:
    """Draw Fig. 1: the likelihood of every shift over the sequence, and the shift that was selected.

    Parameters
    ----------
    maps : mapping of str to (N, 2 reach + 1) float64
        Likelihood of each shift.
    paths : mapping of str to (N,) float64
        The selected shift [columns].
    reach : int
        Largest shift [columns].
    """
    titles = [f"{name} [columns]" for name in maps]
    with panels(path, 4.6, *titles, xlabel="change vector") as (_, rows):
        for axes, (name, likelihood) in zip(rows, maps.items(), strict=True):
            extent = (0, len(likelihood), -reach - 0.5, reach + 0.5)
            dark, bright = np.percentile(likelihood, (2.0, 99.5)).tolist()
            grey = {"cmap": "gray", "vmin": dark, "vmax": bright, "interpolation": "nearest"}
            axes.imshow(likelihood.T, origin="lower", aspect="auto", extent=extent, **grey)
            axes.plot(paths[name], color=_RIGHT, linewidth=1.4)
            axes.grid(visible=False)


def draw_clutter(path: Path, pictures: Mapping[str, Float32s]) -> None:
    """Draw Fig. 2: change images before and in a turn."""
    with panels(path, 4.4, *pictures) as (_, rows):
        for axes, picture in zip(rows, pictures.values(), strict=True):
            axes.imshow(picture, cmap="gray", vmin=0.0, vmax=0.6, interpolation="nearest")
            axes.grid(visible=False)
            axes.set_xticks([])
            axes.set_yticks([])
