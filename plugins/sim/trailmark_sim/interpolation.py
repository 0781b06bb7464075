"""Between four neighbours: the one formula that floors, photographs and the sky are read with."""

from __future__ import annotations

from typing import Any

from trailmark.kernels import inlined_kernel

__all__ = ["between"]


@inlined_kernel
def between(a: Any, b: Any, c: Any, d: Any, u: Any, v: Any) -> Any:
    """Return the value between `a` and `b` above and `c` and `d` below, `u` to the right and `v` down, from 0 to 1.

    At whole places it is the neighbour itself, to the bit. Where light is added up, in `render`, four weights are used.
    """
    above, below = a + (b - a) * u, c + (d - c) * u
    return above + (below - above) * v
