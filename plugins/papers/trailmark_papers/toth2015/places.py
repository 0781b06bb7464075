"""Laboratory and hallway: accuracy, and the rate by how much there is to find."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from trailmark.arrays import Floats
from trailmark.experiments import ExperimentOptions, Row
from trailmark.report.drawing import BLUE, GREEN, RED, legend_above
from trailmark_papers.kit import Table, beside_faithful, panels
from trailmark_papers.toth2015.drives import (
    FAITHFUL,
    FAITHFUL_FLOW,
    FLOW,
    LANDMARKS,
    ORB,
    TWO_AND_RESERVE,
    TWO_NAME,
    UNREGISTERED,
    Driven,
    DriveOutcome,
    Method,
    Plan,
    error_rows,
)

__all__ = ["draw_places", "place_plans", "place_rows"]

_OURS, _FLOW = "landmarks", "optical flow"
_METHODS: Mapping[str, Method] = {
    _OURS: LANDMARKS,
    TWO_NAME: TWO_AND_RESERVE,
    "20 landmarks": {**LANDMARKS, "landmarks": 20},
    "blobs alone": {**LANDMARKS, "finders": ["blobs"]},
    "blobs and rectangles": {**LANDMARKS, "finders": ["blobs", "rectangles"]},
    "fuzzy control, 15 ms allowed": {**LANDMARKS, "adapt": True, "allowed_ms": 15.0},
    _FLOW: FLOW,
    "ORB + depth": ORB,
}
#: Of the camera: little more than the paper's [Hz].
_RATE_HZ = 5.0
#: Pictures a second that the paper reports.
_PAPER_FPS = {"lab": 2.0, "hallway": 4.0}
#: By the names of the methods that they are the printed form of.
_FAITHFUL: Mapping[str, Method] = {_OURS: FAITHFUL, _FLOW: FAITHFUL_FLOW}
_NAMES = {"lab": "laboratory", "hallway": "hallway"}
#: Pictures a second: bar and stretch.
_RATES = {_OURS: (15.0, 30.0), "blobs and rectangles": (25.0, 60.0)}


def place_plans(options: ExperimentOptions) -> list[Plan]:
    """Return 3 m straight in both places, and the same with the camera and the methods of the paper."""
    length_m, place = 0.9 if options.quick else 3.0, options.world_seed
    return [
        Plan(name, world, options.seed, methods, given, length_m=length_m, rate_hz=_RATE_HZ, world_seed=place)
        for world in _NAMES
        for name, methods, given in (("straight", _METHODS, {}), ("as printed", _FAITHFUL, UNREGISTERED))
    ]


def place_rows(driven: Sequence[Driven]) -> list[Row]:
    """Return errors and rates of all methods."""
    rows: list[Row] = []
    for world, called in _NAMES.items():
        straight, printed = _in_world(driven, world), _in_world(driven, world, "as printed")
        name = f"{called}, {straight[0].plan.length_m:g} m"
        rates: list[Row] = []
        for method in _METHODS:
            outcomes = [one.outcomes[method] for one in straight]
            faithful = [one.outcomes[method] for one in printed if method in one.outcomes]
            errors = error_rows(name, method, outcomes, method in (_OURS, TWO_NAME))
            rows += beside_faithful(errors, error_rows(name, method, faithful, is_judged=False) if faithful else [])
            paper = _PAPER_FPS[world] if method == _OURS else None
            rate = _rate_rows(f"{called}, rate", method, outcomes, paper)
            rates += beside_faithful(rate, _rate_rows("", method, faithful, None) if faithful else [])
        rows += rates
    return rows


def _in_world(driven: Sequence[Driven], world: str, name: str = "straight") -> list[Driven]:
    return [one for one in driven if one.plan.world == world and one.plan.name == name]


def _times_ms(outcomes: Iterable[DriveOutcome]) -> Floats:
    return np.concatenate([outcome.times_ms for outcome in outcomes])


def _rate_rows(name: str, method: str, outcomes: Sequence[DriveOutcome], paper: float | None) -> Table:
    """Return how many pictures a second one core would do; the paper's figure is that of its one method."""
    times_ms, n_agree = _times_ms(outcomes), float(np.mean([outcome.n_agree for outcome in outcomes]))
    note = f"p95 {np.percentile(times_ms, 95):.0f} ms CPU time of one thread; {n_agree:.0f} agree on average"
    bar, stretch = _RATES.get(method, (None, None))
    table = Table(name, len(times_ms), len(outcomes))
    fps = 1e3 / float(times_ms.mean())
    table.add_higher(method, "fps", fps, paper=paper, bar=bar, stretch=stretch, note=note)
    return table


def draw_places(options: ExperimentOptions, driven: Sequence[Driven]) -> None:
    """Draw the errors over the way, and the rates beside the paper's."""
    _draw_errors(options, driven)
    title = "pictures a second of one core; dotted: the paper"
    with panels(options.out / "places_rates.svg", 3.6, title) as (figure, (axes,)):
        for k, ((world, called), colour) in enumerate(zip(_NAMES.items(), (BLUE, RED))):
            straight = _in_world(driven, world)
            fps = [1e3 / float(_times_ms(one.outcomes[method] for one in straight).mean()) for method in _METHODS]
            axes.barh(np.arange(len(fps)) + 0.4 * k, fps, 0.38, color=colour, label=called)
            axes.axvline(_PAPER_FPS[world], color=colour, linestyle="dotted", linewidth=1.5)
        axes.set_yticks(np.arange(len(_METHODS)) + 0.2, list(_METHODS))
        axes.invert_yaxis()
        legend_above(figure, 4)


def _draw_errors(options: ExperimentOptions, driven: Sequence[Driven]) -> None:
    shown = {_OURS: BLUE, _FLOW: RED, "ORB + depth": GREEN}
    titles = [f"{called}: distance from the truth [mm], logarithmic" for called in _NAMES.values()]
    with panels(options.out / "places_errors.svg", 4.6, *titles, xlabel="way [m]") as (figure, panes):
        for axes, world in zip(panes, _NAMES):
            for one in _in_world(driven, world):
                for method, colour in shown.items():
                    found = one.outcomes[method]
                    label = method if axes is panes[0] and one.plan.seed == options.seed else None
                    way_m = found.stamps_s * one.plan.speed_mps
                    axes.plot(way_m, 1e3 * found.position_m, color=colour, linewidth=0.9, label=label)
            axes.set_yscale("log")
            axes.yaxis.set_major_formatter(lambda value, _position: f"{value:g}")  # powers would be written in TeX
        legend_above(figure, 4)
