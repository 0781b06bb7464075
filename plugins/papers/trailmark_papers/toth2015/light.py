"""What it buys to make up for the light, and what the sensor of light adds: lamps that dim, and a view that darkens.

The picture tells how its camera took a change; the sensor tells how much of it was light. Where lamps dim, both say the
same. Where the camera exposes by itself, pictures stay as they were. Where half of the view turns black and the lamps
do not, the picture alone is misled. Landmarks are told apart by their looks alone, as in the paper, or followed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import Table, rms
from trailmark_papers.toth2015.drives import LANDMARKS, Driven, DriveOutcome, Method, Plan

__all__ = ["LIGHTS", "light_plans", "light_rows"]

#: How the light is taken: keys of the localizer.
LIGHTS: Mapping[str, Mapping[str, Any]] = {
    "sensor and picture": {},
    "picture alone": {"light": None},
    "not made up for": {"light": "same"},
}
_METHODS: Mapping[str, Method] = {
    f"{told}, {said}": {**LANDMARKS, **how, **light}
    for told, how in (("by colours", {"refind": "look"}), ("followed", {}))
    for said, light in LIGHTS.items()
}
_CHANGE_S = 2.0


@dataclass(frozen=True)
class _LightChange:
    """What changes after 2 s: options of the world, and when half of the view turns black [s]."""

    options: Mapping[str, Any] = field(default_factory=dict)
    view: Mapping[str, Any] = field(default_factory=dict)


_DIM: Mapping[str, Any] = {"dims_s": _CHANGE_S, "dims_to": 0.2}
_CHANGES: Mapping[str, _LightChange] = {
    "lamps to 20 %, fixed exposure": _LightChange({**_DIM, "exposure": 1.0}),
    "lamps to 20 %, the camera exposes by itself": _LightChange(_DIM),
    "half of the view black, fixed exposure": _LightChange({"exposure": 1.0}, {"covered_s": _CHANGE_S}),
}


def light_plans(options: ExperimentOptions) -> list[Plan]:
    """Return a short drive through the laboratory for each change; the quick version leaves this out."""
    if options.quick:
        return []
    place = options.world_seed
    return [
        Plan(name, "lab", options.seed, _METHODS, change.options, length_m=1.2, world_seed=place, **change.view)
        for name, change in _CHANGES.items()
    ]


def light_rows(driven: Sequence[Driven]) -> list[Row]:
    """Return position errors and the share of pictures with a pose."""
    return [row for one in driven for method, outcome in one.outcomes.items() for row in _rows_of(one, method, outcome)]


def _rows_of(driven: Driven, method: str, outcome: DriveOutcome) -> Table:
    table = Table(f"laboratory, {driven.plan.name}", len(outcome.errors))
    table.add(f"{method}: position, rms", "m", rms(outcome.position_m))
    table.add_higher(f"{method}: pictures with a pose", "%", outcome.pose_percent)
    return table
