"""What a config asks for, and a run could do nothing with."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trailmark.evaluation import RunWarning

if TYPE_CHECKING:
    from trailmark.config import RunConfig

__all__ = ["without_effect"]


def without_effect(config: RunConfig, folder: Path) -> Iterator[RunWarning]:
    """Yield a warning for each thing in a config that changed nothing in the run that it led to.

    Parameters
    ----------
    config : RunConfig
        What was asked for.
    folder : Path
        The folder of the run, which says what sensors there were.
    """
    if not config.localizers and not config.sinks:  # with a sink, the frames themselves may be what is wanted
        remedy = "name one under 'localizers:', or by --localizer where there is no config"
        yield RunWarning("", "there is no localizer, so nothing said how the robot moves", remedy)
    kinds = _kinds_of_sensors(folder)
    for name in _mounted(config):
        if kinds.get(name) == "odometry":
            fact = "its mounting changes nothing: odometry is of the robot's base, wherever it is measured"
            remedy = "take the mounting out; a scale, sign or axis that is wrong is mended where the odometry is made"
            yield RunWarning(name, fact, remedy, is_worthless=False)


def _mounted(config: RunConfig) -> list[str]:
    """Return the sensors that the config gives a mounting, at a source of one sensor or under ``sensors:``."""
    at_sources = [name for name, source in config.sources.items() if source.config.mounting is not None]
    named = [name for name, sensor in config.sensors.items() if sensor.mounting is not None]
    return list(dict.fromkeys([*at_sources, *named]))


def _kinds_of_sensors(folder: Path) -> Mapping[str, Any]:
    """Return what the sensors of a run are; nothing where its folder does not say so, as on a full disk."""
    try:
        about = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return {name: sensor["kind"] for name, sensor in about.get("sensors", {}).items()}
