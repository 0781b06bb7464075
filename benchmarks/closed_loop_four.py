"""All four methods, closed loop, one robot: how far off its path does it run by all, by pairs, by each alone?

The robot of `examples/fusion/all_four_driven.yaml` (supermarket) or `all_four_street.yaml` is taught a way, put down
30 mm and 2 deg off its start, and drives the way again by its belief alone with `path_tracking`. A place is another
supermarket or street: other goods, houses, signs and ground (`world_seed`).

    python benchmarks/closed_loop_four.py DIR [--places supermarket:1 street:1] [--page FILE]

DIR keeps taught paths and drives: what is there is not done again, so that it can be ended and gone on with.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

import trailmark
from trailmark.evaluation import collisions_of
from trailmark.geometry import Trajectory, read_tum, write_tum

EXAMPLES = Path(__file__).parents[1] / "examples" / "fusion"
CONFIGS = {"supermarket": EXAMPLES / "all_four_driven.yaml", "street": EXAMPLES / "all_four_street.yaml"}
PLACES = ("supermarket:1", "street:1", "supermarket:2", "street:2", "supermarket:3")
#: Localizers and sensors of each method.
METHODS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "ground": (("floor", "floor_map"), ("floor",)),
    "omni": (("omni",), ("omni",)),
    "kinect": (("kinect",), ("rgbd",)),
    "divs": (("streams",), ("front",)),
    "laser": (("laser",), ("laser",)),
}
FOUR = ("ground", "omni", "kinect", "divs")
ALL = "all four and laser"
#: Who leads; the wheels are with each of them.
TEAMS: Mapping[str, tuple[str, ...]] = {
    ALL: (*FOUR, "laser"),
    "all four": FOUR,
    **{f"{a}, {b}": (a, b) for a, b in combinations(FOUR, 2)},
    **{name: (name,) for name in METHODS},
}
LIMIT_S = 40.0
BAR_MM = 8.0
ARRIVED = "the end of the path is reached"


@dataclass(frozen=True)
class Drive:
    """One drive of a taught way: who led, and how far from the way of teaching the robot was.

    Offsets are those of the true place, that of the start included [mm].
    """

    place: str
    team: str
    mean_mm: float
    largest_mm: float
    off_the_end_mm: float
    collisions: int
    end: str
    cpu_s: float
    commit: str


def config_of(methods: Sequence[str], place: str) -> dict[str, Any]:
    """Return the example's config for a place and who leads there; nobody: the wheels alone."""
    world, _, number = place.partition(":")
    config: dict[str, Any] = YAML(typ="safe").load(CONFIGS[world].read_text(encoding="utf-8"))
    names = ["wheels"] + [name for method in methods for name in METHODS[method][0]]
    sensors = ["wheels"] + [sensor for method in methods for sensor in METHODS[method][1]]
    robot = config["sources"]["robot"]
    robot |= {"sensors": sensors, "world_seed": int(number)}
    robot["rates_hz"] = {sensor: rate for sensor, rate in robot["rates_hz"].items() if sensor in sensors}
    config["localizers"] = {name: options for name, options in config["localizers"].items() if name in names}
    known = config["estimator"]["sources"]
    config["estimator"]["sources"] = {name: known[name] for name in known if name in names}
    return config


def taught(folder: Path, place: str) -> Trajectory:
    """Teach a place, unless it was; return the true way."""
    way, store = folder / f"{place.replace(':', '_')}.tum", folder / f"{place.replace(':', '_')}.trail"
    if not way.exists():
        config = config_of(TEAMS[ALL], place) | {"start": [0.0, 0.0, 0.0], "seed": 100}
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


def drive(folder: Path, team: str, place: str, way: Trajectory) -> Drive:
    """Drive the way by a team."""
    config, began_s = config_of(TEAMS[team], place), time.process_time()
    config["sources"]["robot"]["duration_s"] = LIMIT_S
    config |= {"start": "first", "seed": int(place.partition(":")[2])}
    store = folder / f"{place.replace(':', '_')}.trail"
    result = trailmark.run(config, mode="replay", store=store, report=False)
    assert result.ground_truth is not None
    off = off_mm(way, result.ground_truth)
    return Drive(
        place,
        team,
        mean_mm=round(float(off.mean()), 2),
        largest_mm=round(float(off.max()), 1),
        off_the_end_mm=round(1e3 * float(np.linalg.norm(result.ground_truth.positions[-1] - way.positions[-1]))),
        collisions=collisions_of(result.counters),
        end=result.reason or result.status,
        cpu_s=round(time.process_time() - began_s, 1),
        commit=_commit(),
    )


def drives_of(folder: Path, places: Sequence[str]) -> list[Drive]:
    """Return the drives of all teams in places: those in the folder, and those that are missing."""
    folder.mkdir(parents=True, exist_ok=True)
    kept = folder / "drives.jsonl"
    known = [Drive(**json.loads(line)) for line in kept.read_text().splitlines()] if kept.exists() else []
    drives = []
    for place in places:
        for team in TEAMS:
            found = next((one for one in known if (one.place, one.team) == (place, team)), None)
            if found is None:
                found = drive(folder, team, place, taught(folder, place))
                with kept.open("a") as file:
                    file.write(json.dumps(asdict(found)) + "\n")
            print(_row(found), flush=True)
            drives.append(found)
    return drives


