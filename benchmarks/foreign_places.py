"""A robot that is put into a place that was not taught, and not told: how often is it told a pose?

    python benchmarks/foreign_places.py [--methods divs grid_mcl ...] [--quick] [--json]

Each method is taught several places. Then it starts, not told where, in these and in others: of the same plan or kind,
and of another. In its own place an answer is right or wrong; elsewhere each is wrong.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import cv2
from foreign_drives import Start, divs_starts, laser_starts
from foreign_floors import FloorStart, ground_map_starts
from foreign_sights import SightStart, sight_starts

METHODS: Mapping[str, Callable[[bool], Iterator[Start | FloorStart | SightStart]]] = {
    "divs": divs_starts,
    "grid_mcl": lambda is_quick: laser_starts("grid_mcl", is_quick),
    "ground_map": ground_map_starts,
    "kinect_landmarks": lambda is_quick: sight_starts("kinect_landmarks", is_quick),
    "laser_icp": lambda is_quick: laser_starts("laser_icp", is_quick),
    "omni_surf": lambda is_quick: sight_starts("omni_surf", is_quick),
}
_SOON_S = 3.0  # divs: told so soon


@dataclass
class Tally:
    """How many starts there were, and what was said."""

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


def tallies(method: str, is_quick: bool) -> dict[tuple[str, str], Tally]:
    """Return what became of the starts of a method, by kind of place and by where it was put down."""
    found: dict[tuple[str, str], Tally] = {}
    for start in METHODS[method](is_quick):
        found.setdefault((start.place, start.put_down), Tally()).add(start)
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--methods", nargs="*", default=[*METHODS], choices=[*METHODS])
    parser.add_argument("--quick", action="store_true", help="one place of each kind")
    parser.add_argument("--json", action="store_true", help="a list of rows")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rows = []
    for method in options.methods:
        for (place, put_down), tally in tallies(method, options.quick).items():
            rows.append({"method": method, "place": place, "put down": put_down, **vars(tally)})
            if not options.json:
                soon = f" ({tally.n_soon} within {_SOON_S:g} s)" if method == "divs" else ""
                told = f"{tally.n_right:4} right{soon} {tally.n_wrong:4} wrong of {tally.n:4}"
                print(f"| {method:10} | {place:10} | {put_down:36} | {told} |", flush=True)
    if options.json:
        print(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
