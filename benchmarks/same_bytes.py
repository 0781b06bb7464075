"""Ten runs in two checkouts: are estimates and trajectories the same bytes?

A change of structure changes no figure. Each run is made by the checkout's own interpreter, into a folder of its own::

    python benchmarks/same_bytes.py --before ../old            # ../old has an environment of its own in ../old/.venv
    python benchmarks/same_bytes.py --before ../old --only mrclam,faults

Recordings are found by ``TRAILMARK_DATA``. Exit code 1 if a file differs or a run fails in one of the two.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

_COURSE = """\
sources: {robot: {plugin: sim, world: ground_course, route: straight, sensors: [wheels, floor], duration_s: 4}}
localizers:
  floor: {plugin: ground_vo, camera: floor}
  floor_map: {plugin: ground_map, camera: floor, async: true, latency_ms: 120}
  wheels: {plugin: odometry}
estimator: {plugin: kalman}
path_store: {plugin: sqlite, spacing_m: 0.05}
"""
_FAULTS = """\
sources:
  robot:
    plugin: sim
    world: ground_course
    route: straight
    sensors: [wheels, floor]
    duration_s: 3
    perturb: {sensors: [floor], noise: 6, blur_px: 1.5, flicker: 0.02, dropped: 0.05, missing_s: [1.0, 1.2]}
localizers: {floor: {plugin: ground_vo, camera: floor}, wheels: {plugin: odometry}}
estimator: {plugin: kalman, use: [floor, wheels]}
"""
_TWO_SPEEDS = """\
sources:
  robot: {plugin: sim, world: supermarket, route: round, driver: route, sensors: [wheels, laser], duration_s: 5}
localizers:
  wheels: {plugin: odometry}
  laser: {plugin: laser_icp, laser: laser, async: true, latency_ms: 150}
estimator: {plugin: kalman}
start: [1.0, 2.0, 0.0]
"""

#: Name of a run -> the commands that make it; OUT is its folder, a word in capitals a config written from above.
RUNS: dict[str, list[str]] = {
    "husky": ["run examples/real/husky_bag.yaml --out OUT --set sources.bag.stop_s=40"],
    "mrclam": ["run examples/real/mrclam_odometry.yaml --out OUT --set sources.wheels.stop_s=120"],
    "tum": ["run examples/real/tum_rgbd.yaml --out OUT --set sources.kinect.stop_s=2"],
    "photo": ["run examples/real/ground_photo.yaml --out OUT --set sources.floor.duration_s=3"],
    "omni": ["run examples/fusion/ground_omni.yaml --out OUT --set sources.robot.duration_s=4"],
    "streams": [
        "teach examples/fusion/ground_divs.yaml --store OUT/a.trail --out OUT/teach --set sources.robot.duration_s=4",
        "run examples/fusion/ground_divs.yaml --store OUT/a.trail --out OUT/again --set sources.robot.duration_s=4",
    ],
    "kinect": ["run examples/fusion/wheels_kinect.yaml --out OUT --set sources.robot.duration_s=6"],
    "late": ["run TWO_SPEEDS --out OUT"],
    "faults": ["run FAULTS --out OUT"],
    "taught": [
        "teach COURSE --store OUT/place.trail --out OUT/teach",
        "run COURSE --store OUT/place.trail --out OUT/again",
    ],
}
_CONFIGS = {"COURSE": _COURSE, "FAULTS": _FAULTS, "TWO_SPEEDS": _TWO_SPEEDS}


def bytes_of(top: Path, name: str, folder: Path) -> dict[str, str]:
    """Return the checksums of what a run leaves, by file, or how it failed."""
    out = folder / name
    out.mkdir(parents=True)
    words = {"OUT": str(out)}
    for key, text in _CONFIGS.items():
        (folder / f"{key.lower()}.yaml").write_text(text)
        words[key] = str(folder / f"{key.lower()}.yaml")
    for command in RUNS[name]:
        arguments = [str(top / ".venv" / "bin" / "trailmark")]
        for word in command.split():
            head, slash, rest = word.partition("/")
            arguments.append(words.get(head, head) + slash + rest)
        overwrite = ["--overwrite"] if "--out OUT " in f"{command} " else []
        done = subprocess.run(
            [*arguments, "--no-report", *overwrite], cwd=top, capture_output=True, text=True, check=False
        )
        if done.returncode:
            return {"failed": f"{command}: exit {done.returncode}: {done.stderr.strip().splitlines()[-1:]}"}
    files = sorted([*out.rglob("estimates.csv"), *out.rglob("*.tum")])
    return {str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def main() -> None:
    """Run both checkouts, print a row a run."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--before", type=Path, required=True, help="another checkout, with its environment in .venv")
    parser.add_argument("--only", default=",".join(RUNS), help="names of runs, separated by commas")
    options = parser.parse_args()
    here, there = Path(__file__).resolve().parents[1], options.before.resolve()
    os.environ.setdefault("TRAILMARK_DATA", str(here.parent / "shared" / "data"))
    n_bad = 0
    with tempfile.TemporaryDirectory() as folder:
        for name in options.only.split(","):
            before, now = (bytes_of(top, name, Path(folder) / side) for side, top in (("before", there), ("now", here)))
            differing = sorted(file for file in before.keys() | now.keys() if before.get(file) != now.get(file))
            failed = [found["failed"] for found in (before, now) if "failed" in found]
            n_bad += bool(differing or failed)
            verdict = (
                f"failed: {failed}" if failed else f"differ: {differing}" if differing else f"{len(now)} files the same"
            )
            print(f"{name:10} {verdict}", flush=True)
    sys.exit(1 if n_bad else 0)


if __name__ == "__main__":
    main()
