"""divs on winding ways and second drives, beside patch_ncc on the same pictures; and from an unknown start.

    python benchmarks/divs_winding.py [--quick] [--json | --markdown] [--tuning] [--worlds street corridor real]

Simulated: five streets and five corridors, each with a winding way of its own (8 m), driven again 10 cm and some
degrees beside, under other light, with people, in other seasons. Truth is the median displacement of what the upper
half shows, from exact depth. ``--tuning`` runs the places on which parameters were chosen, which are not reported.
Real: taught on the even pictures of the recordings in ``TRAILMARK_DATA``, replayed on the odd ones, of another day,
both cropped by known shifts; a swerve between the two counts as an error of everybody. All look at the upper half.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from divs import data_folder, degraded, make_divs, read, replayed, taught
from winding_drives import SPEED_MPS, STEP_M, Drive, Maker, Taught, WindingPlace, drive_again, shown, teach_way

from trailmark.estimates import PathOffset
from trailmark.experiments import Row
from trailmark_baselines.appearance.config import PatchNCCConfig
from trailmark_baselines.appearance.localizer import PatchNCC
from trailmark_divs.config import DivsConfig
from trailmark_divs.localizer import Divs

_CAMERA: dict[str, Any] = {"camera": "front"}
MAKERS: Mapping[str, Maker] = {
    "divs": lambda: Divs(DivsConfig.model_validate({**_CAMERA, "when_blind": "pictures"})),
    "divs, when_blind: single": lambda: Divs(DivsConfig.model_validate({**_CAMERA, "when_blind": "single"})),
    "patch_ncc": lambda: PatchNCC(PatchNCCConfig.model_validate({**_CAMERA, "region": (0.0, 0.5)})),
}
CONDITIONS: Mapping[str, Mapping[str, Mapping[str, Any]]] = {
    "street": {
        "same light": {"time": "morning"},
        "afternoon, 3 people": {"time": "afternoon", "people": 3},
        "autumn, afternoon": {"season": "autumn", "time": "afternoon"},
        "winter, afternoon": {"season": "winter", "time": "afternoon"},
    },
    "corridor": {
        "same light": {"time": "morning"},
        "afternoon, half of the lamps, 3 people": {"time": "afternoon", "lamps": "half", "people": 3},
    },
}
_PROMISED_COLUMNS = 2.0
_FOUND_S, _FOUND_M = 3.0, 0.75
_SETTLED = 26  # pictures: everybody is asked from here on


@dataclass
class Answers:
    """What a localizer said in several drives, beside the truth [columns]."""

    errors: list[float] = field(default_factory=list)
    n_asked: int = 0

    def add(self, taught: Taught, drive: Drive, name: str, make: Maker) -> None:
        """Replay a drive."""
        column_px = taught.eyepiece.column_px
        for answer in list(shown(taught.replayer(name, make), drive))[_SETTLED:]:
            self.n_asked += 1
            if answer and isinstance(answer[0], PathOffset):
                offset = answer[0]
                true = taught.true_columns(offset, drive)
                self.errors.append(abs(offset.details["shift_px"] / column_px - true))


def start_found(taught: Taught, drive: Drive, first: int, make: Maker) -> tuple[float | None, float]:
    """Put the robot down somewhere; return when it first says where it is [s], and how far that is off [m]."""
    rest = Drive(drive.poses[first:], drive.stations_m[first:], drive.payloads[first:])
    for k, answer in enumerate(shown(taught.replayer("divs", make), rest, is_placed=False)):
        if k * STEP_M / SPEED_MPS > _FOUND_S:
            break
        if answer and isinstance(answer[0], PathOffset) and answer[0].information[0, 0] > 0.0:
            offset = answer[0]
            true_m = float(rest.stations_m[k])
            return k * STEP_M / SPEED_MPS, abs(offset.station_m - true_m)
    return None, 0.0


def way_rows(places: Sequence[WindingPlace], seeds: Sequence[int]) -> Iterator[Row]:
    """Yield the rows of some places of one world."""
    world = places[0].world
    found: dict[tuple[str, str], Answers] = {}
    starts: list[tuple[float | None, float]] = []
    for place in places:
        taught = teach_way(place)
        taught.teach(MAKERS)
        for condition, options in CONDITIONS[world].items():
            for seed in seeds:
                drive = drive_again(taught, options, seed)
                for name, make in MAKERS.items():
                    found.setdefault((condition, name), Answers()).add(taught, drive, name, make)
                firsts = range(20, len(drive.poses) - 80, 100)
                starts += [start_found(taught, drive, first, MAKERS["divs"]) for first in firsts]
    n_drives = len(places) * len(seeds)
    for condition in CONDITIONS[world]:
        peer = float(np.mean(found[condition, "patch_ncc"].errors))
        for name in MAKERS:
            yield from _answer_rows(f"{world}, {condition}", name, found[condition, name], peer, n_drives)
    yield from _start_rows(world, starts)


def real_rows(folder: Path) -> Iterator[Row]:
    """Yield the rows of real recordings: two cameras of a street, two walks through a corridor with a fisheye."""
    street: dict[str, Any] = {"when_blind": "pictures", "window": 10}
    corridor: dict[str, Any] = {**street, "columns": 44, "max_shift_columns": 16, "window": 5}
    drives = (
        *(
            (f"kitti_raw_stereo/{side}", slice(None), 400, (0, 8, -8, 24, -24, 48, -48), street)
            for side in ("left", "right")
        ),
        # What lies within the circle of the lens: its rim, which never moves, would say that nothing does.
        *((f"corridor/{walk}", slice(20, 100), 88, (0, 2, -2, 4, -4, 8, -8), corridor) for walk in ("ref", "query")),
    )
    for name, rows, width_px, shifts_px, own in drives:
        pictures = [np.ascontiguousarray(picture[rows]) for picture in read(folder / name)]
        found = {
            who: _of_crops(make, pictures, own if who == "divs" else {}, (width_px, own.get("columns", 50)), shifts_px)
            for who, make in (("divs", make_divs), ("patch_ncc", lambda **_: MAKERS["patch_ncc"]()))
        }
        peer = float(np.mean(found["patch_ncc"].errors))
        for who, answers in found.items():
            yield from _answer_rows(f"{name}, even/odd", who, answers, peer, 1)


def _of_crops(
    make: Any, pictures: Sequence[Any], own: Mapping[str, Any], size: tuple[int, int], shifts_px: Sequence[int]
) -> Answers:
    """Return the answers to crops of odd pictures, of another day, after teaching the middle of the even ones."""
    (width_px, n_columns), answers = size, Answers()
    even, odd = pictures[0::2], degraded(pictures[1::2])
    localizer_map = taught(make, _cropped(even, width_px), **own)
    for shift_px in shifts_px:
        for answer in replayed(make, localizer_map, _cropped(odd, width_px, shift_px), 0.5, **own)[_SETTLED // 2 :]:
            answers.n_asked += 1
            if answer and isinstance(answer[0], PathOffset):
                off_px = abs(answer[0].details["shift_px"] - shift_px)
                answers.errors.append(off_px / (width_px // n_columns))
    return answers


def _cropped(pictures: Sequence[Any], width_px: int, shift_px: int = 0) -> list[Any]:
    start = (pictures[0].shape[1] - width_px) // 2 - shift_px
    return [np.ascontiguousarray(picture[:, start : start + width_px]) for picture in pictures]


def _answer_rows(item: str, name: str, answers: Answers, peer: float, n_drives: int) -> Iterator[Row]:
    errors = np.array(answers.errors)
    row = partial(_row, f"{item} [{name}]", n=n_drives, is_ours=name == "divs")
    yield row("mean error", "columns", float(errors.mean()), peer)
    yield row("speaks", "%", 100.0 * len(errors) / answers.n_asked, 95.0, "higher")
    yield row("within 2 columns", "%", 100.0 * float((errors <= _PROMISED_COLUMNS).mean()), 80.0, "higher")
    yield row("95th percentile", "columns", float(np.quantile(errors, 0.95)))


def _start_rows(world: str, starts: Sequence[tuple[float | None, float]]) -> Iterator[Row]:
    right = [off_m for when_s, off_m in starts if when_s is not None and off_m <= _FOUND_M]
    wrong = [off_m for when_s, off_m in starts if when_s is not None and off_m > _FOUND_M]
    row = partial(_row, f"{world}, unknown start", n=len(starts))
    yield row(f"found within {_FOUND_S:g} s", "%", 100.0 * len(right) / len(starts), 90.0, "higher")
    yield row(f"told a place more than {_FOUND_M:g} m off", "%", 100.0 * len(wrong) / len(starts))


def _row(
    where: str,
    what: str,
    unit: str,
    value: float,
    bar: float | None = None,
    better: Any = "lower",
    *,
    n: int,
    is_ours: bool = True,
) -> Row:
    return Row("divs_winding", f"{where}: {what}", unit, value, None, bar if is_ours else None, better=better, n=n)


def markdown(rows: Sequence[Row]) -> str:
    """Return the tables of the page: answers by drive and method, and starts that were not told."""
    columns = ("mean error", "95th percentile", "within 2 columns", "speaks")
    by_drive: dict[str, dict[str, Row]] = {}
    for row in rows:
        where, _, what = row.item.rpartition(": ")
        by_drive.setdefault(where, {})[what] = row
    answers = {where: found for where, found in by_drive.items() if where.endswith("]")}
    lines = [f"| second drive | | {' | '.join(columns)} | bars |", "|---|---|" + "--:|" * len(columns) + "---|"]
    for where, found in answers.items():
        drive, _, method = where.removesuffix("]").rpartition(" [")
        cells = [_cell(found[column]) for column in columns]
        missed = [column for column in columns if found[column].met is False]
        verdict = "" if all(found[column].met is None for column in columns) else ", ".join(missed) or "met"
        lines.append(f"| {drive} | `{method}` | {' | '.join(cells)} | {verdict} |")
    starts = {where: found for where, found in by_drive.items() if where not in answers}
    if starts:
        asked = list(next(iter(starts.values())))
        lines += ["", f"| | {' | '.join(asked)} | n |", "|---|" + "--:|" * (len(asked) + 1)]
    for where, found in starts.items():
        cells = [*(_cell(found[what]) for what in asked), str(found[asked[0]].n)]
        lines.append(f"| {where} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _cell(row: Row) -> str:
    return f"{row.ours:.1f} %" if row.unit == "%" else f"{row.ours:.3f}"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one place of each kind, one seed")
    parser.add_argument("--tuning", action="store_true", help="the places on which parameters were chosen")
    parser.add_argument("--worlds", nargs="*", default=[*CONDITIONS, "real"])
    parser.add_argument("--json", action="store_true", help="a list of rows")
    parser.add_argument("--markdown", action="store_true", help="the tables of the page")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    numbers = (11, 12) if options.tuning else (1,) if options.quick else (1, 2, 3, 4, 5)
    seeds = (1,) if options.quick or options.tuning else (1, 2)
    rows: list[Row] = []
    for world in options.worlds:
        places = [WindingPlace(world=world, number=number) for number in numbers]
        for row in real_rows(data_folder()) if world == "real" else way_rows(places, seeds):
            rows.append(row)
            if not (options.json or options.markdown):
                bar = "" if row.bar is None else f"bar {row.bar:6.2f}  {'met' if row.met else 'NOT MET'}"
                print(f"{row.item:90}{row.ours:9.3f} {row.unit:8}{bar:20} n={row.n}", flush=True)
    if options.json:
        print(json.dumps([row.document() for row in rows], indent=2))
    if options.markdown:
        print(markdown(rows))


if __name__ == "__main__":
    main()
