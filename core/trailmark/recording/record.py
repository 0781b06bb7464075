"""Recording the sources of a config."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from trailmark.config import RunConfig
from trailmark.interruption import KEEP_S, shielded
from trailmark.pipeline import Pipeline, Step
from trailmark.recording.dataset import DatasetWriter

__all__ = ["Recording", "record_sources"]


@dataclass(frozen=True, slots=True)
class Recording:
    """What was recorded.

    Attributes
    ----------
    status : str
        ``done``, or ``interrupted``: what was written until then plays again.
    frames : mapping of str to int
        Frames of every sensor.
    playable : tuple of str
        Sensors that the written ``config.yaml`` plays again.
    n_dropped : int
        Frames of live sources that came faster than they could be written.
    n_too_far : int
        Depth values that pictures cannot hold, written as not measured.
    """

    status: str
    frames: MappingProxyType[str, int]
    playable: tuple[str, ...]
    n_dropped: int
    n_too_far: int


def record_sources(
    config: RunConfig,
    folder: Path,
    *,
    overwrite: bool = False,
    on_step: Callable[[Pipeline, Step], None] = lambda pipeline, step: None,
) -> Recording:
    """Write all frames of a config's sources; its localizers, controller and sinks are left alone.

    Parameters
    ----------
    config : RunConfig
        As loaded.
    folder : Path
        Where to write to.
    overwrite : bool
        Write into a folder that is not empty.
    on_step : callable
        Called with the pipeline and every step: progress.

    Raises
    ------
    ConfigError
        If the request is wrong, or the folder holds something.
    DataError
        If a source fails; what came before is kept, and plays again.
    """
    settings = config.settings.model_copy(update={"mode": "track", "start": "unknown"})
    sources_alone = replace(config, settings=settings, localizers={}, controller=None, sinks=(), path_store=None)
    with Pipeline(sources_alone) as pipeline:
        writer = DatasetWriter(folder, pipeline.sensors, overwrite)
        try:
            for step in pipeline:
                if step.frame is not None:
                    writer.write(step.frame)
                on_step(pipeline, step)
        finally:
            with shielded():
                pipeline.close()
            with shielded(KEEP_S):
                writer.close(pipeline.result.ground_truth)
    dropped = sum(n for name, n in pipeline.counters.items() if name.endswith(".dropped"))
    return Recording(
        pipeline.result.status,
        MappingProxyType(dict(writer.counts)),
        writer.playable,
        dropped,
        sum(writer.n_too_far.values()),
    )
