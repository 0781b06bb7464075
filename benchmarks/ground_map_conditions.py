"""What ground_map finds under the conditions of ground_conditions.py: right, or silent, never a wrong place.

    python benchmarks/ground_map_conditions.py [--floors planks grass_1k] [--conditions nominal ...]
                                               [--taught clean same] [--seeds 0] [--out FOLDER] [--markdown]

A path of 2.5 m is taught, in good light (``clean``) or under the condition itself (``same``: the same dirt sticks to
the lens when the path is taught), a picture every 8 mm. Then it is driven again: every 0.5 m the robot is put down anew
beside the path (8 mm and 1 deg, 1 sigma) with a belief that is wrong by as much, and one such stretch in five is ground
that was never taught. Motion is known in between, as wheels tell it. A place that was searched for in several pictures
counts once: for what was told, or for nothing.

* found: right answers of the searches on taught ground; wrong: answers more than 5 mm or 1 deg off, or of other ground;
* sure: wrong answers that are off by more than five of their own sigmas too, and all of other ground.

With ``--out`` it goes on where it ended; ``--markdown`` prints the table of the page in place of a line for each row.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from ground_conditions import CASES, RATE_HZ, SCALE_M, SIZE, STEP_PX, Case, Weather, sensor
from ground_scenes import data_folder, photographs

from trailmark.arrays import Grey8
from trailmark.estimates import Belief, Fix
from trailmark.frames import Frame, Image
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.testing import MemoryMap
from trailmark.testing.ground import GroundCamera, MirroredFloor
from trailmark_ground_vo.config import GroundMapConfig
from trailmark_ground_vo.map_localizer import GroundMap

CONDITIONS = tuple(name for name in CASES if name not in ("rest", "fast", "lost_frames"))
STEP_M, SPREAD_M, SPREAD_RAD = 20 * SCALE_M, 8e-3, math.radians(1.0)
#: How far the robot drives until it is put down anew [m], how often, and which of these stretches is other ground.
STRETCH_M, N_STRETCHES, OTHER = 0.5, 5, 4
WRONG_M, WRONG_RAD = 5e-3, math.radians(1.0)
COUNTS = ("n_taught", "n_other", "wrong", "sure")
SIGMAS = 5.0
#: Where other ground lies: farther than the path is long, on the same photograph [m].
OTHER_M = 3.37


class Eye:
    """The camera over a floor, under a condition."""

    def __init__(self, floor: str, case: Case, seed: int) -> None:
        texture = cv2.imread(str(data_folder() / f"{floor}.jpg"), cv2.IMREAD_GRAYSCALE)
        self._ground = MirroredFloor(np.asarray(texture, np.uint8), SCALE_M)
        self._camera = GroundCamera(SIZE, (SCALE_M, SCALE_M))
        self._case, self._seed = case, seed
        self._rng, self._index = np.random.default_rng([6, seed]), 0
        self._memory: dict[str, Any] = {}

    def see(self, pose: Pose2) -> Grey8:
        """Return the picture from a pose of base."""
        self._index += 1
        fixed = np.random.default_rng([5, self._seed])
        # half of the pictures lie in what the condition does to a part of the way
        at = Weather(40 + self._index % 80, 160, self._rng, fixed, pose, STEP_PX, self._memory)
        light = self._case.change(self._camera.view(self._ground, pose), at)
        assert light is not None
        noisy = light + np.float32(self._case.noise) * self._rng.standard_normal(light.shape, dtype=np.float32)
        return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def path(seed: int) -> list[Pose2]:
    """Return the poses of base in all pictures along a bend."""
    rng = np.random.default_rng([7, seed])
    start = Pose2(*rng.uniform(0.0, 1.0, 2).tolist(), float(rng.uniform(-math.pi, math.pi)))
    return [
        start @ Pose2.exp(n * STEP_M, 0.0, n * STEP_M / 1.5) for n in range(N_STRETCHES * round(STRETCH_M / STEP_M))
    ]


def taught(eye: Eye, poses: Sequence[Pose2]) -> MemoryMap:
    """Teach a path with true poses."""
    places, localizer = MemoryMap(), GroundMap(GroundMapConfig(camera="floor"))
    localizer.start(Session(name="floor_map", mode="teach", sensors={"floor": sensor()}, map=places))
    for index, pose in enumerate(poses):
        frame = Frame("floor", index / RATE_HZ, Image(eye.see(pose)))
        belief = Belief(frame.stamp_s, pose_map_base=pose, pose_odom_base=pose, travelled_m=index * STEP_M)
        localizer.observe(frame, belief)
    localizer.finish()
    return places


def searches(
    eye: Eye, places: MemoryMap, poses: Sequence[Pose2], seed: int
) -> Iterator[tuple[bool, Pose2, Fix | None]]:
    """Yield, for each place that was searched for, whether its ground was taught, the true pose, and the answer."""
    rng = np.random.default_rng([8, seed])
    localizer = GroundMap(GroundMapConfig(camera="floor"))
    localizer.start(Session(name="floor_map", mode="replay", sensors={"floor": sensor()}, map=places))
    n_stretch, silent = round(STRETCH_M / STEP_M), None  # what was searched for last, and not found so far
    for index, pose in enumerate(poses):
        stretch = index // n_stretch
        if index % n_stretch == 0:
            if silent is not None:
                yield silent[1:]
            silent = None
            off, wrong = (
                Pose2(*rng.normal(0.0, SPREAD_M, 2).tolist(), float(rng.normal(0.0, SPREAD_RAD))) for _ in range(2)
            )
        is_taught = stretch != OTHER
        truth = pose @ off
        there = truth if is_taught else Pose2(truth.x + OTHER_M, truth.y, truth.theta)
        frame = Frame("floor", index / RATE_HZ, Image(eye.see(there)))
        believed = truth @ wrong
        belief = Belief(frame.stamp_s, pose_map_base=believed, pose_odom_base=truth, travelled_m=index * STEP_M)
        said = localizer.observe(frame, belief)
        if not said:
            continue
        place = said[0].details["place"]
        if silent is not None and silent[0] != place:
            yield silent[1:]
        silent = place, is_taught, truth, None
        if isinstance(said[0], Fix):
            yield is_taught, truth, said[0]
            silent = None
    if silent is not None:
        yield silent[1:]


def is_within(error: Pose2, fix: Fix) -> bool:
    """Return whether an error is within five sigmas of the answer, in place and in heading."""
    x_m, y_m, heading_rad = np.sqrt(np.diag(np.linalg.pinv(fix.information)))
    is_near = math.hypot(error.x, error.y) <= SIGMAS * math.hypot(x_m, y_m)
    return bool(is_near and abs(error.theta) <= SIGMAS * heading_rad)


def measured(floor: str, condition: str, teaching: str, seed: int) -> dict[str, Any]:
    """Return how many searches were right, wrong and silent."""
    poses, case = path(seed), CASES[condition]
    places = taught(Eye(floor, CASES["nominal"] if teaching == "clean" else case, seed), poses)
    row: dict[str, Any] = {"floor": floor, "condition": condition, "taught": teaching, "seed": seed}
    row |= {"n_taught": 0, "found": 0, "n_other": 0, "wrong": 0, "sure": 0, "worst_mm": 0.0}
    for is_taught, truth, fix in searches(Eye(floor, case, seed), places, poses, seed):
        row["n_taught" if is_taught else "n_other"] += 1
        if fix is None:
            continue
        error = truth.between(fix.pose_map_base)
        is_right = is_taught and math.hypot(error.x, error.y) <= WRONG_M and abs(error.theta) <= WRONG_RAD
        row["found"] += is_right
        row["wrong"] += not is_right
        row["sure"] += not is_right and not (is_taught and is_within(error, fix))
        if is_taught:
            row["worst_mm"] = max(row["worst_mm"], 1e3 * math.hypot(error.x, error.y))
    return row


def page(rows: Sequence[dict[str, Any]]) -> str:
    """Return the sum, and a table: a line for each condition, over all floors."""
    n, other, wrong, sure = (sum(row[key] for row in rows) for key in COUNTS)
    floors = len({row["floor"] for row in rows})
    heads = "condition", "taught", "searches on taught / other ground", "found [%]", "of clean [%]"
    lines = [
        f"{n + other:,} searches on {floors} floors: {wrong} wrong, {sure} of them sure (bar: 0).",
        "",
        "| " + " | ".join([*heads, "wrong", "sure", "largest error [mm]"]) + " |",
        "|---" * 8 + "|",
    ]
    clean = _found(_of(rows, CONDITIONS[0], "clean"))
    for condition in CONDITIONS:
        for teaching in ("clean", "same"):
            if of := _of(rows, condition, teaching):
                n, other, wrong, sure = (sum(row[key] for row in of) for key in COUNTS)
                worst = max(row["worst_mm"] for row in of)
                share = "-" if math.isnan(clean) else f"{100 * _found(of) / clean:.1f}"
                cells = [f"{n} / {other}", f"{100 * _found(of):.1f}", share, f"{wrong}", f"{sure}", f"{worst:.2f}"]
                lines.append("| " + " | ".join([condition, teaching, *cells]) + " |")
    return "\n".join(lines) + "\n"


def _of(rows: Sequence[dict[str, Any]], condition: str, teaching: str) -> list[dict[str, Any]]:
    return [row for row in rows if (row["condition"], row["taught"]) == (condition, teaching)]


def _found(rows: Sequence[dict[str, Any]]) -> float:
    """Return the share of the searches on taught ground that were right; not a number without any."""
    n = sum(row["n_taught"] for row in rows)
    return sum(row["found"] for row in rows) / n if n else math.nan


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--floors", nargs="+", default=["planks", "grass_1k"])
    parser.add_argument("--conditions", nargs="+", default=list(CONDITIONS), choices=CONDITIONS)
    parser.add_argument("--taught", nargs="+", default=["clean", "same"], choices=["clean", "same"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--out", type=Path, help="folder of ground_map_conditions.jsonl")
    parser.add_argument("--markdown", action="store_true", help="the table of the page")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rows = {_key(row): row for row in _kept(options.out)}
    floors = [floor for floor in options.floors if floor in photographs()]
    for seed, floor, condition, teaching in product(options.seeds, floors, options.conditions, options.taught):
        if (floor, condition, teaching, seed) in rows:
            continue
        row = measured(floor, condition, teaching, seed)
        rows[_key(row)] = row
        if not options.markdown:
            print(json.dumps(row), flush=True)
        if options.out is not None:
            with _file(options.out).open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
    if options.markdown:
        print(page(list(rows.values())))


def _key(row: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(row[name] for name in ("floor", "condition", "taught", "seed"))


def _kept(folder: Path | None) -> list[dict[str, Any]]:
    if folder is None or not _file(folder).is_file():
        return []
    return [json.loads(line) for line in _file(folder).read_text(encoding="utf-8").splitlines()]


def _file(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder / "ground_map_conditions.jsonl"


if __name__ == "__main__":
    main()
