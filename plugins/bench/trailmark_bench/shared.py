"""Results in one file to be shared: figures of a bench, the machine, and the versions.

The file holds no path of the machine and no name of it. A file that somebody sent is read as what it is: each cell is
checked before it becomes one of ours, and nothing in it is run.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from trailmark.errors import DataError
from trailmark.isolation.outcome import Outcome
from trailmark_bench.cell import Cell
from trailmark_bench.index import CellRecord, Index
from trailmark_bench.merge import is_address

__all__ = ["read_results", "shared_results"]

_FORM, _VERSION = "trailmark bench results", 1
_FINISHED = ("ok", "failed", "timeout", "crashed", "skipped")
_GROUPS = ("metrics", "times", "counters", "floor")
_MAX_BYTES, _MAX_WORDS = 256 << 20, 2000
#: Facts about the bench that tables need, and where results come from.
_META = ("name", "version", "metrics", "baseline", "judging")
_ORIGIN = ("trailmark", "started", "python", "platform", "cpu", "packages", "git")
_COSTS = ("wall_s", "cpu_s", "peak_rss_mb", "load")


def shared_results(index: Index) -> str:
    """Return what a bench found as a JSON document: its cells that have ended, and where they come from."""
    meta = index.meta()
    origin = meta.get("provenance") or {}
    document = {
        "form": _FORM,
        "version": _VERSION,
        "bench": {key: meta[key] for key in _META if key in meta},
        "origin": {key: origin[key] for key in _ORIGIN if key in origin},
        "cells": [_document(record) for record in index.records() if record.state in _FINISHED],
    }
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _document(record: CellRecord) -> dict[str, Any]:
    machine = hashlib.sha256((record.host or "").encode()).hexdigest()[:8]
    return {
        "id": record.id,
        "matrix": record.matrix,
        "coordinates": dict(record.coordinates),
        "state": record.state,
        "reason": record.reason,
        "machine": machine,
        "costs": {name: getattr(record, name) for name in _COSTS if getattr(record, name) is not None},
        "result": dict(record.result),
    }


def read_results(path: Path, folder: Path) -> None:
    """Make the folder of a bench from a file of results.

    Parameters
    ----------
    path : Path
        What `shared_results` has written, on whichever machine.
    folder : Path
        An empty folder, or none.

    Raises
    ------
    DataError
        If it is no such file, or a cell in it cannot be; the message names the cell.
    """
    document = _read(path)
    cells = [_checked_cell(cell, f"{path}: cell {number}") for number, cell in enumerate(document["cells"])]
    bench, origin = document.get("bench"), document.get("origin")
    with Index(folder, write=True) as index, index.transaction():
        index.enter([Cell(cell["id"], cell["matrix"], cell["coordinates"], {}) for cell in cells])
        for cell in cells:
            index.mark_finished(cell["id"], _outcome(cell), cell["result"] or None)
        known = {key: bench[key] for key in _META if isinstance(bench, Mapping) and key in bench}
        index.set_meta(**known, provenance=origin if isinstance(origin, Mapping) else {})


def _outcome(cell: Mapping[str, Any]) -> Outcome:
    wall_s, cpu_s, peak_rss_mb, load = (float(cell["costs"].get(name) or 0.0) for name in _COSTS)
    return Outcome(cell["state"], cell["reason"], "", wall_s, cpu_s, peak_rss_mb, load, cell["machine"])


def _read(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise DataError(f"{path} is larger than {_MAX_BYTES >> 20} MB")
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise DataError(f"{path} is no file of 'trailmark bench export json': no text (byte {error.start})") from error
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path} is no file of 'trailmark bench export json': {error}") from error
    if not isinstance(document, dict) or document.get("form") != _FORM or not isinstance(document.get("cells"), list):
        raise DataError(f"{path} is no file of 'trailmark bench export json'")
    if document.get("version") != _VERSION:
        raise DataError(f"{path} has version {str(document.get('version'))[:20]} of the form; this reads {_VERSION}")
    return document


def _checked_cell(cell: object, where: str) -> dict[str, Any]:
    """Return a cell with everything that one has, and nothing else."""
    if not isinstance(cell, dict):
        raise DataError(f"{where} is no cell")
    coordinates, result, costs = (cell.get(key, {}) for key in ("coordinates", "result", "costs"))
    words = {key: cell.get(key, "") for key in ("matrix", "reason", "machine")}
    if not is_address(cell.get("id")) or cell.get("state") not in _FINISHED:
        raise DataError(f"{where} has no address, or no state of {', '.join(_FINISHED)}")
    if not all(isinstance(word, str) and len(word) <= _MAX_WORDS for word in words.values()):
        raise DataError(f"{where}: matrix, reason and machine are short texts")
    if not isinstance(coordinates, dict) or not all(_is_plain(value) for value in coordinates.values()):
        raise DataError(f"{where}: its coordinates are no texts and numbers by name")
    if not isinstance(costs, dict) or not all(value is None or _is_number(value) for value in costs.values()):
        raise DataError(f"{where}: its costs are no numbers by name")
    if not isinstance(result, dict) or not all(_is_group(result.get(group, {})) for group in _GROUPS):
        raise DataError(f"{where}: {', '.join(_GROUPS)} of its result are no numbers by name")
    return {
        "id": cell["id"],
        "state": cell["state"],
        "coordinates": coordinates,
        "costs": costs,
        "result": result,
    } | words


def _is_plain(value: object) -> bool:
    return isinstance(value, str | int | bool) or (isinstance(value, float) and math.isfinite(value))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_group(group: object) -> bool:
    return isinstance(group, dict) and all(value is None or _is_number(value) for value in group.values())
