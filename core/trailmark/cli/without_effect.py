"""What a run was asked for and could do nothing with."""

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
    for name, sensor in _sensors(folder).items():
        if sensor["kind"] == "odometry" and any(sensor["pose_base_sensor"].values()):
            fact = "its mounting changes nothing: odometry is of the robot's base, wherever it is measured"
            remedy = "take the mounting out; a scale, sign or axis that is wrong is mended where the odometry is made"
            yield RunWarning(name, fact, remedy, is_worthless=False)


def _sensors(folder: Path) -> Mapping[str, Any]:
    about = folder / "run.json"
    if not about.exists():
        return {}
    found: Mapping[str, Any] = json.loads(about.read_text(encoding="utf-8"))["sensors"]
    return found
