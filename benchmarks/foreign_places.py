"""A robot that is put into a place that was not taught, and not told: how often is it told a pose?

    python benchmarks/foreign_places.py [--methods divs grid_mcl ...] [--only street] [--quick] [--json | --markdown]
                                        [--out FOLDER]

Each method is taught several places. Then it starts, not told where, in these and in others: of the same plan or kind,
and of another. In its own place an answer is right or wrong; elsewhere each is wrong. Places that are done are kept in
FOLDER/foreign_places.jsonl, and not done again.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
from foreign_drives import Start, divs_places, laser_places
from foreign_floors import FloorStart, ground_map_places
from foreign_sights import SightStart, sight_places

Starts = Callable[[], Iterator[Start | FloorStart | SightStart]]
METHODS: Mapping[str, Callable[[bool], Mapping[str, Starts]]] = {
    "divs": divs_places,
    "grid_mcl": partial(laser_places, "grid_mcl"),
    "ground_map": ground_map_places,
    "kinect_landmarks": partial(sight_places, "kinect_landmarks"),
    "laser_icp": partial(laser_places, "laser_icp"),
    "omni_surf": partial(sight_places, "omni_surf"),
}
_SOON_S = 3.0  # divs: told so soon
_HEAD = "| method | taught | put down | told right | told wrong | of |\n|---|---|---|--:|--:|--:|"


@dataclass
class Tally:
    """How many starts of a method in a kind of place there were, and what was said."""

    method: str
    place: str
    put_down: str
    n: int = 0
    n_right: int = 0
    n_soon: int = 0
    n_wrong: int = 0

    def add(self, start: Start | FloorStart | SightStart) -> None:
        """Count a start."""
        self.n += 1
        self.n_right += start.is_right is True
        told_s = getattr(start, "told_s", None)
        self.n_soon += start.is_right is True and told_s is not None and told_s <= _SOON_S
        self.n_wrong += start.is_right is False

    def line(self) -> str:
        """Return it as a line of a table."""
        right = f"{self.n_right}, {self.n_soon} within {_SOON_S:g} s" if self.method == "divs" else f"{self.n_right}"
        right = right if self.put_down.startswith("its own") else "-"
        return f"| {self.method} | {self.place} | {self.put_down} | {right} | {self.n_wrong} | {self.n} |"


def tallies(method: str, starts: Starts) -> list[Tally]:
    """Return what became of the starts of a method in one place, by where it was put down."""
    found: dict[tuple[str, str], Tally] = {}
    for start in starts():
        found.setdefault((start.place, start.put_down), Tally(method, start.place, start.put_down)).add(start)
    return list(found.values())


def summed(parts: Sequence[Tally]) -> list[Tally]:
    """Return the tallies of places of a kind as one."""
    sums: dict[tuple[str, str, str], Tally] = {}
    for part in parts:
        key = (part.method, part.place, part.put_down)
        whole = sums.setdefault(key, Tally(*key))
        for count in ("n", "n_right", "n_soon", "n_wrong"):
            setattr(whole, count, getattr(whole, count) + getattr(part, count))
    return list(sums.values())


def measured(methods: Sequence[str], only: Sequence[str], is_quick: bool, kept: Path | None) -> Iterator[Tally]:
    """Yield the tallies of all places, those that are kept first."""
    lines = kept.read_text(encoding="utf-8").splitlines() if kept and kept.is_file() else []
    known: dict[str, list[dict[str, Any]]] = dict(map(json.loads, lines))
    for method in methods:
        for place, starts in METHODS[method](is_quick).items():
            if only and not any(word in place for word in only):
                continue
            name = f"{method} {place}" + (" quick" if is_quick else "")
            if name not in known:
                known[name] = [asdict(tally) for tally in tallies(method, starts)]
                if kept:
                    with kept.open("a", encoding="utf-8") as file:
                        file.write(json.dumps([name, known[name]]) + "\n")
                print(name, file=sys.stderr, flush=True)
            yield from (Tally(**row) for row in known[name])


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--methods", nargs="*", default=[*METHODS], choices=[*METHODS])
    parser.add_argument("--only", nargs="*", default=[], help="places whose names contain one of these")
    parser.add_argument("--quick", action="store_true", help="one place of each kind")
    parser.add_argument("--out", type=Path, help="folder that keeps what is done")
    parser.add_argument("--json", action="store_true", help="a list of rows")
    parser.add_argument("--markdown", action="store_true", help="the table of the page")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
    kept = options.out and options.out / "foreign_places.jsonl"
    rows = summed(list(measured(options.methods, options.only, options.quick, kept)))
    if options.json:
        print(json.dumps([asdict(row) for row in rows], indent=2))
        return
    print("\n".join([*([_HEAD] if options.markdown else []), *(row.line() for row in rows)]))


if __name__ == "__main__":
    main()
