"""A run whose simulated sources, and their faults, take their frames from a cache."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from trailmark.config import RunConfig, SourceEntry
from trailmark.config.run import FaultEntry, PartEntry
from trailmark.interfaces import Drivable, FrameSource
from trailmark.isolation.fingerprint import code_of, fingerprint, without_paths
from trailmark_bench.cached_fault import CachedFaultEntry, FaultySource
from trailmark_bench.cached_source import CachedSource, renderer_versions
from trailmark_bench.frame_cache import FrameCache

__all__ = ["with_cached_frames"]

# Keys of a source that are applied to its frames, not by it.
_APPLIED_LATER = ("perturb",)


def with_cached_frames(config: RunConfig, cache: FrameCache, data: Mapping[str, str]) -> RunConfig:
    """Return a run whose simulated sources take their frames from a cache, where no controller drives them.

    Parameters
    ----------
    config : RunConfig
        Of the run; one that is held to the stamps of its frames is left as it is.
    cache : FrameCache
        Where frames are.
    data : mapping of str to str
        Digests of files that are known.
    """
    if config.settings.pace == "realtime":
        return config
    sources = {name: _cached_entry(entry, cache, data) for name, entry in config.sources.items()}
    return replace(config, sources=sources)


@dataclass(frozen=True, slots=True, kw_only=True)
class _CachedSourceEntry(SourceEntry):
    cache: FrameCache
    facts: Mapping[str, Any]
    befallen: FaultySource

    def construct(self) -> FrameSource:
        source: FrameSource = PartEntry.construct(self)
        if not isinstance(source, Drivable):
            return source
        self.befallen.source = CachedSource(source, self.cache, self.facts)
        return self.befallen.source


def _cached_entry(entry: SourceEntry, cache: FrameCache, data: Mapping[str, str]) -> SourceEntry:
    own = {field.name: getattr(entry, field.name) for field in fields(entry)}
    kept = {key: value for key, value in entry.document.items() if key not in _APPLIED_LATER}
    facts = {
        "source": without_paths(kept, lambda path: data.get(path) or fingerprint(path)),
        "code": code_of([entry.spec]),
        "renderers": renderer_versions(),
        "machine": platform.machine(),
    }
    befallen = FaultySource()
    own["faults"] = tuple(_cached_fault(entry, index, cache, befallen, data) for index in range(len(entry.faults)))
    return _CachedSourceEntry(**own, cache=cache, facts=facts, befallen=befallen)


def _cached_fault(
    source: SourceEntry, index: int, cache: FrameCache, befallen: FaultySource, data: Mapping[str, str]
) -> FaultEntry:
    """Return a fault of a source; what it makes of frames depends on the faults before it too.

    Time counts from the first frame of any sensor that the faults befall, so these sensors have a say as well.
    """
    entry, so_far = source.faults[index], source.faults[: index + 1]
    own = {field.name: getattr(entry, field.name) for field in fields(entry)}
    written = [[fault.name, fault.document] for fault in so_far]
    facts = {
        "faults": without_paths(written, lambda path: data.get(path) or fingerprint(path)),
        "code": code_of([fault.spec for fault in so_far]),
        "sensors": None if source.perturbed is None else sorted(source.perturbed),
    }
    return CachedFaultEntry(**own, cache=cache, facts=facts, befallen=befallen)
