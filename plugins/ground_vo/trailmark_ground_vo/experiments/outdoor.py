"""Sec. IV-D: 243.4 m over several grounds, there and back, on other days."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.experiments import ExperimentOptions, Row
from trailmark_ground_vo.experiments.figures import draw_outdoor
from trailmark_ground_vo.experiments.playback import Playback, read_playback
from trailmark_ground_vo.experiments.runs import course, drive, tracking_config

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
    trips : float
        Round trips; 0.5 is one way.
    """

    weather: Mapping[str, Any]
    put_off: tuple[float, float, float]
    trips: float = 0.5


#: The last is the paper's future work.
_DAYS: Mapping[str, _Day] = {
    "next day": _Day({"day": 2, "dirt": 0.2}, (0.0, 0.006, 0.5), trips=1.0),
    "five days after": _Day({"day": 6, "dirt": 0.4, "gain": 0.95, "offset": 3.0}, (0.004, -0.008, -0.6)),
    "wet, with leaves": _Day({"day": 9, "dirt": 0.2, "wet": 0.3, "leaves_per_m2": 10.0}, (-0.003, 0.005, 0.4)),
}
#: Teaching sees 70 pictures a second, as the paper; half of them are enough for playback, and cost half.
_PLAYBACK_HZ = 35.0
_QUICK_S = 5.0  # of teaching: about 1.2 m
_STORE = "outdoor.trail"


def outdoor_rows(options: ExperimentOptions) -> list[Row]:
    """Return the rows of Sec. IV-D and draw Figs. 16 to 18."""
    days = list(_DAYS)[:1] if options.quick else list(_DAYS)
    taught = _teach(options.out, options.seed, options.quick)
    folders = options.map(_repeat_on, [(options.out, options.seed, day) for day in days])
    rows: list[Row] = []
    for day, folder in zip(days, folders):
        found = read_playback(taught, folder, options.out / _STORE)
        options.report(f"outdoors, {day}: {int(found.searches.is_found.sum())} corrections, {found.reason}")
        if day == days[0]:
            draw_outdoor(options.out, found)
            rows += _taught_rows(found, options)
        rows += _day_rows(day, found, options.quick)
    return rows


def _teach(out: Path, seed: int, is_quick: bool) -> Path:
    limits: dict[str, Any] = {"duration_s": _QUICK_S} if is_quick else {}
    return drive(out / "outdoor-teach", tracking_config(course("outdoor", **limits), seed), out / _STORE, "teach")


def _repeat_on(out: Path, seed: int, day: str) -> Path:
    """Drive the course there and back on another day."""
    ground = _DAYS[day]
    source = course(
        "outdoor",
        options={"in_replay": dict(ground.weather)},
        put_off=list(ground.put_off),
        rates_hz={"floor": _PLAYBACK_HZ},
    )
    config = tracking_config(source, seed, repeat=ground.trips, stop_when={"fix_age_m": 5.0})
    return drive(out / f"outdoor-{day.replace(',', '').replace(' ', '-')}", config, out / _STORE, "replay")


def _taught_rows(found: Playback, options: ExperimentOptions) -> list[Row]:
    n = len(found.registrations)
    arrays_mb = n * (44 * 44 + 3 * 8) / 1e6
    file_mb = (options.out / _STORE).stat().st_size / 1e6
    if options.quick:  # a short stretch has no figure of the paper beside it
        return [Row("D short", "registrations", "", n), Row("D short", "file of the path", "MB", file_mb)]
    return [
        Row("D 243.4 m", "registrations", "", n, 4868),
        Row("D 243.4 m", "registrations, more or less than 4868", "", abs(n - 4868), 0, 25),
        Row("D 243.4 m", "memory for ground images", "MB", arrays_mb, 9.54, 9.6),
        Row("D 243.4 m", "file of the path", "MB", file_mb),
    ]


def _day_rows(day: str, found: Playback, is_quick: bool) -> list[Row]:
    """Return the rows of a day; the paper has figures of the next day, and a similar result five days after."""
    there = "there and back" if _DAYS[day].trips == 1.0 else "there"
    name = f"D {'short' if is_quick else '243.4 m'} {there}, {day}"
    is_papers = day != "wet, with leaves"
    lateral_mm, turned_deg = 1e3 * np.abs(found.offsets[:, 1]), np.degrees(np.abs(found.offsets[:, 2]))
    true_mm = 1e3 * found.corrected_m()
    figures = [
        ("offset from the path, mean", "mm", float(lateral_mm.mean()), 4.1),
        ("offset from the path, max", "mm", float(lateral_mm.max()), 25.0),
        ("angular offset, mean", "deg", float(turned_deg.mean()), 0.49),
        ("angular offset, max", "deg", float(turned_deg.max()), 3.2),
        ("searches rejected", "%", found.rejected_percent(), 8.5),
        ("way between corrections, mean", "m", float(found.intervals_m().mean()), 0.062),
    ]
    n, n_searches = len(found.offsets), len(found.searches.places)
    rows = [
        Row(
            name, item, unit, ours, paper if is_papers else None, paper, paper / 2,
            n=n_searches if "searches" in item or "corrections" in item else n,
        )
        for item, unit, ours, paper in figures
    ]  # fmt: skip
    return [
        *rows,
        Row(name, "true error after correction, mean", "mm", float(true_mm.mean()), n=len(true_mm)),
        Row(name, "true error after correction, max", "mm", float(true_mm.max()), n=len(true_mm)),
        Row(name, "false corrections (more than 5 mm)", "", int((found.false_m() > 5e-3).sum()), None, 0, n=n_searches),
        Row(name, "end of the path missed by", "mm", 1e3 * found.end_miss_m, None, 20.0, 5.0),
    ]
