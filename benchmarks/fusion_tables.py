"""Tables of the page of fusion, from what `fusion.py` measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["cost", "husky", "robots"]

#: Bar and stretch of the position's RMSE, for all robots and for the first [m].
_RMSE_BARS = {1: (0.26, 0.18)}
_RMSE_BAR = (0.36, 0.25)
_COLUMNS = (
    "robot",
    "clean [m] (bar, stretch)",
    "largest [m]",
    "late (bar 1.1)",
    "outliers, their max (bar 1.15)",
    "back (bar 30 s)",
    "then (bar 1.1)",
)


def robots(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a line for each robot, from the rows of its cases."""
    lines = [f"| {' | '.join(_COLUMNS)} |", "|---" * len(_COLUMNS) + "|"]
    of_robot = {number: {row["case"]: row for row in rows if row["robot"] == number} for number in _numbers(rows)}
    lines += [_robot(number, cases) for number, cases in of_robot.items()]
    return "\n".join(lines)


def _numbers(rows: Sequence[Mapping[str, Any]]) -> list[int]:
    return sorted({row["robot"] for row in rows})


def _robot(robot: int, cases: Mapping[str, Mapping[str, Any]]) -> str:
    clean = cases["clean"]
    bar, stretch = _RMSE_BARS.get(robot, _RMSE_BAR)
    late, outliers, wrong = (cases.get(case) for case in ("late", "outliers", "wrong_start"))
    ratios = outliers and [outliers[key] / clean[key] for key in ("rmse_m", "max_m")]
    cells = [
        f"R{robot}",
        f"{clean['rmse_m']:.3f} ({bar}, {stretch})",
        f"{clean['max_m']:.2f}",
        f"{late['rmse_m'] / clean['rmse_m']:.2f}" if late else "-",
        ", ".join(f"{ratio:.2f}" for ratio in ratios) if ratios else "-",
        f"{wrong['settled_s']:.0f} s" if wrong else "-",
        f"{wrong['settled_rmse_m'] / clean['rmse_m']:.2f}" if wrong else "-",
    ]
    return f"| {' | '.join(cells)} |"


def husky(ends: Mapping[str, float]) -> str:
    """Return where the Husky ends."""
    return f"It ends {ends['from_expected_m']:.2f} m from there (bar 0.5 m, stretch 0.25 m)."


def cost(found: Mapping[str, float]) -> str:
    """Return what estimates cost."""
    rows = (
        ("a motion, in order", "motion_us", 50, 20),
        ("a fix, in order", "fix_us", 50, 20),
        ("an estimate that is replayed after a fix 2 s late", "replayed_us", 25, 15),
    )
    lines = ["| | measured | bar | stretch |", "|---|---|---|---|"]
    lines += [f"| {what} | {found[key]:.0f} us | {bar} us | {stretch} us |" for what, key, bar, stretch in rows]
    return "\n".join(lines)
