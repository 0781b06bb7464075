"""Sec. IV-C: the indoor course through four gates, taught once and driven there and back 10.5 times."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.evaluation import read_run
from trailmark.experiments import ExperimentOptions, Row
from trailmark.geometry import Pose2, Trajectory
from trailmark_papers.kit import Table, Trial, beside_faithful
from trailmark_papers.nagai2015.directions import add_directions
from trailmark_papers.nagai2015.figures import draw_indoor
from trailmark_papers.nagai2015.playback import Playback, read_playback
from trailmark_papers.nagai2015.runs import course, drive, keys_of, poles_of, tracking_config

__all__ = ["indoor_rows"]

_TRIPS, _TRIPS_OF_VARIANTS, _QUICK_TRIPS = 10.5, 1.5, 0.5
_FRAME_MS = 1e3 / 70.0

#: Steering that is not straight: the paper suspects its "asymmetric steering mechanism".
_CROOKED = {"kind": "four_wheel_steering", "asymmetry": 0.08, "front_trim_deg": 0.5, "rear_trim_deg": -0.3}


@dataclass(frozen=True, slots=True)
class _PlaybackVariant:
    """A playback of the course.

    Attributes
    ----------
    method : str
        ``refined``, the defaults of both localizers, or their preset ``paper``.
    latency_frames : int
        How late a search answers.
    vehicle : mapping or None
        Another vehicle.
    """

    method: str = "refined"
    latency_frames: int = 1
    vehicle: Mapping[str, Any] | None = None


#: What the paper prints of its own method on its course [mm].
_PRINTED: Mapping[str, float] = {
    "detected, mean": 0.63,
    "detected, max": 4.6,
    "offset, mean": 4.4,
    "offset, max": 20.3,
}
_MAIN, _LATE, _PAPERS = "refined", "refined, 14 frames", "paper, 14 frames"
_VARIANTS: Mapping[str, _PlaybackVariant] = {
    _MAIN: _PlaybackVariant(),
    _LATE: _PlaybackVariant(latency_frames=14),
    "paper": _PlaybackVariant("paper"),
    _PAPERS: _PlaybackVariant("paper", 14),
    "crooked steering": _PlaybackVariant(vehicle=_CROOKED),
}


def indoor_rows(options: ExperimentOptions) -> list[Row]:
    """Return the rows of Sec. IV-C and draw Figs. 10 to 13."""
    names = [_MAIN] if options.quick else list(_VARIANTS)
    trips = {name: _trips(name, options.quick) for name in names}
    kinds = sorted({_taught_as(name) for name in names}, reverse=True)
    trial = Trial.of(options)
    options.map(_teach, [(trial, kind) for kind in kinds])
    options.map(_repeat, [(trial, name, trips[name]) for name in names])
    found = {name: _read(options.out, name) for name in names}
    for name, playback in found.items():
        n = len(playback.detected_m())
        options.report(f"13.4 m indoors, {name}, {trips[name]:g} round trips: {n} corrections, {playback.reason}")
    main = found[_MAIN]
    draw_indoor(options.out, main, poles_of(course("indoor", trial.place)))
    rows = [*_course_rows(main, trips[_MAIN]), *_error_rows(main, trips[_MAIN])]
    variants = {name: _variant_rows(name, one, main, trips[name]) for name, one in found.items() if name != _MAIN}
    # What the paper had: its method, and searches that take 14 pictures.
    rows = beside_faithful(rows, variants.get(_PAPERS, []))
    for name, table in variants.items():
        rows += beside_faithful(table, variants[_PAPERS] if name == _LATE else [])
    return rows


def _trips(name: str, is_quick: bool) -> float:
    if is_quick:
        return _QUICK_TRIPS
    return _TRIPS if name == _MAIN else _TRIPS_OF_VARIANTS


def _taught_as(name: str) -> str:
    return _VARIANTS[name].method


def _config(trial: Trial, variant: _PlaybackVariant, repeat: float, stands: Pose2, believed: Pose2) -> dict[str, Any]:
    """Return the config of a playback that begins where teaching has ended: 10.5 round trips lead to the start."""
    vehicle: dict[str, Any] = {} if variant.vehicle is None else {"vehicle": dict(variant.vehicle)}
    # The answer is there a millisecond before the picture that it is to meet.
    late = {"async": True, "latency_ms": variant.latency_frames * _FRAME_MS - 1.0}
    return tracking_config(
        course("indoor", trial.place, start=_in_degrees(stands), **vehicle),
        trial.seed,
        repeat=repeat,
        motion=keys_of(variant.method),
        patches={**keys_of(variant.method), **late},
        start=_in_degrees(believed),
    )


def _last(trajectory: Trajectory) -> Pose2:
    return trajectory[len(trajectory) - 1][1]


def _in_degrees(pose: Pose2) -> list[float]:
    return [pose.x, pose.y, math.degrees(pose.theta)]


def _teach(trial: Trial, method: str) -> Path:
    keys = keys_of(method)
    config = tracking_config(course("indoor", trial.place), trial.seed, motion=keys, patches=keys)
    return drive(trial.out / f"indoor-teach-{method}", config, trial.out / f"indoor-{method}.trail", mode="teach")


def _repeat(trial: Trial, name: str, trips: float) -> Path:
    variant = _VARIANTS[name]
    taught = read_run(trial.out / f"indoor-teach-{variant.method}")
    assert taught.truth is not None
    config = _config(trial, variant, trips, _last(taught.truth), _last(taught.trajectories["fused"]))
    return drive(_folder(trial.out, name), config, trial.out / f"indoor-{variant.method}.trail", mode="replay")


def _folder(out: Path, name: str) -> Path:
    return out / f"indoor-replay-{name.replace(',', '').replace(' ', '-')}"


def _read(out: Path, name: str) -> Playback:
    kind = _taught_as(name)
    return read_playback(out / f"indoor-teach-{kind}", _folder(out, name), out / f"indoor-{kind}.trail")


def _course_rows(found: Playback, trips: float) -> Table:
    """Return what the course and the vehicle did."""
    table, n = Table(f"C 13.4 m, {trips:g} trips"), len(found.offsets)
    n_bytes = max(sum(array.nbytes for array in one.arrays.values()) for one in found.registrations) + 3 * 8
    n_registered = len(found.registrations)
    lateral_mm, turned_deg = 1e3 * np.abs(found.offsets[:, 1]), np.degrees(np.abs(found.offsets[:, 2]))
    table.add("registrations", "", n_registered, paper=268)
    table.add("registrations, more or less than 268", "", abs(n_registered - 268), bar=2)
    table.add("bytes of a registration", "B", n_bytes, paper=1960, bar=1960)
    for item, unit, ours, paper, stretch in (
        ("offset from the path, mean", "mm", lateral_mm.mean(), 4.4, 2.0),
        ("offset from the path, max", "mm", lateral_mm.max(), 20.3, 10.0),
        ("angular offset, mean", "deg", turned_deg.mean(), 0.69, 0.3),
        ("angular offset, max", "deg", turned_deg.max(), 3.1, 1.5),
    ):
        table.add(item, unit, float(ours), paper=paper, bar=paper, stretch=stretch, n=n)
    add_directions(table, [found])
    table.add("poles touched", "", found.n_touched, paper=0, bar=0)
    table.add("back at the start, off by", "mm", 1e3 * found.end_miss_m, bar=20.0, stretch=5.0)
    return table


def _error_rows(found: Playback, trips: float) -> Table:
    """Return the errors that the searches detect (Fig. 13), and those that stay."""
    detected_mm, true_mm = 1e3 * found.detected_m(), 1e3 * found.corrected_m()
    table = Table(f"C 13.4 m, {trips:g} trips", len(detected_mm))
    detected = "error detected by the search"
    table.add(f"{detected}, mean", "mm", float(detected_mm.mean()), paper=0.63, bar=0.63, stretch=0.2)
    table.add(f"{detected}, max", "mm", float(detected_mm.max()), paper=4.6, bar=4.6, stretch=1.5)
    table.add("true error after correction, mean", "mm", float(true_mm.mean()), bar=0.25, stretch=0.1)
    table.add("true error after correction, p99", "mm", float(np.quantile(true_mm, 0.99)), bar=1.0, stretch=0.5)
    n, share = len(found.searches.places), 100.0 - found.rejected_percent()
    table.add_higher("searches accepted, clean ground", "%", share, bar=95.0, stretch=99.0, n=n)
    return table


def _variant_rows(variant: str, found: Playback, main: Playback, trips: float) -> Table:
    """Return the errors of another playback, with the bars that hold for it.

    A search that is 14 frames late may leave twice the error of the one that is a frame late.
    """
    detected_mm, true_mm, lateral_mm = (
        1e3 * part for part in (found.detected_m(), found.corrected_m(), np.abs(found.offsets[:, 1]))
    )
    table = Table(f"C 13.4 m, {trips:g} trips, {variant}", len(detected_mm))
    printed = _PRINTED if _VARIANTS[variant].method == "paper" else {}
    main_mm = 1e3 * float(main.corrected_m().mean())
    mean_bars = {
        _LATE: {"bar": 2.0 * main_mm, "stretch": 1.2 * main_mm},
        "paper": {"bar": 0.75},
    }.get(variant, {})
    table.add(
        "error detected by the search, mean", "mm", float(detected_mm.mean()), paper=printed.get("detected, mean")
    )
    table.add("error detected by the search, max", "mm", float(detected_mm.max()), paper=printed.get("detected, max"))
    table.add("true error after correction, mean", "mm", float(true_mm.mean()), **mean_bars)
    table.add("true error after correction, max", "mm", float(true_mm.max()), bar={"paper": 4.6}.get(variant))
    table.add("searches rejected", "%", found.rejected_percent(), n=len(found.searches.places))
    for item, offset_mm in (("mean", lateral_mm.mean()), ("max", lateral_mm.max())):
        paper = printed.get(f"offset, {item}")
        table.add(f"offset from the path, {item}", "mm", float(offset_mm), paper=paper, n=len(lateral_mm))
    add_directions(table, [found])
    table.add("poles touched", "", found.n_touched, bar=0, n=1)
    return table
