"""Runs of plain configs, and what becomes of them when an experiment is interrupted.

Written in the words of a config, so that every part can be swapped there: nothing here imports another plugin.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.experiments import ExperimentOptions
from trailmark.interfaces import Session
from trailmark.paths import Keyframe

__all__ = [
    "PAPER_MAP",
    "PIXEL_M",
    "SWAY_M",
    "course",
    "drive",
    "forget_finished",
    "keyframes",
    "photographs",
    "poles_of",
    "tracking_config",
]

#: Metres per pixel of the paper's camera, the mean over both axes: 200 x 188 mm on 512 x 480 px.
PIXEL_M = (0.200 / 512 * 0.188 / 480) ** 0.5
#: A path is taught by hand: the scripted route weaves about its line by this much, root mean square.
SWAY_M = 0.003
#: `ground_map` as the paper prints it.
PAPER_MAP: Mapping[str, Any] = {"high_pass": False, "refined": False, "min_groups": 4, "max_attempts": 1}

_DONE = "done.json"


def course(route: str, world_seed: int = 1, **keys: Any) -> dict[str, Any]:
    """Return the source: the vehicle of the paper on one of its courses."""
    sim = {"plugin": "sim", "world": "ground_course", "route": route, "sensors": ["floor"]}
    return sim | {"world_seed": world_seed, "sway_m": SWAY_M} | keys


def tracking_config(
    source: Mapping[str, Any],
    seed: int,
    *,
    repeat: float = 0.5,
    motion: Mapping[str, Any] | None = None,
    patches: Mapping[str, Any] | None = None,
    **keys: Any,
) -> dict[str, Any]:
    """Return the config of teaching and playback: the two localizers, dead reckoning, the paper's controller."""
    return {
        "sources": {"floor": dict(source)},
        "localizers": {
            "floor": {"plugin": "ground_vo", **(motion or {})},
            "floor_map": {"plugin": "ground_map", **(patches or {})},
        },
        "controller": {"plugin": "path_tracking_4ws", "repeat": repeat},
        "seed": seed,
        **keys,
    }


def drive(folder: Path, config: Mapping[str, Any], store: Path | None = None, mode: str = "track") -> Path:
    """Run a config into a folder, and return the folder.

    A long experiment that was interrupted goes on where it stopped: a run that this very request has finished in this
    folder is not repeated, until `forget_finished`.
    """
    from trailmark.api import run

    asked = {"config": config, "store": str(store), "mode": mode, "version": version("trailmark")}
    done = folder / _DONE
    if done.is_file() and json.loads(done.read_text(encoding="utf-8")) == json.loads(json.dumps(asked)):
        return folder
    access: Any = "overwrite" if mode == "teach" else None
    how: Any = mode
    run(config, folder, mode=how, store=store, access=access, overwrite=True, report=False)
    done.write_text(json.dumps(asked), encoding="utf-8")
    return folder


def forget_finished(out: Path) -> None:
    """Let the next experiment in this folder begin anew."""
    for done in out.glob(f"*/{_DONE}"):
        done.unlink()


def keyframes(store: Path, owner: str = "floor_map") -> Sequence[Keyframe]:
    """Return what a localizer registered while teaching."""
    from trailmark.api import create

    opened = create("path_store", "sqlite", path=str(store), access="read")
    opened.start(Session(mode="replay"))
    try:
        return list(opened.drawer(owner).keyframes())
    finally:
        opened.close()


def poles_of(source: Mapping[str, Any]) -> npt.NDArray[np.float64]:
    """Return the poles beside a course, (N, 3): x, y and radius [m]."""
    from trailmark.api import create

    keys = {key: value for key, value in source.items() if key != "plugin"}
    world = create("source", source["plugin"], **keys)
    world.start(Session(name="floor"))
    try:
        return np.asarray(world.world.truth["poles"], np.float64)
    finally:
        world.close()


def photographs(options: ExperimentOptions) -> dict[str, Path]:
    """Return photographs of floors by name; none in the quick version, or without ``TRAILMARK_DATA``."""
    data = os.environ.get("TRAILMARK_DATA")
    if options.quick or not data:
        return {}
    found = sorted((Path(data) / "ground").glob("*.jpg"))
    return {path.stem.removesuffix("_1k"): path for path in found}
