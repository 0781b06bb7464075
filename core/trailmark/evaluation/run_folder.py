"""Reading the folder of a run. Missing and broken files are reported, and the rest is read."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from trailmark import paths
from trailmark.errors import DataError
from trailmark.evaluation.belief_table import (
    BELIEFS_FILE,
    OUTLINES_FILE,
    BeliefTable,
    read_beliefs,
    read_outlines,
)
from trailmark.evaluation.estimates_table import EstimateTable, read_estimates
from trailmark.evaluation.path_file import PATH_FILE, read_path
from trailmark.evaluation.taught_places import TRUTH_FILE, read_taught_places
from trailmark.frames.outlines import Outlines
from trailmark.geometry import Trajectory, read_tum

__all__ = ["FUSED", "GROUND_TRUTH", "RunFolder", "localizer_names", "read_run"]

FUSED = "fused"
GROUND_TRUTH = "groundtruth"

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class RunFolder:
    """What a run has left.

    Attributes
    ----------
    path : Path
        The folder.
    trajectories : mapping of str to Trajectory
        One of each localizer in the order of the config, the fused one last; they may be empty.
    truth : Trajectory or None
        The ground truth, where it is known.
    estimates : EstimateTable or None
        Every estimate and what became of it.
    run, timing : mapping
        ``run.json`` and ``timing.json``; empty when missing.
    config_text : str
        ``config.yaml``; empty when missing.
    problems : tuple of str
        What could not be read, a line each.
    path_taught : trailmark.paths.Path or None
        The taught path that path offsets are about.
    beliefs : BeliefTable or None
        What was believed, with its covariance, evenly taken over the run.
    outlines : Outlines or None
        What stood around, and how large the robot is.
    true_places : paths.TaughtPlaces or None
        Where the places of the taught path really were.
    """

    path: Path
    trajectories: Mapping[str, Trajectory]
    truth: Trajectory | None
    estimates: EstimateTable | None
    run: Mapping[str, Any]
    timing: Mapping[str, Any]
    config_text: str
    problems: tuple[str, ...]
    path_taught: paths.Path | None = None
    beliefs: BeliefTable | None = None
    outlines: Outlines | None = None
    true_places: paths.TaughtPlaces | None = None

    @property
    def name(self) -> str:
        """Name of the folder; of the one it points at, when it is a link such as ``latest``."""
        return self.path.resolve().name

    def span_s(self) -> tuple[float, float] | None:
        """Return the time in which any localizer said anything, `Lost` included; None if none did [s]."""
        stamps = [stamp for item in self.trajectories.values() if len(item) for stamp in item.stamps_s[[0, -1]]]
        if self.estimates is not None and len(self.estimates):
            stamps += [self.estimates.stamp_s.min(), self.estimates.stamp_s.max()]
        return (float(min(stamps)), float(max(stamps))) if stamps else None


def read_run(folder: str | Path) -> RunFolder:
    """Read the folder of a run.

    Parameters
    ----------
    folder : str or Path
        The folder that ``trailmark run --out`` has written.

    Returns
    -------
    RunFolder
        What is in it; files that are missing are empty values.

    Raises
    ------
    DataError
        If the folder does not exist or no run has left anything in it.
    """
    path = Path(folder)
    if not path.is_dir():
        raise DataError(f"no folder {path}; a run's folder is printed at its end, the newest is runs/latest")
    tums = sorted((path / "trajectories").glob("*.tum"))
    if not tums and not (path / "run.json").is_file():
        is_bench = (path / "cells").is_dir()
        raise DataError(
            f"{path} is not the folder of a run: it has neither run.json nor trajectories/*.tum"
            + (f"; it is a bench: 'trailmark bench show {path}'" if is_bench else "")
        )
    problems: list[str] = []
    config_text = _attempt(path / "config.yaml", _text, problems) or ""
    read = {tum.stem: _attempt(tum, read_tum, problems) for tum in tums}
    truth = read.pop(GROUND_TRUTH, None)
    if truth is None:  # an empty one is known, and covers nothing
        truth = _attempt(path / f"{GROUND_TRUTH}.tum", read_tum, problems)
    found = {name: trajectory for name, trajectory in read.items() if trajectory is not None}
    return RunFolder(
        path=path,
        trajectories={name: found[name] for name in _in_order(found, config_text)},
        truth=truth,
        estimates=_attempt(path / "estimates.csv", read_estimates, problems),
        run=_attempt(path / "run.json", _json, problems) or {},
        timing=_attempt(path / "timing.json", _json, problems) or {},
        config_text=config_text,
        path_taught=_attempt(path / PATH_FILE, read_path, problems),
        beliefs=_attempt(path / BELIEFS_FILE, read_beliefs, problems),
        true_places=_attempt(path / TRUTH_FILE, read_taught_places, problems),
        outlines=_attempt(path / OUTLINES_FILE, read_outlines, problems),
        problems=tuple(problems),
    )


def _attempt(path: Path, read: Callable[[Path], T], problems: list[str]) -> T | None:
    """Return the content of a file; None where there is none or it cannot be read, with the problem noted."""
    if not path.is_file():
        return None
    try:
        return read(path)
    except DataError as error:
        problems.append(str(error))
        return None


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise DataError(f"cannot read {path.name}: {error.strerror or error}") from error


def _json(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(_text(path))
    except ValueError as error:
        raise DataError(f"{path.name} is not complete JSON: {error}") from error
    if not isinstance(document, dict):
        raise DataError(f"{path.name} must hold a mapping, not a {type(document).__name__}")
    return document


def _in_order(names: Mapping[str, object], config_text: str) -> list[str]:
    order = localizer_names(config_text)
    known = [name for name in order if name in names]
    rest = sorted(name for name in names if name not in order and name != FUSED)
    return [*known, *rest, *([FUSED] if FUSED in names else [])]


def localizer_names(config_text: str) -> list[str]:
    """Return the localizers of a ``config.yaml``, in its order; none of what is no config."""
    from ruamel.yaml import YAML  # here: importing the metrics stays cheap
    from ruamel.yaml.error import YAMLError

    try:
        document = YAML(typ="safe", pure=True).load(config_text)
    except YAMLError:
        return []  # the order is then that of the alphabet
    localizers = document.get("localizers") if isinstance(document, dict) else None
    return [str(name) for name in localizers] if isinstance(localizers, dict) else []
