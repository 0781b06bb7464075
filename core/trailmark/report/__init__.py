"""The report of a run: plots, a page that stands alone, tables for the terminal."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trailmark.report.console import run_table, summary_rows
    from trailmark.report.write import write_report

__all__ = ["run_table", "summary_rows", "write_report"]

_LAZY = {
    "run_table": "trailmark.report.console",
    "summary_rows": "trailmark.report.console",
    "write_report": "trailmark.report.write",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'trailmark.report' has no attribute {name!r}")
    return getattr(import_module(_LAZY[name]), name)
