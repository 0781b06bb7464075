"""Several sources, one stream: merged by stamp, pulled one frame at a time."""

from __future__ import annotations

import heapq
import logging
from collections.abc import Iterator, Sequence

from trailmark.errors import ConfigError
from trailmark.frames import Frame
from trailmark.pipeline.sources.stream import SourceStream

__all__ = ["merge_sources"]

logger = logging.getLogger(__name__)

# Recordings of one drive begin together; clocks that differ mostly do so by hours or decades.
_SUSPICIOUS_S = 60.0


def merge_sources(sources: Sequence[SourceStream]) -> Iterator[Frame]:
    """Yield the frames of all sources in the order of their stamps; those of one stamp in the order of the sources.

    A source is asked for its next frame only when its last one has been worked on, so a robot is never ahead of its
    command.

    Raises
    ------
    ConfigError
        If the times of the sources do not overlap. It shows when all sources that have begun are exhausted, and one
        has not begun yet.
    """
    streams = [source.frames() for source in sources]
    return streams[0] if len(streams) == 1 else _by_stamp(sources, streams)


def _by_stamp(sources: Sequence[SourceStream], streams: Sequence[Iterator[Frame]]) -> Iterator[Frame]:
    heads: list[tuple[float, int, Frame]] = []
    for index, stream in enumerate(streams):
        frame = next(stream, None)
        if frame is not None:
            heads.append((frame.stamp_s, index, frame))
    _warn_of_late_starts(sources, heads)
    heapq.heapify(heads)
    begun: set[int] = set()
    while heads:
        _, index, frame = heads[0]
        begun.add(index)
        yield frame
        following = next(streams[index], None)
        if following is not None:
            heapq.heapreplace(heads, (following.stamp_s, index, following))
            continue
        heapq.heappop(heads)
        if heads and all(other not in begun for _, other, _ in heads) and heads[0][0] > frame.stamp_s:
            raise _disjoint(sources[index], frame.stamp_s, sources[heads[0][1]], heads[0][0])


def _warn_of_late_starts(sources: Sequence[SourceStream], heads: list[tuple[float, int, Frame]]) -> None:
    if not heads:
        return
    (first_s, first, _), (last_s, last, _) = min(heads), max(heads)
    if last_s - first_s > _SUSPICIOUS_S:
        logger.warning(
            "source %r begins %.0f s after %r; if their clocks differ, say time_offset_s",
            sources[last].name,
            last_s - first_s,
            sources[first].name,
        )


def _disjoint(ended: SourceStream, ended_s: float, waiting: SourceStream, begins_s: float) -> ConfigError:
    return ConfigError(
        f"the sources {ended.name!r} and {waiting.name!r} do not overlap in time: {ended.name!r} ends at"
        f" {ended_s:.3f} s, {waiting.name!r} begins at {begins_s:.3f} s. If their clocks differ, give one of them a"
        f" time_offset_s, for example sources.{waiting.name}.time_offset_s: {ended.first_s - begins_s:.3f}"
    )
