"""Recording: a simulated drive as a data set on disk."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path

from trailmark.config import load_run_config
from trailmark.errors import ConfigError
from trailmark.interfaces import Mode, Session
from trailmark.pipeline.lifecycle import part_rng
from trailmark.plugins import Plugins
from trailmark.recording import DatasetWriter
from trailmark_sim.config import SimConfig
from trailmark_sim.source import SimSource

__all__ = ["record_run"]


def record_run(
    config: Path, out: Path, settings: Sequence[str], mode: Mode, overwrite: bool, plugins: Plugins
) -> Iterator[str]:
    """Drive the route of a config's simulated source and write every reading; yields lines to be shown.

    Parameters
    ----------
    config : Path
        A run config; its only source is simulated. What else it holds is left alone.
    out : Path
        Folder to write to.
    settings : sequence of str
        ``KEY=VALUE``, overrides of the config.
    mode : str
        In replay the world is as on the day of coming back, and the route is driven again.
    overwrite : bool
        Write into a folder that is not empty.
    plugins : Plugins
        What may be named.

    Raises
    ------
    ConfigError
        If the config is wrong, has no simulated source, or the folder holds something.
    """
    run = load_run_config(config, plugins=plugins, overrides=settings)
    simulated = {name: entry.config for name, entry in run.sources.items() if isinstance(entry.config, SimConfig)}
    if len(simulated) != 1:
        raise ConfigError(f"{config}: 'sim record' takes a config with one source of plugin sim, not {len(simulated)}")
    name, given = next(iter(simulated.items()))
    with closing(SimSource(given.model_copy(update={"driver": "route"}))) as source:
        source.start(Session(name=name, mode=mode, rng=part_rng(run.settings.seed, "source", name)))
        writer = DatasetWriter(out, source.sensors, overwrite)
        yield f"recording {', '.join(source.sensors)} of {given.world} to {out}"
        yield from _write_frames(source, writer)


def _write_frames(source: SimSource, writer: DatasetWriter) -> Iterator[str]:
    """Write all frames and the truth; yields lines to be shown."""
    last_s = 0.0
    try:
        for frame in source.frames():
            writer.write(frame)
            if frame.stamp_s >= last_s + 10.0:
                last_s += 10.0
                yield f"  {last_s:.0f} s"
    finally:  # what was written until an interrupt plays again
        truth = source.ground_truth()
        writer.close(truth)
    counts = ", ".join(f"{count} of {sensor}" for sensor, count in writer.counts.items())
    yield f"{truth.length_m():.2f} m, {counts}, {source.counters()['collisions']} collisions"
