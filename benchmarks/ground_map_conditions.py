"""What ground_map finds under the conditions of ground_conditions.py: right, or silent, never a wrong place.

    python benchmarks/ground_map_conditions.py [--floors planks grass_1k] [--conditions nominal ...]
                                               [--taught clean same] [--seeds 0] [--jobs 2] [--out FOLDER] [--markdown]

A path of 2.5 m is taught, in good light (``clean``) or under the condition itself (``same``: the same dirt sticks to
the lens when the path is taught), a picture every 8 mm. Then it is driven again: every 0.5 m the robot is put down anew
beside the path (8 mm and 1 deg, 1 sigma) with a belief that is wrong by as much, and one such stretch in five is ground
that was never taught. Motion is known in between, as wheels tell it. A place that was searched for in several pictures
counts once: for what was told, or for nothing.

All conditions see the same clean pictures and the same noise, which are made once for a floor and a seed.

* found: right answers of the searches on taught ground; wrong: answers more than 5 mm or 1 deg off, or of other ground;
* heading told: of the right answers, those that tell the heading too, that is to better than 1 deg; a heading that is
  not told is wrong where it is more than five of its own sigmas off;
* sure: wrong answers that are off by more than five of their own sigmas too, and all of other ground.

Some photographs show the same pieces several times. Their other ground is the taught one again: no patch can tell, and
what is said there stands in a row of its own.

With ``--out`` it goes on where it ended; ``--markdown`` prints the table of the page in place of a line for each row.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from ground_conditions import CASES, RATE_HZ, SCALE_M, SIZE, STEP_PX, Weather, sensor
from ground_jobs import in_turn
from ground_scenes import data_folder, photographs

from trailmark.arrays import GreyF
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
#: Where patches are registered, and searched for [m].
SPACING_M, REACH_M = (GroundMapConfig.model_fields[name].default for name in ("spacing_m", "reach_m"))
CLEAN = "nominal"
COUNTS = ("n_taught", "n_other", "wrong", "sure")
SIGMAS = 5.0
#: Where other ground lies: farther than the path is long, on the same photograph [m].
OTHER_M = 3.37
#: Photographs that show the same piece several times: their other ground is the taught one again, and has its own row.
REPEATING = ("artificial_turf_1k",)
COPIES = "copies of the taught ground"


class Scene:
    """The camera over a floor: clean pictures and the noise of one standard deviation, the same for all conditions."""

    def __init__(self, floor: str, seed: int) -> None:
        texture = cv2.imread(str(data_folder() / f"{floor}.jpg"), cv2.IMREAD_GRAYSCALE)
        self._ground = MirroredFloor(np.asarray(texture, np.uint8), SCALE_M)
        self._camera, self._seed = GroundCamera(SIZE, (SCALE_M, SCALE_M)), seed

    def see(self, pose: Pose2, index: int, is_taught: bool) -> tuple[GreyF, GreyF]:
        """Return the light from a pose of base, and the noise of a picture."""
        rng = np.random.default_rng([6, self._seed, index, int(is_taught)])
        return self._camera.view(self._ground, pose), rng.standard_normal((SIZE[1], SIZE[0]), dtype=np.float32)


class Eye:
    """The camera under a condition."""

    def __init__(self, condition: str, seed: int) -> None:
        self._case, self._seed = CASES[condition], seed
        self._rng = np.random.default_rng([10, seed])
        self._memory: dict[str, Any] = {}

    def see(self, seen: tuple[GreyF, GreyF], index: int, pose: Pose2) -> Frame:
        """Return the frame of a picture."""
        light, noise = seen
        fixed = np.random.default_rng([5, self._seed])
        # half of the pictures lie in what the condition does to a part of the way
        at = Weather(40 + index % 80, 160, self._rng, fixed, pose, STEP_PX, self._memory)
        changed = self._case.change(light, at)
        assert changed is not None
        pixels = np.clip(np.rint(changed + np.float32(self._case.noise) * noise), 0, 255).astype(np.uint8)
        return Frame("floor", index / RATE_HZ, Image(pixels))


def path(seed: int) -> list[Pose2]:
    """Return the poses of base in all pictures along a bend."""
    rng = np.random.default_rng([7, seed])
    start = Pose2(*rng.uniform(0.0, 1.0, 2).tolist(), float(rng.uniform(-math.pi, math.pi)))
    return [
        start @ Pose2.exp(n * STEP_M, 0.0, n * STEP_M / 1.5) for n in range(N_STRETCHES * round(STRETCH_M / STEP_M))
    ]


def taught(scene: Scene, poses: Sequence[Pose2], conditions: Collection[str], seed: int) -> dict[str, MemoryMap]:
    """Teach a path with true poses under each condition; of the pictures that are registered alone."""
    maps = {condition: MemoryMap() for condition in conditions}
    eyes = {condition: Eye(condition, seed) for condition in conditions}
    localizers = {condition: started("teach", places) for condition, places in maps.items()}
    next_m = 0.0
    for index, pose in enumerate(poses):
        way_m = index * STEP_M
        if way_m < next_m:
            continue
        next_m = (math.floor(way_m / SPACING_M) + 1) * SPACING_M
        seen = scene.see(pose, index, True)
        for condition, localizer in localizers.items():
            frame = eyes[condition].see(seen, index, pose)
            localizer.observe(frame, Belief(frame.stamp_s, pose, pose_odom_base=pose, travelled_m=way_m))
    for localizer in localizers.values():
        localizer.finish()
    return maps


def started(mode: Literal["teach", "replay"], places: MemoryMap) -> GroundMap:
    """Return a localizer with its defaults, started."""
    localizer = GroundMap(GroundMapConfig(camera="floor"))
    localizer.start(Session(name="floor_map", mode=mode, sensors={"floor": sensor()}, map=places))
    return localizer


@dataclass(frozen=True)
class Look:
    """A picture of the second drive.

    Attributes
    ----------
    index : int
        Its number.
    stretch : int
        How often the robot has been put down anew.
    truth, believed : Pose2
        Of base.
    """

    index: int
    stretch: int
    truth: Pose2
    believed: Pose2

    @property
    def is_taught(self) -> bool:
        """Whether its ground was taught."""
        return self.stretch != OTHER

    @property
    def there(self) -> Pose2:
        """Where the camera looks from."""
        return self.truth if self.is_taught else Pose2(self.truth.x + OTHER_M, self.truth.y, self.truth.theta)


def looks(poses: Sequence[Pose2], places: MemoryMap, seed: int) -> Iterator[Look]:
    """Yield the pictures in which a patch may be searched for; the others nobody would look at."""
    rng, n_stretch = np.random.default_rng([8, seed]), round(STRETCH_M / STEP_M)
    registered = [keyframe.pose_map_base for keyframe in places.keyframes()]
    for index, pose in enumerate(poses):
        if index % n_stretch == 0:
            off, wrong = (
                Pose2(*rng.normal(0.0, SPREAD_M, 2).tolist(), float(rng.normal(0.0, SPREAD_RAD))) for _ in range(2)
            )
        believed = pose @ off @ wrong
        if any(believed.distance_to(place) <= REACH_M for place in registered):
            yield Look(index, index // n_stretch, pose @ off, believed)


@dataclass
class Searcher:
    """A localizer on the second drive, and what came of its searches: a place counts once, however often it was tried.

    Attributes
    ----------
    localizer : GroundMap
        Started.
    searches : list of (Look, Fix or None)
        For each place, the picture and the answer; the last picture where there was none.
    """

    localizer: GroundMap
    searches: list[tuple[Look, Fix | None]] = field(default_factory=list)
    _open: tuple[int, float] | None = None

    def observe(self, frame: Frame, look: Look) -> None:
        """Give it a picture."""
        belief = Belief(frame.stamp_s, look.believed, pose_odom_base=look.truth, travelled_m=look.index * STEP_M)
        said = self.localizer.observe(frame, belief)
        if not said:
            return
        place = look.stretch, said[0].details["place"]
        if place == self._open:
            self.searches.pop()
        answer = said[0] if isinstance(said[0], Fix) else None
        self.searches.append((look, answer))
        self._open = place if answer is None else None


def is_within(error: Pose2, fix: Fix) -> bool:
    """Return whether an error is within five sigmas of the answer, in place and in heading."""
    x_m, y_m, heading_rad = np.sqrt(np.diag(np.linalg.pinv(fix.information)))
    is_near = math.hypot(error.x, error.y) <= SIGMAS * math.hypot(x_m, y_m)
    return bool(is_near and abs(error.theta) <= SIGMAS * heading_rad)


def measured(floor: str, seed: int, wanted: Mapping[str, Collection[str]]) -> Iterator[dict[str, Any]]:
    """Yield how many searches were right, wrong and silent, for each condition and teaching of `wanted`.

    All see the same clean pictures with the same noise, which are made once.
    """
    poses, scene = path(seed), Scene(floor, seed)
    same = {condition for condition, teachings in wanted.items() if "same" in teachings}
    maps = taught(scene, poses, {CLEAN} | same, seed)
    eyes = {condition: Eye(condition, seed) for condition in wanted}
    searchers = {
        (condition, teaching): Searcher(started("replay", maps[CLEAN if teaching == "clean" else condition]))
        for condition, teachings in wanted.items()
        for teaching in teachings
    }
    for look in looks(poses, maps[CLEAN], seed):
        seen = scene.see(look.there, look.index, False)
        for condition, teachings in wanted.items():
            frame = eyes[condition].see(seen, look.index, look.there)
            for teaching in teachings:
                searchers[condition, teaching].observe(frame, look)
    for (condition, teaching), searcher in searchers.items():
        row = {"floor": floor, "condition": condition, "taught": teaching, "seed": seed}
        if floor in REPEATING:
            copies = judged([search for search in searcher.searches if not search[0].is_taught])
            yield row | {"floor": f"{COPIES}, {floor}"} | copies
        is_asked = floor not in REPEATING
        yield row | judged([search for search in searcher.searches if is_asked or search[0].is_taught])


def judged(searches: Sequence[tuple[Look, Fix | None]]) -> dict[str, float]:
    """Return the counts of a row."""
    row = {"n_taught": 0, "found": 0, "headings": 0, "n_other": 0, "wrong": 0, "sure": 0, "worst_mm": 0.0}
    for look, fix in searches:
        row["n_taught" if look.is_taught else "n_other"] += 1
        if fix is None:
            continue
        error = look.truth.between(fix.pose_map_base)
        heading_rad = math.sqrt(np.linalg.pinv(fix.information)[2, 2])
        tells_heading = heading_rad < WRONG_RAD
        is_turned = abs(error.theta) > (WRONG_RAD if tells_heading else SIGMAS * heading_rad)
        is_right = look.is_taught and math.hypot(error.x, error.y) <= WRONG_M and not is_turned
        row["found"] += is_right
        row["headings"] += is_right and tells_heading
        row["wrong"] += not is_right
        row["sure"] += not is_right and not (look.is_taught and is_within(error, fix))
        if look.is_taught:
            row["worst_mm"] = max(row["worst_mm"], 1e3 * math.hypot(error.x, error.y))
    return row


def page(rows: Sequence[dict[str, Any]]) -> str:
    """Return the sum, and a table: a line for each condition over all floors, and one for copies of taught ground."""
    copies = [row for row in rows if row["floor"].startswith(COPIES)]
    rows = [row for row in rows if not row["floor"].startswith(COPIES)]
    n, other, wrong, sure = _sums(rows)
    floors = len({row["floor"] for row in rows})
    heads = "condition", "taught", "searches on taught / other ground", "found [%]", "of clean [%]", "heading told [%]"
    lines = [
        f"{n + other:,} searches on {floors} floors: {wrong} wrong, {sure} of them sure (bar: 0).",
        "",
        "| " + " | ".join([*heads, "wrong", "sure", "largest error [mm]"]) + " |",
        "|---" * 9 + "|",
    ]
    clean = _found(_of(rows, CONDITIONS[0], "clean"))
    for condition in CONDITIONS:
        for teaching in ("clean", "same"):
            if of := _of(rows, condition, teaching):
                n, other, wrong, sure = _sums(of)
                worst = max(row["worst_mm"] for row in of)
                share = "-" if math.isnan(clean) else f"{100 * _found(of) / clean:.1f}"
                headings = 100 * sum(row["headings"] for row in of) / max(1, sum(row["found"] for row in of))
                cells = [f"{n} / {other}", f"{100 * _found(of):.1f}", share, f"{headings:.0f}", f"{wrong}", f"{sure}"]
                cells.append(f"{worst:.2f}")
                lines.append("| " + " | ".join([condition, teaching, *cells]) + " |")
    if copies:
        n, other, wrong, sure = _sums(copies)
        lines[0] += f" On {COPIES}: {other:,} searches, {wrong} wrong, {sure} of them sure."
        lines.append(f"| {COPIES}, all conditions | both | {n} / {other} | - | - | - | {wrong} | {sure} | - |")
    return "\n".join(lines) + "\n"


def _sums(rows: Sequence[dict[str, Any]]) -> list[int]:
    return [sum(row[key] for row in rows) for key in COUNTS]


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
    parser.add_argument("--jobs", type=int, default=1, help="processes at once")
    parser.add_argument("--out", type=Path, help="folder of ground_map_conditions.jsonl")
    parser.add_argument("--markdown", action="store_true", help="the table of the page")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rows = {_key(row): row for row in _kept(options.out)}
    drives = [(floor, seed) for seed in options.seeds for floor in options.floors if floor in photographs()]
    wanted = {drive: _missing(rows, drive, options.conditions, options.taught) for drive in drives}
    jobs = [(floor, seed, missing) for (floor, seed), missing in wanted.items() if missing]
    for row in in_turn(measured, jobs, options.jobs):
        rows[_key(row)] = row
        if not options.markdown:
            print(json.dumps(row), flush=True)
        if options.out is not None:
            with _file(options.out).open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
    if options.markdown:
        print(page(list(rows.values())))


def _missing(
    rows: Mapping[tuple[Any, ...], Any], drive: tuple[str, int], conditions: Sequence[str], teachings: Sequence[str]
) -> dict[str, list[str]]:
    """Return which teachings of each condition have no row yet."""
    floor, seed = drive
    missing = {c: [t for t in teachings if (floor, c, t, seed) not in rows] for c in conditions}
    return {condition: of for condition, of in missing.items() if of}


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
