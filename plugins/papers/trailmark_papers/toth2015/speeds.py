"""How fast a robot may drive: the paper says up to 0.3 m/s, with 2 to 4 pictures a second."""

from __future__ import annotations

from collections.abc import Sequence

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.toth2015.drives import LANDMARKS, TWO_AND_RESERVE, TWO_NAME, Driven, Plan, error_rows

__all__ = ["speed_plans", "speed_rows"]

#: Speed [m/s], length [m], pictures a second.
_DRIVES = (
    (0.1, 1.0, 5.0),
    (0.3, 1.5, 15.0),
    (0.6, 3.0, 15.0),
    (1.0, 3.0, 15.0),
    (0.3, 3.0, 2.0),
    (0.6, 3.0, 4.0),
)
_QUICK = ((1.0, 1.5, 15.0),)


def speed_plans(options: ExperimentOptions) -> list[Plan]:
    """Return drives through the laboratory, at several speeds and rates."""
    methods = {"landmarks": LANDMARKS, TWO_NAME: TWO_AND_RESERVE}
    return [
        Plan(
            "speed",
            "lab",
            options.seed,
            methods,
            speed_mps=speed_mps,
            length_m=length_m,
            rate_hz=rate_hz,
            world_seed=options.world_seed,
        )
        for speed_mps, length_m, rate_hz in (_QUICK if options.quick else _DRIVES)
    ]


def speed_rows(driven: Sequence[Driven]) -> list[Row]:
    """Return the errors at every speed; bars where the camera gives what one core can take."""
    rows: list[Row] = []
    for one in driven:
        plan = one.plan
        name = f"laboratory, {plan.speed_mps:g} m/s at {plan.rate_hz:g} fps"
        for method, outcome in one.outcomes.items():
            # Of two landmarks the paper speaks at up to 0.3 m/s.
            is_judged = plan.rate_hz >= 5.0 and (method != TWO_NAME or plan.speed_mps <= 0.3)
            rows += error_rows(name, method, [outcome], is_judged)
    return rows
