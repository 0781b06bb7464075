"""What a lived-in place does: a landmark walks away, one is covered, people cross, the light is turned down."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from trailmark.experiments import ExperimentOptions, Row
from trailmark.report.drawing import BLUE, GREEN, MUTED, RED, legend_above
from trailmark_papers.kit import Table, beside_faithful, panels, rms
from trailmark_papers.toth2015.drives import (
    FAITHFUL,
    FAITHFUL_FLOW,
    FLOW,
    LANDMARKS,
    ORB,
    UNREGISTERED,
    Driven,
    DriveOutcome,
    Method,
    Plan,
)

__all__ = ["disturbance_plans", "disturbance_rows", "draw_disturbances"]

_OURS = "landmarks"
_FLOW = "optical flow"
_METHODS: Mapping[str, Method] = {_OURS: LANDMARKS, _FLOW: FLOW, "ORB + depth": ORB}
#: The same as the paper prints it, on its camera, in the laboratory; told apart by what follows the name of a drive.
_FAITHFUL: Mapping[str, Method] = {_OURS: FAITHFUL, _FLOW: FAITHFUL_FLOW}
_PRINTED = ", as printed"
_WALKS, _COVERED, _PEOPLE, _DARK = "a landmark walks away", "a landmark is covered", "people cross", "light to 20 %"
#: Options of the worlds; things begin after 2 s.
_DISTURBANCES: Mapping[str, Mapping[str, Any]] = {
    _WALKS: {"crate": "walks_off", "crate_s": 2.0},
    _COVERED: {"crate": "covered", "crate_s": 2.0},
    _PEOPLE: {"people": 4},
    _DARK: {"dims_s": 2.0, "dims_to": 0.2, "exposure": 1.0},
}
_PLACES = {"lab": "laboratory", "hallway": "hallway"}


def disturbance_plans(options: ExperimentOptions) -> list[Plan]:
    """Return a drive for each disturbance, in the laboratory and in the hallway."""
    place = options.world_seed
    if options.quick:
        few = {_OURS: LANDMARKS}
        return [
            Plan(name, "lab", options.seed, few, _DISTURBANCES[name], length_m=length_m, world_seed=place)
            for name, length_m in ((_WALKS, 1.2), (_DARK, 0.9))
        ]
    driven = [(name, world, _METHODS, given) for name, given in _DISTURBANCES.items() for world in _PLACES]
    printed = [(name + _PRINTED, "lab", _FAITHFUL, {**given, **UNREGISTERED}) for name, given in _DISTURBANCES.items()]
    return [
        Plan(name, world, options.seed, methods, given, length_m=1.2, world_seed=place)
        for name, world, methods, given in driven + printed
    ]


def disturbance_rows(driven: Sequence[Driven]) -> list[Row]:
    """Return the jumps, the errors, and in the dark the share of pictures with a pose."""
    found = {(one.plan.name, one.plan.world): one.outcomes for one in driven}
    rows: list[Row] = []
    for name in _DISTURBANCES:
        for world, called in _PLACES.items():
            printed = found.get((name + _PRINTED, world), {})
            for method, outcome in found.get((name, world), {}).items():
                faithful = _rows_of("", method, printed[method]) if method in printed else ()
                rows += beside_faithful(_rows_of(f"{called}, {name}", method, outcome), faithful)
    return rows


def _rows_of(name: str, method: str, outcome: DriveOutcome) -> Table:
    table = Table(name, len(outcome.errors))
    jump, share = ({"bar": 0.05, "stretch": 0.02}, {"bar": 90.0, "stretch": 98.0}) if method == _OURS else ({}, {})
    table.add(f"{method}: largest jump", "m", outcome.jump_m, **jump)
    table.add(f"{method}: position, rms", "m", rms(outcome.position_m))
    table.add_higher(f"{method}: pictures with a pose", "%", outcome.pose_percent, **share)
    return table


def draw_disturbances(options: ExperimentOptions, driven: Sequence[Driven]) -> None:
    """Draw the errors over time in the laboratory, one picture for each disturbance."""
    shown = [one for one in driven if one.plan.world == "lab" and not one.plan.name.endswith(_PRINTED)]
    titles = [f"{one.plan.name}: distance from the truth [mm]" for one in shown]
    path = options.out / "disturbances.svg"
    with panels(path, 0.6 + 2.0 * len(shown), *titles, xlabel="time [s]") as (figure, panes):
        for axes, one in zip(panes, shown):
            for (method, outcome), colour in zip(one.outcomes.items(), (BLUE, RED, GREEN)):
                label = method if axes is panes[0] else None
                axes.plot(outcome.stamps_s, 1e3 * outcome.position_m, color=colour, linewidth=0.9, label=label)
            if one.plan.name != _PEOPLE:
                axes.axvline(2.0, color=MUTED, linestyle="dotted", linewidth=1.0)
        legend_above(figure, 3)
