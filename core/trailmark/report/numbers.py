"""Numbers as people read them: three digits, and one unit for a whole column."""

from __future__ import annotations

import math
from collections.abc import Iterable

__all__ = ["MISSING", "count_text", "length_unit", "percent_text", "significant"]

MISSING = "\u2013"  # an en dash

_SMALL_M = 0.1
#: Below it `significant` shows metres by an exponent; above it a column stays in metres whatever else is in it.
_TINY_M, _LARGE_M = 1e-4, 100.0
#: Less is rounding.
_DUST_M = 1e-6


def significant(value: float | None, digits: int = 3) -> str:
    """Return a number with three digits, more before the point, without an exponent unless it is tiny."""
    if value is None or math.isnan(value):
        return MISSING
    if value == 0.0 or math.isinf(value):
        return f"{value:.0f}"
    magnitude = math.floor(math.log10(abs(value)))
    if magnitude < -digits - 1:
        return f"{value:.1e}"
    rounded = round(value, max(0, digits - 1 - magnitude))
    magnitude = math.floor(math.log10(abs(rounded)))  # 9.996 becomes 10.0, not 10.00
    return f"{rounded:.{max(0, digits - 1 - magnitude)}f}"


def percent_text(fraction: float | None) -> str:
    """Return a share in percent; never 100 when a little is missing, never 0 when there is a little."""
    if fraction is None or math.isnan(fraction):
        return MISSING
    percent = 100.0 * fraction
    if 99.95 <= percent < 100.0 - 1e-9:
        return ">99.9"
    if 1e-9 < percent < 0.05:
        return "<0.1"
    return f"{percent:.1f}"


def count_text(value: int | None) -> str:
    """Return a count."""
    return MISSING if value is None else str(value)


def length_unit(values_m: Iterable[float | None]) -> tuple[str, float]:
    """Return the unit for the lengths of a column and how many of it make a metre.

    It is ``mm`` where most are below 0.1 m, and where one is so small that metres would show it by an exponent, unless
    another is 100 m or more.
    """
    known = sorted(abs(value) for value in values_m if value is not None and math.isfinite(value))
    if not known:
        return "m", 1.0
    is_tiny = known[-1] < _LARGE_M and any(_DUST_M < value < _TINY_M for value in known)
    if is_tiny or known[len(known) // 2] < _SMALL_M:
        return "mm", 1000.0
    return "m", 1.0
