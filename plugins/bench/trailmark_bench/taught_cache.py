"""Places that are taught once: kept beside the frames by what a teaching depends on, copied for each cell that asks."""

from __future__ import annotations

import json
import platform
import shutil
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from trailmark.config import RunConfig
from trailmark.isolation.fingerprint import code_of, digest_of, fingerprint, without_paths
from trailmark.isolation.limits import folder_mb
from trailmark_bench.cached_source import renderer_versions
from trailmark_bench.combination import part_specs
from trailmark_bench.frame_cache import FrameCache

__all__ = ["TaughtCache", "is_repeatable"]

_STORE, _RUN, _INDEX = "store", "run", "index.json"
#: Keys of a run that say where something lies or is told, and nothing of what is taught.
_BESIDE = ("sinks", "plugins")


def is_repeatable(config: RunConfig) -> bool:
    """Return whether a teaching gives the same every time: by the stamps of frames, and from no device."""
    if config.settings.pace == "realtime":
        return False
    return not any(entry.spec.load().is_live for entry in config.sources.values())


class TaughtCache:
    """Path stores in a cache of frames, each with the folder of the run that taught it.

    Parameters
    ----------
    cache : FrameCache
        Bounds what they take together with the frames.
    data : mapping of str to str
        Digests of files that are known.
    threads : int
        Of the numeric libraries.
    """

    def __init__(self, cache: FrameCache, data: Mapping[str, str], threads: int) -> None:
        self._cache = cache
        self._data = data
        self._threads = threads

    def key_of(self, config: RunConfig) -> str:
        """Return the digest of all that a teaching depends on."""
        kept = {name: value for name, value in config.document.items() if name not in _BESIDE}
        store = kept.get("path_store")
        if isinstance(store, Mapping):
            kept["path_store"] = {name: value for name, value in store.items() if name != "path"}
        facts = {
            "teach": without_paths(kept, lambda path: self._data.get(path) or fingerprint(path)),
            "code": code_of(part_specs(config)),
            "versions": renderer_versions(),
            "machine": platform.machine(),
            "threads": self._threads,
        }
        return digest_of(facts)

    def copy_to(self, key: str, store: Path, run: Path) -> bool:
        """Put what was taught before in place of a store and of the folder of its run; return whether there was any."""
        place = self._cache.place_of(key)
        try:
            sizes = json.loads((place / _INDEX).read_bytes())
            shutil.copytree(place / _RUN, run)
            shutil.copyfile(place / _STORE, store)
            if _sizes_of(store, run) != sizes:
                raise ValueError("the copy is not as what was kept")
        except (OSError, ValueError, shutil.Error):  # none, damaged, or it made room for frames meanwhile
            shutil.rmtree(run, ignore_errors=True)
            store.unlink(missing_ok=True)
            return False
        self._cache.mark_used(key)
        return True

    def keep(self, key: str, store: Path, run: Path) -> None:
        """Keep a store and the folder of its run, for a damaged one too; where they cannot be, the next teaches."""
        draft = self._cache.draft_of(key)
        with suppress(OSError, shutil.Error):
            draft.mkdir(parents=True)
            shutil.copytree(run, draft / _RUN)
            shutil.copyfile(store, draft / _STORE)
            (draft / _INDEX).write_text(json.dumps(_sizes_of(draft / _STORE, draft / _RUN)))
            if (size_mb := folder_mb(draft)) <= self._cache.limit_mb:
                self._cache.make_room(size_mb)
                self._cache.remove(key)
                draft.rename(self._cache.place_of(key))
        shutil.rmtree(draft, ignore_errors=True)


def _sizes_of(store: Path, run: Path) -> dict[str, int]:
    """Return how long a store is, and every file of a folder by its name in it [bytes]."""
    found = {path.relative_to(run).as_posix(): path.stat().st_size for path in run.rglob("*") if path.is_file()}
    return {"": store.stat().st_size, **found}
