"""``python -m trailmark_bench.child FOLDER PARENT``: one cell, in a process of its own.

It reads ``cell.json`` of the folder and leaves ``run/`` (and ``teach/``), ``metrics.json``, ``detail.json`` and, last
and at once, ``result.json``. What goes wrong is said in one line, the last on standard error.
"""

from __future__ import annotations

import faulthandler
import json
import logging
import os
import signal
import sys
import traceback
from collections.abc import Mapping
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

from trailmark.errors import ConfigError, SensorMismatchError, TrailmarkError
from trailmark.isolation.child import EXIT_FAILED, EXIT_SKIPPED, die_with, say, write_json
from trailmark.isolation.process import REQUEST_FILE, RESULT_FILE
from trailmark_bench.process import DETAIL_FILE

__all__ = ["COMMON", "main", "prepare"]

#: What every cell imports, whatever its parts are.
COMMON = (
    "trailmark.config",
    "trailmark.evaluation",
    "trailmark.pipeline",
    "trailmark.plugins",
    "trailmark_bench.cached_run",
    "trailmark_bench.measure",
    "trailmark_bench.taught_cache",
)

_STORE = "place.trail"
# Steps after which a cell has imported nearly all that it needs.
_FIRST_STEPS = 3


def main(arguments: list[str]) -> int:
    """Run the cell of a folder; return the exit code."""
    folder = Path(arguments[0])
    die_with(int(arguments[1]))
    faulthandler.register(signal.SIGUSR1)
    level = os.environ.get("TRAILMARK_LOG") or "warning"
    logging.basicConfig(format="%(levelname)s: %(message)s", level=level.upper())
    try:
        request = json.loads((folder / REQUEST_FILE).read_text(encoding="utf-8"))
        _limit(request["limits"])
        write_json(folder / RESULT_FILE, _run(request, folder))
    except SensorMismatchError as error:  # the cell means nothing
        return say(EXIT_SKIPPED, error)
    except MemoryError as error:
        traceback.print_exc()
        limit = request["limits"].get("memory_mb")
        return say(EXIT_FAILED, f"out of memory{f' (limit {limit:g} MB)' if limit else ''}: {error}".rstrip(": "))
    except TrailmarkError as error:
        cause = error.__cause__
        if cause is not None and not isinstance(cause, TrailmarkError):
            traceback.print_exc()
        return say(EXIT_FAILED, error)
    except Exception as error:
        traceback.print_exc()
        return say(EXIT_FAILED, f"{type(error).__name__}: {error}")
    return 0


def prepare(arguments: list[str]) -> None:
    """Import what the cell of a folder needs: its first steps are run in the working folder, and mean nothing."""
    request = json.loads((Path(arguments[0]) / REQUEST_FILE).read_text(encoding="utf-8"))
    _limit(request["limits"])
    place = Path("prepared")
    place.mkdir()
    _run({**request, "frames": None}, place, n_steps=_FIRST_STEPS)


def _run(request: Mapping[str, Any], folder: Path, *, n_steps: int | None = None) -> dict[str, Any]:
    """Run a cell, or its first steps, and return what was measured."""
    from trailmark.config import Document, load_run_config
    from trailmark.evaluation import Protocol, evaluate_run_folder, metrics_of, read_run, write_metrics
    from trailmark.evaluation.taught_places import TRUTH_FILE, write_taught_places
    from trailmark.plugins import load_plugins
    from trailmark_bench.cached_run import with_cached_frames
    from trailmark_bench.frame_cache import FrameCache
    from trailmark_bench.measure import measure_cell

    chosen = request["plugins"]
    plugins = load_plugins(block=chosen["block"], files=chosen["files"])
    base_dir = Path(request["base_dir"])

    def load(document: dict[str, Any]) -> Any:
        config = load_run_config(Document(document, "cell.json", base_dir), plugins=plugins)
        frames = request.get("frames")
        if frames is None:
            return config
        return with_cached_frames(config, FrameCache(Path(frames["folder"]), frames["limit_mb"]), request["data"])

    config, store = load(request["document"]), None
    _pin_opencv(int(request["limits"]["threads"]))
    if request["teach"] is not None:
        store = folder / _STORE
        _teach(load(request["teach"]), request, folder / "teach", store, n_steps)
    pipeline = _drive(config, folder / "run", store, n_steps)
    extra = metrics_of(plugins.registry)
    protocol = Protocol(align=request["align"])
    if pipeline.true_places is not None:
        write_taught_places(pipeline.true_places, folder / "run" / TRUTH_FILE)
    evaluated = evaluate_run_folder(read_run(folder / "run"), protocol, pipeline.path)
    document = write_metrics(evaluated, metrics=extra, path=pipeline.path)
    if store is not None and not request["keep_stores"]:
        store.unlink(missing_ok=True)
    result, detail = measure_cell(request, pipeline.result, document, evaluated)
    write_json(folder / DETAIL_FILE, detail)
    return result


def _teach(config: Any, request: Mapping[str, Any], out: Path, store: Path, n_steps: int | None) -> None:
    """Teach a place, or take what another cell was taught alike."""
    from trailmark_bench.frame_cache import FrameCache
    from trailmark_bench.taught_cache import TaughtCache, is_repeatable

    frames, cache, key = request.get("frames"), None, ""
    if frames is not None and is_repeatable(config):
        kept = FrameCache(Path(frames["folder"]), frames["limit_mb"])
        cache = TaughtCache(kept, request["data"], request["limits"]["threads"])
        key = cache.key_of(config)
        if cache.copy_to(key, store, out):
            return
    taught = _drive(config, out, store, n_steps)
    if n_steps is None and taught.result.status != "done":
        raise ConfigError(f"teaching {taught.result.status}: {taught.result.reason}".rstrip(": "))
    if cache is not None:
        cache.keep(key, store, out)


def _drive(config: Any, out: Path, store: Path | None, n_steps: int | None) -> Any:
    """Run a pipeline to its end, or for some steps, and return it."""
    from trailmark.pipeline import Pipeline

    pipeline = Pipeline(config, out=out, store=store)
    with pipeline:
        for _ in islice(pipeline, n_steps):
            pass
    return pipeline


def _limit(limits: Mapping[str, Any]) -> None:
    """Limit memory and size of files from here on; core dumps of cells that crash are of no use."""
    import resource

    wanted = {resource.RLIMIT_AS: limits["memory_mb"], resource.RLIMIT_FSIZE: limits["file_mb"]}
    for which, limit_mb in wanted.items():
        if limit_mb is not None:
            _, hard = resource.getrlimit(which)
            size = int(limit_mb * 1e6)
            resource.setrlimit(which, (size if hard == resource.RLIM_INFINITY else min(size, hard), hard))
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _pin_opencv(threads: int) -> None:
    cv2 = sys.modules.get("cv2")  # only where a part of this run has imported it
    if cv2 is not None:
        cv2.setNumThreads(threads)


if __name__ == "__main__":
    found = main(sys.argv[1:])
    sys.stderr.flush()
    os._exit(found)  # what libraries do on the way out takes time, and sometimes crashes
