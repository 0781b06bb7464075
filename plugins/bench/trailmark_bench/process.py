"""The process of a cell, and the names of what it leaves in its folder."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from trailmark.deprecation import deprecated_name
from trailmark.isolation.outcome import Outcome
from trailmark.isolation.process import REQUEST_FILE, RESULT_FILE, IsolatedProcess
from trailmark.isolation.warm_parent import WarmParent

__all__ = [
    "CELL_MODULE",
    "DETAIL_FILE",
    "OUTCOME_FILE",
    "REQUEST_FILE",
    "RESULT_FILE",
    "cell_process",
    "run_cell",
    "run_to_end",
]

#: What runs in the process of a cell.
CELL_MODULE = "trailmark_bench.child"

DETAIL_FILE = "detail.json"
OUTCOME_FILE = "outcome.json"

# Working folder of a cell: what it writes by a relative path, or as a temporary file, counts as its own.
_SCRATCH = "scratch"


def cell_process(request: Mapping[str, Any], folder: Path, parent: WarmParent | None = None) -> IsolatedProcess:
    """Return the process of a cell, which is to be run; with a parent it is forked from that."""
    return IsolatedProcess(request, folder, module=CELL_MODULE, scratch=folder / _SCRATCH, parent=parent)


def run_cell(request: Mapping[str, Any], folder: Path) -> Outcome:
    """Run a cell in a process of its own and wait for it.

    Parameters
    ----------
    request : mapping
        Of the cell; it is written into the folder.
    folder : Path
        An empty folder; what the cell leaves is in it afterwards.
    """
    return run_to_end(cell_process(request, folder), folder)


def run_to_end(process: IsolatedProcess, folder: Path) -> Outcome:
    """Run the process of a cell, and remove its working folder."""
    outcome = process.run()
    shutil.rmtree(folder / _SCRATCH, ignore_errors=True)
    return outcome


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"CellProcess": IsolatedProcess})
