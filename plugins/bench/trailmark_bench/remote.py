"""Cells on another machine: they carry what they need, and what they leave comes back as bytes.

For executors. `pack_request` makes of a request what can be sent; `run_packed` runs it where it arrives.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import trailmark
from trailmark.isolation.executor import Finished, Job
from trailmark.isolation.fingerprint import FileCache, fingerprint, source_digest
from trailmark.isolation.outcome import Outcome
from trailmark_bench.executors.warm import WarmParents
from trailmark_bench.process import cell_process, run_cell, run_to_end

__all__ = ["pack_request", "run_packed", "unpack_result", "unpacked_answer"]

# Digests of recordings on this machine: a worker runs many cells of one recording.
_KNOWN: FileCache = {}
# What cells are forked from on this machine; it ends with this process.
_PARENTS = WarmParents()


def pack_request(request: Mapping[str, Any], carry_mb: float) -> dict[str, Any]:
    """Return a request with the files that it needs, as far as they are small.

    Parameters
    ----------
    request : mapping
        Of the cell.
    carry_mb : float
        Files and folders above this size are left out: they must lie at the same place where the cell runs [MB].
    """
    paths = [*request["data"], *request["plugins"]["files"]]
    carried = {path: content for path in paths if (content := _content(Path(path), carry_mb * 1e6)) is not None}
    return {"request": dict(request), "carried": carried, "trailmark": trailmark.__version__}


def run_packed(package: Mapping[str, Any]) -> dict[str, Any]:
    """Run a packed cell here, in a process of its own; return its outcome and everything that it left.

    Nothing stays on this machine. What is missing here (another version, other code, a recording) is the outcome
    ``failed`` with the reason.
    """
    with tempfile.TemporaryDirectory(prefix="trailmark-cell-") as name:
        place = Path(name)
        problem = _other_code(package)
        request, missing = (dict(package["request"]), problem) if problem else _unpack(package, place)
        if missing:
            return {"outcome": asdict(Outcome("failed", missing)), "files": {}}
        folder, outcome = _run(request, place)
        files = {file.relative_to(folder).as_posix(): file.read_bytes() for file in folder.rglob("*") if file.is_file()}
        return {"outcome": asdict(outcome), "files": files}


def _run(request: Mapping[str, Any], place: Path) -> tuple[Path, Outcome]:
    """Run a cell, forked from a warm process where that goes well; return its folder and outcome."""
    folder = place / "warm"
    folder.mkdir()
    process = cell_process(request, folder, _PARENTS.of(request))
    with suppress(OSError):  # its parent was lost
        outcome = run_to_end(process, folder)
        if outcome.state != "crashed" or not process.was_warm:
            return folder, outcome
    folder = place / "cell"
    folder.mkdir()
    return folder, run_cell(request, folder)


def unpack_result(job: Job, answer: Mapping[str, Any]) -> Finished:
    """Return what came back of a job."""
    return Finished(job.id, Outcome(**answer["outcome"]), files=answer["files"])


def unpacked_answer(finished: Finished, workspace: Path) -> Path:
    """Lay down what came back of a cell in a new folder of the workspace, and return it.

    Raises
    ------
    OSError
        If it cannot be written, or leads out of the folder.
    """
    folder = workspace / f"{finished.id}-{time.monotonic_ns()}"
    folder.mkdir(parents=True)
    for name, content in finished.files.items():
        path = folder / name
        if not path.resolve().is_relative_to(folder.resolve()):
            raise OSError(f"a worker sent the file {name!r}, which lies outside of the cell's folder")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return folder


def _content(path: Path, limit: float) -> dict[str, bytes] | None:
    """Return the files of a path by their names in it; of a file the name is empty. None: too large."""
    if path.is_file():
        return {"": path.read_bytes()} if path.stat().st_size <= limit else None
    files = [file for file in path.rglob("*") if file.is_file()]
    if sum(file.stat().st_size for file in files) > limit:
        return None
    return {file.relative_to(path).as_posix(): file.read_bytes() for file in files}


def _other_code(package: Mapping[str, Any]) -> str:
    if package["trailmark"] != trailmark.__version__:
        return f"this worker has Trailmark {trailmark.__version__}, the bench {package['trailmark']}"
    for name, told in package["request"]["code"].items():
        _, _, digest = told.partition(" ")
        if digest and not name.startswith("trailmark_file_") and source_digest(name) != digest:
            return f"this worker has other code of {name} than the bench: install the same"
    return ""


def _unpack(package: Mapping[str, Any], place: Path) -> tuple[dict[str, Any], str]:
    """Return the request with the paths of this machine, and what is missing."""
    request, carried = package["request"], package["carried"]
    elsewhere: dict[str, str] = {}
    for number, (path, digest) in enumerate(request["data"].items()):
        if _is_here(path, digest):
            continue
        if path not in carried:
            return request, f"the recording {path} is not on this worker, or is another one, and too large to be sent"
        elsewhere[path] = _laid_down(carried[path], place / f"data-{number}" / Path(path).name)
    for number, path in enumerate(request["plugins"]["files"]):
        elsewhere[path] = _laid_down(carried[path], place / f"plugin-{number}" / Path(path).name)
    return _replace_paths(request, elsewhere), ""


def _is_here(path: str, digest: str) -> bool:
    return Path(path).exists() and fingerprint(path, _KNOWN) == digest


def _laid_down(files: Mapping[str, bytes], path: Path) -> str:
    for name, content in files.items():
        file = path / name if name else path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    return str(path)


def _replace_paths(value: Any, elsewhere: Mapping[str, str]) -> Any:
    if isinstance(value, Mapping):
        return {key: _replace_paths(item, elsewhere) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_replace_paths(item, elsewhere) for item in value]
    return elsewhere.get(value, value) if isinstance(value, str) else value