def _commit() -> str:
    git = ["git", "-C", str(EXAMPLES)]
    said = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False)
    return said.stdout.strip() or "unknown"


# --- the page --------------------------------------------------------------------------------------------------------

HEAD = "| place | led by | mean [mm] | largest [mm] | off the end [mm] | collisions | end of the run |\n" + (
    "|---|---|--:|--:|--:|--:|---|"
)


def _row(one: Drive) -> str:
    figures = f"{one.mean_mm:.1f} | {one.largest_mm:.1f} | {one.off_the_end_mm:.0f} | {one.collisions}"
    return f"| {one.place.replace(':', ' ')} | {one.team} | {figures} | {one.end} |"


def _summary(team: str, drives: Sequence[Drive]) -> str:
    own = [one for one in drives if one.team == team]
    there, touched = sum(one.end == ARRIVED for one in own), sum(one.collisions for one in own)
    means = [one.mean_mm for one in own]
    figures = f"{np.mean(means):.1f} | {min(means):.1f} | {max(means):.1f}"
    return f"| {team} | {there} of {len(own)} | {touched} | {figures} | {max(one.largest_mm for one in own):.1f} |"


def verdicts(drives: Sequence[Drive]) -> list[str]:
    """Return a line for each part of the bar, of all four with the laser and without."""
    lines = []
    for team in (ALL, "all four"):
        own = {one.place: one for one in drives if one.team == team}
        worst, touched = max(one.mean_mm for one in own.values()), sum(one.collisions for one in own.values())
        # alone: one method, without it or the laser where the team has none
        alone = [one for one in drives if TEAMS[one.team] in [(name,) for name in TEAMS[team]]]
        lost_to = [
            f"{one.team} in {one.place.replace(':', ' ')}" for one in alone if one.mean_mm <= own[one.place].mean_mm
        ]
        held = "held" if worst <= BAR_MM and not touched and not lost_to else "missed"
        lines.append(
            f"- **{team}: {held}.** Mean offset {np.mean([one.mean_mm for one in own.values()]):.1f} mm, in the worst"
            f" place {worst:.1f} mm (bar {BAR_MM:g}); {touched} collisions; better than each alone in every place:"
            f" {'yes' if not lost_to else 'not than ' + ', '.join(lost_to)}."
        )
    return lines


def page_of(drives: Sequence[Drive]) -> str:
    """Return the results as a page."""
    places = list(dict.fromkeys(one.place for one in drives))
    commits = ", ".join(dict.fromkeys(one.commit for one in drives))
    lines = [
        "# Closed loop: four methods, one robot\n",
        f"`python benchmarks/closed_loop_four.py DIR --places {' '.join(places)}`, commit {commits}, trailmark"
        f" {trailmark.__version__}, Python {platform.python_version()}; {sum(one.cpu_s for one in drives) / 60.0:.0f}"
        " minutes of one core for the drives, teaching apart. The configs are `examples/fusion/all_four_driven.yaml`"
        " (supermarket, holonomic, 0.4 m/s) and `examples/fusion/all_four_street.yaml` (street, differential drive,"
        " 0.3 m/s). A robot is taught 4 m of a way with a bend, put down 30 mm and 2 degrees off its start, and drives"
        " the way again with `path_tracking`, by its belief alone: led by `ground_vo` and `ground_map` (ground),"
        " `omni_surf`, `kinect_landmarks`, `divs` and `laser_icp`, by pairs of them, or by one; the wheels are with"
        " each. Offsets are those of the true place from the true way of teaching, the 30 mm of the start included."
        f" A place is another supermarket or street (goods, houses, signs, ground); n = {len(places)} places, one"
        " drive each.\n",
        f"Bar: mean offset of all four <= {BAR_MM:g} mm, no collision, better than each alone in every place.\n",
        *verdicts(drives),
        "\n| led by | arrived | collisions | mean [mm], all places | best place | worst place | largest [mm] |",
        "|---|--:|--:|--:|--:|--:|--:|",
        *(_summary(team, drives) for team in dict.fromkeys(one.team for one in drives)),
        "\nGround alone searches 17 mm around the start, and was put down 30 mm off it. A robot that never finds itself"
        " drives on by its motion, beside the path where it was put down, and stands after 2 m without a fix"
        " (`max_fix_age_m`), which ends the run (done). In the street's bend `divs` is told little, because streams"
        " are blind in a turn; the simulated depth camera is not blinded by the sun, as a real one is.\n",
        "## Drives\n",
        HEAD,
        *(_row(one) for one in drives),
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, and print a table or write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--places", nargs="+", default=list(PLACES), help="WORLD:SEED")
    parser.add_argument("--page", type=Path, help="write the page here")
    given = parser.parse_args()
    print(f"load {os.getloadavg()[0]:.1f} for {os.cpu_count()} cores\n\n{HEAD}", flush=True)
    drives = drives_of(given.folder, given.places)
    if given.page is not None:
        given.page.write_text(page_of(drives), encoding="utf-8")


if __name__ == "__main__":
    main()
