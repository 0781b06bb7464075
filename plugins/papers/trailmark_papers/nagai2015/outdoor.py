"""Sec. IV-D: 243.4 m over several grounds, there and back, on other days."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import Table, Trial, sweep
from trailmark_papers.nagai2015.directions import add_directions
from trailmark_papers.nagai2015.figures import draw_outdoor
from trailmark_papers.nagai2015.ground_pictures import draw_ground, draw_labelled_path, look_at_ground
from trailmark_papers.nagai2015.playback import Playback, read_playback
from trailmark_papers.nagai2015.runs import course, drive, tracking_config

__all__ = ["outdoor_rows"]


@dataclass(frozen=True, slots=True)
class _Day:
    """How the ground and the camera are when the path is driven again.

    Attributes
    ----------
    weather : mapping
        Options of the world.
    put_off : (m, m, deg)
        How far off the start a hand puts the vehicle: forward, left, turned.
    ways : sequence of str
        ``forward``, ``reverse``: each a playback of its own.
    """

    weather: Mapping[str, Any]
    put_off: tuple[float, float, float]
    ways: Sequence[str] = ("forward",)


#: The last is the paper's future work.
_DAYS: Mapping[str, _Day] = {
    "next day": _Day({"day": 2, "dirt": 0.2}, (0.0, 0.006, 0.5), ("forward", "reverse")),
    "five days after": _Day({"day": 6, "dirt": 0.4, "gain": 0.95, "offset": 3.0}, (0.004, -0.008, -0.6)),
    "wet, with leaves": _Day({"day": 9, "dirt": 0.2, "wet": 0.3, "leaves_per_m2": 10.0}, (-0.003, 0.005, 0.4)),
}
#: Teaching sees 70 pictures a second, as the paper; half of them are enough for playback, and cost half.
_PLAYBACK_HZ = 35.0
_QUICK_S = 5.0  # of teaching: about 1.2 m
_STORE = "outdoor.trail"
_FALSE_M = 5e-3


def outdoor_rows(options: ExperimentOptions) -> list[Row]:
    """Return the rows of Sec. IV-D and draw Figs. 14 to 18."""
    days = list(_DAYS)[:1] if options.quick else list(_DAYS)
    trial = Trial.of(options)
    (taught,) = options.map(_teach, [(trial, options.quick)])
    cells = {(day, way): (trial, day, way) for day in days for way in _DAYS[day].ways}
    folders = sweep(options, _repeat, cells)
    rows: list[Row] = []
    for day in days:
        found = [read_playback(taught, folders[day, way], options.out / _STORE) for way in _DAYS[day].ways]
        for way, playback in zip(_DAYS[day].ways, found):
            n_found = int(playback.searches.is_found.sum())
            options.report(f"outdoors, {day}, {way}: {n_found} corrections, {playback.reason}")
        if day == days[0]:
            draw_outdoor(options.out, found)
            _draw_places(options, found[0])
            rows += _taught_rows(found[0], options)
        rows += _day_rows(day, found, options.quick)
    return rows


def _draw_places(options: ExperimentOptions, found: Playback) -> None:
    """Draw Figs. 14 and 15; a short stretch has no places to label."""
    if options.quick:
        return
    points = look_at_ground(options)
    draw_labelled_path(options.out / "figure_14_labelled_path.svg", found.taught.positions[::20], points)
    draw_ground(options.out / "figure_15_ground.svg", points)


def _teach(trial: Trial, is_quick: bool) -> Path:
    limits: dict[str, Any] = {"duration_s": _QUICK_S} if is_quick else {}
    config = tracking_config(course("outdoor", trial.place, **limits), trial.seed)
    return drive(trial.out / "outdoor-teach", config, trial.out / _STORE, "teach")


def _repeat(trial: Trial, day: str, way: str) -> Path:
    """Drive the course on another day, from one of its ends."""
    ground = _DAYS[day]
    where: dict[str, Any] = {"start": "first" if way == "forward" else "last"}
    source = course(
        "outdoor",
        trial.place,
        options={"in_replay": dict(ground.weather)},
        put_off=list(ground.put_off),
        rates_hz={"floor": _PLAYBACK_HZ},
    )
    config = tracking_config(source, trial.seed, stop_when={"fix_age_m": 5.0}, **where)
    return drive(
        trial.out / f"outdoor-{day.replace(',', '').replace(' ', '-')}-{way}", config, trial.out / _STORE, "replay"
    )


def _taught_rows(found: Playback, options: ExperimentOptions) -> Table:
    n = len(found.registrations)
    file_mb = (options.out / _STORE).stat().st_size / 1e6
    if options.quick:  # a short stretch has no figure of the paper beside it
        table = Table("D short")
        table.add("registrations", "", n)
    else:
        table = Table("D 243.4 m")
        table.add("registrations", "", n, paper=4868)
        table.add("registrations, more or less than 4868", "", abs(n - 4868), bar=25)
        table.add("memory for ground images", "MB", n * (44 * 44 + 3 * 8) / 1e6, paper=9.54, bar=9.6)
    table.add("file of the path", "MB", file_mb)
    return table


def _day_rows(day: str, found: Sequence[Playback], is_quick: bool) -> Table:
    """Return the rows of a day; the paper prints figures of the next day alone ("similar" five days after)."""
    name = f"D {'short' if is_quick else '243.4 m'}, {day}, {' and '.join(_DAYS[day].ways)}"
    is_papers = day == "next day" and not is_quick
    offsets = np.abs(np.concatenate([playback.offsets for playback in found]))
    lateral_mm, turned_deg = 1e3 * offsets[:, 1], np.degrees(offsets[:, 2])
    is_found = np.concatenate([playback.searches.is_found for playback in found])
    intervals_m = np.concatenate([playback.intervals_m() for playback in found])
    true_mm = 1e3 * np.concatenate([playback.corrected_m() for playback in found])
    n_false = sum(int((playback.false_m() > _FALSE_M).sum()) for playback in found)
    table = Table(name, len(offsets))
    for item, unit, ours, paper, n in (
        ("offset from the path, mean", "mm", lateral_mm.mean(), 4.1, len(offsets)),
        ("offset from the path, max", "mm", lateral_mm.max(), 25.0, len(offsets)),
        ("angular offset, mean", "deg", turned_deg.mean(), 0.49, len(offsets)),
        ("angular offset, max", "deg", turned_deg.max(), 3.2, len(offsets)),
        ("searches rejected", "%", 100.0 * np.mean(~is_found), 8.5, len(is_found)),
        ("way between corrections, mean", "m", intervals_m.mean(), 0.062, len(intervals_m)),
    ):
        table.add(item, unit, float(ours), paper=paper if is_papers else None, bar=paper, stretch=paper / 2, n=n)
    add_directions(table, found)
    table.add("way between corrections, max", "m", float(intervals_m.max()), n=len(intervals_m))
    table.add("true error after correction, mean", "mm", float(true_mm.mean()), n=len(true_mm))
    table.add("true error after correction, max", "mm", float(true_mm.max()), n=len(true_mm))
    table.add("false corrections (more than 5 mm)", "", n_false, bar=0, n=len(is_found))
    miss_mm = 1e3 * max(one.end_miss_m for one in found)
    table.add("end of the path missed by", "mm", miss_mm, bar=20.0, stretch=5.0, n=1)
    return table
