"""The targets: each makes one case in a folder, and returns the command to give it to."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from tests.trust.storm.arguments import commands, grown_arguments
from tests.trust.storm.box import FILES, SOURCES, Box
from tests.trust.storm.files import companion, left_folder, messages, picture, recording, store
from tests.trust.storm.grammar import Grower, as_toml, as_yaml, spoil_document
from tests.trust.storm.oracle import GOOD_STORE

__all__ = ["TARGETS", "Case"]

Rng = np.random.Generator

#: What a localizer needs.
_FITTING = {
    **dict.fromkeys(("ground_vo", "ground_map", "klt", "orb", "phase_correlation"), "floor"),
    **dict.fromkeys(("column_ncc", "patch_ncc", "phase_shift", "divs", "omni_surf"), "front"),
    **dict.fromkeys(("kinect_flow", "kinect_landmarks", "kinect_motion", "orb_rgbd"), "kinect"),
    **dict.fromkeys(("imu", "pose_fixes"), "bag"),
    "laser_icp": "log",
}


@cache
def _grower() -> Grower:
    from trailmark.config.schema import run_config_schema
    from trailmark.plugins import load_plugins

    return Grower(run_config_schema(load_plugins()), FILES)


def config(rng: Rng, folder: Path, box: Box) -> tuple[list[str], dict[str, str | None]]:
    """A config grown from the schema, made wrong in some places, and run, taught or replayed."""
    grower = _grower()
    localizers = [str(name) for name in rng.choice(grower.names("localizer"), int(rng.integers(1, 3)), replace=False)]
    names = list(dict.fromkeys(_FITTING.get(name, "wheels") for name in localizers))
    if rng.random() < 0.3:
        names.append(str(rng.choice([name for name in SOURCES if name not in ("world", *names)])))
    if rng.random() < 0.04:
        names = ["world"]
    document: dict[str, Any] = {"sources": {name: deepcopy(SOURCES[name]) for name in names}}
    for name in names:
        if rng.random() < 0.3:
            more = grower.part("source", document["sources"][name]["plugin"], rng, 0.08)
            document["sources"][name] = more | document["sources"][name]
    density = float(rng.choice([0.0, 0.1, 0.3]))
    document["localizers"] = {
        f"l{i}": grower.part("localizer", name, rng, density) for i, name in enumerate(localizers)
    }
    if "wheels" in names and rng.random() < 0.7:
        document["localizers"]["wheels"] = {"plugin": "odometry"}
    for kind in ("estimator", "controller", "path_store"):
        if rng.random() < (0.6 if kind == "estimator" else 0.15):
            document[kind] = grower.part(kind, str(rng.choice(grower.names(kind))), rng)
            if rng.random() < 0.9:
                document[kind].pop("use", None)
    if rng.random() < 0.1:
        document["sinks"] = [{"plugin": "jsonl", "to": "out.jsonl"}]
    if rng.random() < 0.2:
        document |= {"mode": str(rng.choice(["track", "teach", "replay"])), "seed": int(rng.integers(5))}
    document = spoil_document(document, rng, int(rng.choice([0, 0, 0, 0, 1, 1, 2, 4])))
    _write(document, folder, rng)
    box.copy(("wheels.csv", "pictures", "kitti", "rgbd", "log.clf", "film.avi", "drive.mcap", GOOD_STORE), folder)
    name = "c.toml" if (folder / "c.toml").exists() else "c.yaml"
    kind = rng.random()
    if kind < 0.5:
        return ["run", name, "--out", "out", "--no-report"], {}
    if kind < 0.75:
        return ["teach", name, "--store", "new.trail", "--out", "out", "--no-report"], {}
    if kind < 0.85:
        return ["teach", name, "--store", GOOD_STORE, "--append", "--out", "out", "--no-report"], {}
    if kind < 0.95:
        return ["replay", name, "--store", GOOD_STORE, "--out", "out", "--no-report"], {}
    return ["inspect", name], {}


def _write(document: Any, folder: Path, rng: Rng) -> None:
    is_toml = rng.random() < 0.1
    try:
        text = as_toml(document) if is_toml else as_yaml(document, rng)
    except RecursionError:  # too deep for us to write it as a document
        text = f"sources{' = ' if is_toml else ': '}{'[' * 5000}"
    name = "c.toml" if is_toml else "c.yaml"
    (folder / name).write_text(text, encoding="utf-8", errors="surrogatepass")


def arguments(rng: Rng, folder: Path, box: Box) -> tuple[list[str], dict[str, str | None]]:
    """A call of any command, with values that may be wrong."""
    known = _commands()
    words = list(known)[int(rng.integers(len(known)))]
    box.copy(FILES, folder)
    return grown_arguments(words, known[words], FILES, rng), {}


_commands = cache(commands)
_SURROUNDINGS: dict[str, tuple[str | None, ...]] = {
    "HOME": (None, "", "/nowhere", "\udcff"),
    "COLUMNS": ("0", "-5", "1", "1000000", "x", ""),
    "LINES": ("0", "x"),
    "TERM": (None, "", "dumb", "x" * 300, "xterm-256color"),
    "NO_COLOR": ("1", ""),
    "FORCE_COLOR": ("1",),
    "LC_ALL": ("C", "x", "tr_TR.UTF-8", ""),
    "TZ": ("x/y", "", "Asia/Kathmandu"),
    "TRAILMARK_LOG": ("", "debug", "INFO", "0", "trace", "\u0130nfo"),
    "TRAILMARK_PLUGINS": ("", "sim", "datasets", "nothing", ",,", "datasets,baselines", "a" * 5000),
    "TRAILMARK_DEBUG": ("",),
    "TMPDIR": ("/nowhere", "", "/dev/null"),
    "MPLBACKEND": ("x", "agg", "TkAgg"),
    "MPLCONFIGDIR": ("",),
    "XDG_CACHE_HOME": ("",),
    "PWD": ("/nowhere",),
    "PYTHONWARNINGS": ("error",),
    "BROWSER": ("",),
    "EDITOR": ("",),
}


def surroundings(rng: Rng, folder: Path, box: Box) -> tuple[list[str], dict[str, str | None]]:
    """A good command in odd surroundings."""
    box.copy(("wheels.csv", "pictures", "run.yaml", "done", "truth.tum", GOOD_STORE, "drive.bag"), folder)
    odd: dict[str, str | None] = {}
    for name in rng.choice(list(_SURROUNDINGS), int(rng.integers(1, 4)), replace=False):
        values = _SURROUNDINGS[str(name)]
        odd[str(name)] = values[int(rng.integers(len(values)))]
    taken = (
        ["run", "run.yaml", "--out", "out"],
        ["run", "run.yaml", "--no-report"],
        ["inspect", "wheels.csv"],
        ["compare", "done"],
        ["store", "info", GOOD_STORE],
        ["evaluate", "truth.tum", "truth.tum"],
        ["plugins", "list"],
        ["doctor"],
        ["init"],
        ["inspect", "drive.bag"],
        ["-h"],
        ["run", "wheels.csv", "--localizer", "odometry"],
        ["schema"],
        ["plugins", "show", "odometry"],
        ["watch", "done", "--once"],
        ["teach", "run.yaml", "--store", "new.trail", "--out", "out", "--no-report"],
    )
    return list(taken[int(rng.integers(len(taken)))]), odd


#: Makes an input in a folder and returns arguments, and what the surroundings are to be.
Case = Callable[[Rng, Path, Box], tuple[list[str], dict[str, str | None]]]

TARGETS: dict[str, Case] = {
    case.__name__: case
    for case in (config, recording, messages, store, left_folder, companion, arguments, surroundings, picture)
}
