"""The courses of the paper and the configs that drive them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.experiments import ExperimentOptions
from trailmark.interfaces import Mode
from trailmark_papers.kit import run_config, sim_source, started_source, world_of

__all__ = ["PIXEL_M", "SWAY_M", "course", "drive", "keys_of", "photographs", "poles_of", "tracking_config"]

#: Metres per pixel of the paper's camera, the mean over both axes: 200 x 188 mm on 512 x 480 px.
PIXEL_M = (0.200 / 512 * 0.188 / 480) ** 0.5
#: A path is taught by hand: the scripted route weaves about its line by this much, root mean square.
SWAY_M = 0.003


def course(route: str, world_seed: int = 1, **keys: Any) -> dict[str, Any]:
    """Return the source: the vehicle of the paper on one of its courses."""
    common = {"route": route, "sensors": ["floor"], "world_seed": world_seed, "sway_m": SWAY_M}
    return sim_source("ground_course", **(common | keys))


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


def keys_of(method: str) -> dict[str, Any]:
    """Return the keys of both localizers: none for ``refined``, the defaults; the preset for ``paper``."""
    return {"preset": "paper"} if method == "paper" else {}


def drive(folder: Path, config: Mapping[str, Any], store: Path | None = None, mode: Mode = "track") -> Path:
    """Run a config into a folder, and return the folder."""
    run_config(config, folder, mode, store=store)
    return folder


def poles_of(source: Mapping[str, Any]) -> Floats:
    """Return the poles beside a course, (N, 3): x, y and radius [m]."""
    with started_source(source, name="floor") as floor:
        return np.asarray(world_of(floor).truth["poles"], np.float64)


def photographs(options: ExperimentOptions) -> dict[str, Path]:
    """Return photographs of floors by name; none in the quick version, or without ``TRAILMARK_DATA``."""
    data = os.environ.get("TRAILMARK_DATA")
    if options.quick or not data:
        return {}
    found = sorted((Path(data) / "ground").glob("*.jpg"))
    return {path.stem.removesuffix("_1k"): path for path in found}
