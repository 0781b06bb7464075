"""Forward against reverse: the paper says that its vehicle deviated more when it drove back (Sec. IV-C, Fig. 12)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trailmark_papers.kit import Table
from trailmark_papers.nagai2015.playback import Playback

__all__ = ["add_directions"]

#: Where it stands at first it drives neither way.
_FEWEST = 6


def add_directions(table: Table, found: Sequence[Playback]) -> None:
    """Add the offsets at the searches, forward and reverse, of playbacks that drove one way or both."""
    for direction, way in ((1, "forward"), (-1, "reverse")):
        offsets_mm = 1e3 * np.concatenate([playback.offsets_m(direction) for playback in found])
        if len(offsets_mm) >= _FEWEST:
            n = len(offsets_mm)
            table.add(f"offset at the searches, {way}, mean", "mm", float(offsets_mm.mean()), n=n)
            table.add(f"offset at the searches, {way}, max", "mm", float(offsets_mm.max()), n=n)
