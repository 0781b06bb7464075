"""All four methods, closed loop, one robot: how far off its path does it run by all of them, and by each alone?

The robot of `examples/fusion/all_four_driven.yaml` is taught a way through the supermarket, put down 30 mm and 2 deg
off its start, and drives the way again by its belief alone with `path_tracking`. A place is another supermarket: other
goods, signs and ground (`world_seed`).

    python benchmarks/closed_loop_four.py DIR [--places 1 2] [--seconds 10]

DIR keeps the taught paths: what is there is not taught again.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

import trailmark
from trailmark.evaluation import collisions_of
from trailmark.geometry import Trajectory, read_tum, write_tum

EXAMPLE = Path(__file__).parents[1] / "examples" / "fusion" / "all_four_driven.yaml"
#: Who leads, and the sensors that they look at; the wheels give motion where nobody else does.
TEAMS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "all four": (
        ("wheels", "floor", "floor_map", "omni", "laser", "kinect", "streams"),
        ("wheels", "floor", "laser", "front", "rgbd", "omni"),
    ),
    "ground": (("floor", "floor_map"), ("floor",)),
    "omni, laser, wheels": (("wheels", "omni", "laser"), ("wheels", "omni", "laser")),
    "kinect, wheels": (("wheels", "kinect"), ("wheels", "rgbd")),
    "divs, wheels": (("wheels", "streams"), ("wheels", "front")),
}
LIMIT_S = 40.0
START = [1.0, 2.0, 0.0]


def config_of(team: str, place: int, seconds: float) -> dict[str, Any]:
    """Return the example's config for a team and a place."""
    config: dict[str, Any] = YAML(typ="safe").load(EXAMPLE.read_text(encoding="utf-8"))
    names, sensors = TEAMS[team]
    robot = config["sources"]["robot"]
    robot |= {"sensors": list(sensors), "world_seed": place, "duration_s": seconds}
    robot["rates_hz"] = {sensor: rate for sensor, rate in robot["rates_hz"].items() if sensor in sensors}
    config["localizers"] = {name: config["localizers"][name] for name in names}
    known = config["estimator"]["sources"]
    config["estimator"]["sources"] = {name: known[name] for name in known if name in names}
    return config


def taught(folder: Path, place: int, seconds: float) -> Trajectory:
    """Teach a place, unless it was; return the true way."""
    way = folder / f"place_{place}.tum"
    if not way.exists():
        config = config_of("all four", place, seconds) | {"start": START, "seed": 100}
        store = folder / f"place_{place}.trail"
        result = trailmark.run(config, mode="teach", store=store, overwrite=True, report=False)
        assert result.ground_truth is not None
        write_tum(way, result.ground_truth)
    return read_tum(way)


def off_mm(way: Trajectory, driven: Trajectory) -> np.ndarray:
    """Return how far from the way of teaching each place of a drive was, (N,)."""
    points = way.positions[np.append(True, np.linalg.norm(np.diff(way.positions, axis=0), axis=1) > 1e-5)]
    a, b = points[:-1, None], points[1:, None]
    along = b - a
    share = np.clip(((driven.positions[None] - a) * along).sum(2) / (along**2).sum(2), 0.0, 1.0)
    return np.asarray(1e3 * np.linalg.norm(driven.positions[None] - a - share[..., None] * along, axis=2).min(0))


def driven(folder: Path, team: str, place: int, way: Trajectory) -> str:
    """Drive the way by a team; return a row of the table."""
    config = config_of(team, place, LIMIT_S) | {"start": "first", "seed": place}
    result = trailmark.run(config, mode="replay", store=folder / f"place_{place}.trail", report=False)
    assert result.ground_truth is not None
    off = off_mm(way, result.ground_truth)
    end = 1e3 * float(np.linalg.norm(result.ground_truth.positions[-1] - way.positions[-1]))
    touched = collisions_of(result.counters)
    figures = f"{off.mean():.1f} | {off.max():.1f} | {end:.0f} | {touched}"
    return f"| {place} | {team} | {figures} | {result.reason or result.status} |"


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--places", type=int, nargs="+", default=[1])
    parser.add_argument("--seconds", type=float, default=10.0)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    print(f"load {os.getloadavg()[0]:.1f} for {os.cpu_count()} cores\n")
    print("| place | led by | mean [mm] | largest [mm] | off the end [mm] | collisions | end |")
    print("|--:|---|--:|--:|--:|--:|---|", flush=True)
    for place in given.places:
        way = taught(given.folder, place, given.seconds)
        for team in TEAMS:
            print(driven(given.folder, team, place, way), flush=True)


if __name__ == "__main__":
    main()
