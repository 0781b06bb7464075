"""What the commands that compare trajectories share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click
import numpy as np

from trailmark.cli.errors import say
from trailmark.evaluation import ALIGNMENTS
from trailmark.geometry import Trajectory, read_tum

__all__ = ["align_option", "read_way", "short_names"]

_Command = TypeVar("_Command", bound=Callable[..., Any])


def align_option(command: _Command) -> _Command:
    """Add ``--align``: how positions are laid on the truth before they are compared."""
    option = click.option(
        "--align",
        type=click.Choice(ALIGNMENTS),
        default="se2",
        show_default=True,
        help="Lay all positions on the truth, the first pose only, or nothing.",
    )
    return option(command)


def short_names(paths: Sequence[Path]) -> list[str]:
    """Return the last part of each path, without what ends a file's name; the paths where two are called the same."""
    names = [path.stem if path.is_file() else path.resolve().name for path in paths]
    return names if len(set(names)) == len(names) else [str(path) for path in paths]


def read_way(file: Path) -> Trajectory:
    """Read a trajectory in the TUM format, and warn where its quaternions stand in another order, w first."""
    way = read_tum(file)
    if len(way) and np.abs(np.sin(way.headings)).max() < 0.5 and _is_w_first(file):
        say(
            f"WARNING: {file}: read as qx qy qz qw, base rolls over while it never turns; are the quaternions written"
            " w first, qw qx qy qz? Then put w last"
        )
    return way


def _is_w_first(file: Path) -> bool:
    """Return whether quaternions turn about x alone, and over: so look turns in the plane whose w stands first.

    A mounting is no explanation, as it tips base by one angle always; a swaying camera that hangs head down turns
    about the other axes too, if little.
    """
    with file.open(encoding="utf-8") as text:  # by lines as `read_tum` sees them
        lines = [line.strip()[:2000].replace(",", " ") for line in text]
    quat_xyzw = np.array([line.split()[4:8] for line in lines if line and not line.startswith("#")], dtype=np.float64)
    x, y, z, _ = (quat_xyzw / np.linalg.norm(quat_xyzw, axis=1, keepdims=True)).T
    others = float((y * y + z * z).max())
    tilts_rad = np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0))
    least_rad = 0.05 if others < 1e-12 else 1.0
    return others < 0.01 and tilts_rad.max() > np.pi / 2 and float(np.ptp(tilts_rad)) > least_rad
