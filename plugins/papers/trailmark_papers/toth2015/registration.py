"""Depth of a camera beside the colour camera: registered by reprojection, and by the paper's crop ratios."""

from __future__ import annotations

from collections.abc import Sequence

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.toth2015.drives import CROP, LANDMARKS, UNREGISTERED, Driven, Plan, error_rows

__all__ = ["registration_plans", "registration_rows"]


def registration_plans(options: ExperimentOptions) -> list[Plan]:
    """Return one drive; both ways see the same pictures."""
    if options.quick:
        return []
    methods = {"by reprojection": LANDMARKS, "by crop ratios": {**LANDMARKS, "crop": CROP}}
    return [
        Plan(
            "registration",
            "lab",
            options.seed,
            methods,
            UNREGISTERED,
            rate_hz=5.0,
            world_seed=options.world_seed,
        )
    ]


def registration_rows(driven: Sequence[Driven]) -> list[Row]:
    """Return the errors of both."""
    return [
        row
        for one in driven
        for method, outcome in one.outcomes.items()
        for row in error_rows("laboratory, depth not registered", method, [outcome], method == "by reprojection")
    ]
