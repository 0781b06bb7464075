"""One reading of one sensor, from a vehicle at rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from typing import Any

from trailmark.config import load_run_config
from trailmark.frames import Payload
from trailmark.interfaces import Mode, Session
from trailmark.pipeline.lifecycle import part_rng
from trailmark.plugins import Plugins
from trailmark_sim.config import SimConfig
from trailmark_sim.source import SimSource

__all__ = ["take_snapshot"]


def take_snapshot(
    keys: Mapping[str, Any], settings: Sequence[str], mode: Mode, frame: int, seed: int, plugins: Plugins
) -> Payload:
    """Return what the only sensor of a simulated source sees from its start.

    Parameters
    ----------
    keys : mapping
        Keys of the source's config; None where nothing was said.
    settings : sequence of str
        ``KEY=VALUE`` of the world's options, values in YAML.
    mode : str
        Some worlds change between teaching and coming back.
    frame : int
        Number of the reading: its noise.
    seed : int
        Of the run.
    plugins : Plugins
        What may be named.

    Raises
    ------
    ConfigError
        If anything that was asked for is wrong.
    """
    given = {key: value for key, value in keys.items() if value is not None}
    document = {"sources": {"sim": {"plugin": "sim"} | given}}
    overrides = [f"sources.sim.options.{setting}" for setting in settings]
    config = load_run_config(document, plugins=plugins, overrides=overrides).sources["sim"].config
    assert isinstance(config, SimConfig)  # the plugin's own
    with closing(SimSource(config)) as source:
        source.start(Session(mode=mode, rng=part_rng(seed, "source", "sim")))
        return source.look(frame)
