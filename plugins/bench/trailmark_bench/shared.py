"""Results in one file to be shared: figures of a bench, the machine, and the versions.

The file holds no path of the machine and no name of it. A file that somebody sent is read as what it is: each cell is
checked before it becomes one of ours, and nothing in it is run.
"""

from __future__ import annotations

import hashlib
import io
import json
import lzma
import math
import re
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from trailmark.errors import DataError
from trailmark.isolation.outcome import Outcome
from trailmark.writing import write_whole
from trailmark_bench.cell import FINISHED, Cell
from trailmark_bench.index import CellRecord, Index
from trailmark_bench.merge import is_address
from trailmark_bench.order import first_samples

__all__ = ["read_results", "shared_results", "write_results"]

_FORM, _VERSION = "trailmark bench results", 1
_GROUPS = ("metrics", "times", "counters", "floor")
_MAX_BYTES, _MAX_WORDS, _MAX_PICTURE = 256 << 20, 2000, 1 << 20
_PACKED, _PACKED_SUFFIX = b"\xfd7zXZ\x00", ".xz"
#: What of the detail of a cell is drawn: the rest says paths.
_PICTURE = ("ways", "errors", "stages", "sources")
#: Facts about the bench that tables need, and where results come from.
_META = ("name", "version", "metrics", "baseline", "judging", "passes", "asked")
_ORIGIN = ("trailmark", "started", "python", "platform", "cpu", "packages", "git")
#: What stands for a host that a file names by its digest; no name of a host begins so.
_READ_HOST = re.compile("#[0-9a-f]{8}")
_COSTS = ("wall_s", "cpu_s", "peak_rss_mb", "load")


def shared_results(index: Index) -> str:
    """Return what a bench found as a JSON document: its cells that have ended, and where they come from."""
    return _text(_results(index, ()))


def write_results(index: Index, path: Path, *, pictured: bool = False) -> None:
    """Write what a bench found to a file, packed where its name ends in ``.xz``: the same results give the same bytes.

    Parameters
    ----------
    index : Index
        Of the bench.
    path : Path
        The file; its folder is made.
    pictured : bool
        With what is drawn of one place and seed of each combination, for the page of who has the file alone.

    Raises
    ------
    DataError
        If it cannot be written.
    """
    ended = [Cell(record.id, record.matrix, record.coordinates, {}) for record in index.records() if record.result]
    pictures = [cell.id for cell in first_samples(ended)] if pictured else []
    content = _text(_results(index, pictures)).encode()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, lzma.compress(content) if path.suffix == _PACKED_SUFFIX else content)
    except OSError as error:
        raise DataError(f"cannot write {path}: {error.strerror or error}") from error


def _results(index: Index, pictured: Collection[str]) -> dict[str, Any]:
    meta = index.meta()
    origin = meta.get("provenance") or {}
    records = index.records()
    pictures = {cell_id: _picture(detail) for cell_id, detail, _ in index.details() if cell_id in set(pictured)}
    return {
        "form": _FORM,
        "version": _VERSION,
        "bench": {key: meta[key] for key in _META if key in meta} | {"asked": len(records)},
        "origin": {key: origin[key] for key in _ORIGIN if key in origin},
        "cells": [
            _document(record) | ({"picture": pictures[record.id]} if pictures.get(record.id) else {})
            for record in records
            if record.state in FINISHED
        ],
    }


def _text(document: Mapping[str, Any]) -> str:
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _picture(detail: bytes | None) -> dict[str, Any]:
    """Return what is drawn of a cell."""
    known = {} if detail is None else json.loads(zlib.decompress(detail))
    return {key: known[key] for key in _PICTURE if known.get(key)}


def _document(record: CellRecord) -> dict[str, Any]:
    return {
        "id": record.id,
        "matrix": record.matrix,
        "coordinates": dict(record.coordinates),
        "state": record.state,
        "reason": record.reason,
        "machine": _machine_of(record.host or ""),
        "costs": {name: getattr(record, name) for name in _COSTS if getattr(record, name) is not None},
        "result": dict(record.result),
    }


def _machine_of(host: str) -> str:
    """Return the digest that stands for a host: of one that was read from a file, the one that stood there."""
    return host[1:] if _READ_HOST.fullmatch(host) else hashlib.sha256(host.encode()).hexdigest()[:8]


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
            picture = json.dumps(cell["picture"]).encode() if cell["picture"] else None
            index.mark_finished(cell["id"], _outcome(cell), cell["result"] or None, picture)
        known = {key: bench[key] for key in _META if isinstance(bench, Mapping) and key in bench}
        index.set_meta(**known, provenance=origin if isinstance(origin, Mapping) else {})


def _outcome(cell: Mapping[str, Any]) -> Outcome:
    wall_s, cpu_s, peak_rss_mb, load = (float(cell["costs"].get(name) or 0.0) for name in _COSTS)
    return Outcome(cell["state"], cell["reason"], "", wall_s, cpu_s, peak_rss_mb, load, f"#{cell['machine']}")


def _read(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(_content(path).decode())
    except (EOFError, lzma.LZMAError) as error:
        raise DataError(f"{path} is damaged: {error}") from error
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


def _content(path: Path) -> bytes:
    """Return the bytes of a file, unpacked if it is packed, and never more than a file may have."""
    with path.open("rb") as file:
        content = file.read(_MAX_BYTES + 1)
    if content.startswith(_PACKED):
        with lzma.LZMAFile(io.BytesIO(content)) as packed:
            content = packed.read(_MAX_BYTES + 1)
    if len(content) > _MAX_BYTES:
        raise DataError(f"{path} is larger than {_MAX_BYTES >> 20} MB")
    return content


def _checked_cell(cell: object, where: str) -> dict[str, Any]:
    """Return a cell with everything that one has, and nothing else."""
    if not isinstance(cell, dict):
        raise DataError(f"{where} is no cell")
    coordinates, result, costs, picture = (cell.get(key, {}) for key in ("coordinates", "result", "costs", "picture"))
    words = {key: cell.get(key, "") for key in ("matrix", "reason", "machine")}
    if not is_address(cell.get("id")) or cell.get("state") not in FINISHED:
        raise DataError(f"{where} has no address, or no state of {', '.join(FINISHED)}")
    if not all(isinstance(word, str) and len(word) <= _MAX_WORDS for word in words.values()):
        raise DataError(f"{where}: matrix, reason and machine are short texts")
    if not isinstance(coordinates, dict) or not all(_is_plain(value) for value in coordinates.values()):
        raise DataError(f"{where}: its coordinates are no texts and numbers by name")
    if not isinstance(costs, dict) or not all(value is None or _is_number(value) for value in costs.values()):
        raise DataError(f"{where}: its costs are no numbers by name")
    if not isinstance(result, dict) or not all(_is_group(result.get(group, {})) for group in _GROUPS):
        raise DataError(f"{where}: {', '.join(_GROUPS)} of its result are no numbers by name")
    if not isinstance(picture, dict) or set(picture) - set(_PICTURE) or len(json.dumps(picture)) > _MAX_PICTURE:
        raise DataError(f"{where}: its picture is no small mapping of {', '.join(_PICTURE)}")
    return {
        "id": cell["id"],
        "state": cell["state"],
        "coordinates": coordinates,
        "costs": costs,
        "result": result,
        "picture": picture,
    } | words


def _is_plain(value: object) -> bool:
    return isinstance(value, str | int | bool) or (isinstance(value, float) and math.isfinite(value))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_group(group: object) -> bool:
    return isinstance(group, dict) and all(value is None or _is_number(value) for value in group.values())
