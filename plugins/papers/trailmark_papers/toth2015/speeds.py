"""How fast a robot may drive: the paper says up to 0.3 m/s, with 2 to 4 pictures a second."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import beside_faithful
from trailmark_papers.toth2015.drives import (
    FAITHFUL,
    LANDMARKS,
    TWO_AND_RESERVE,
    TWO_NAME,
    UNREGISTERED,
    Driven,
    Method,
    Plan,
    error_rows,
)

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
_PAPER_MPS = 0.3
_METHODS: Mapping[str, Method] = {"landmarks": LANDMARKS, TWO_NAME: TWO_AND_RESERVE}
_PRINTED = "speed, as printed"
_QUICK = ((1.0, 1.5, 15.0),)


class _Drive(NamedTuple):
    """How fast [m/s], how far [m], how many pictures a second, by whom, with which options of the world."""

    speed_mps: float
    length_m: float
    rate_hz: float
    name: str
    methods: Mapping[str, Method]
    options: Mapping[str, Any] = {}


def speed_plans(options: ExperimentOptions) -> list[Plan]:
    """Return drives through the laboratory, at several speeds and rates."""
    drives = [_Drive(*drive, "speed", _METHODS) for drive in (_QUICK if options.quick else _DRIVES)]
    # Of the speed the paper speaks at up to 0.3 m/s, by its own method.
    slow = [] if options.quick else [drive for drive in _DRIVES if drive[0] <= _PAPER_MPS]
    drives += [_Drive(*drive, _PRINTED, {"landmarks": FAITHFUL}, UNREGISTERED) for drive in slow]
    return [
        Plan(
            drive.name,
            "lab",
            options.seed,
            drive.methods,
            drive.options,
            speed_mps=drive.speed_mps,
            length_m=drive.length_m,
            rate_hz=drive.rate_hz,
            world_seed=options.world_seed,
        )
        for drive in drives
    ]


def speed_rows(driven: Sequence[Driven]) -> list[Row]:
    """Return the errors at every speed; bars where the camera gives what one core can take."""
    printed = {_how(one.plan): one.outcomes for one in driven if one.plan.name == _PRINTED}
    rows: list[Row] = []
    for one in driven:
        plan = one.plan
        if plan.name == _PRINTED:
            continue
        name = f"laboratory, {plan.speed_mps:g} m/s at {plan.rate_hz:g} fps"
        for method, outcome in one.outcomes.items():
            # Of two landmarks the paper speaks at up to 0.3 m/s.
            is_judged = plan.rate_hz >= 5.0 and (method != TWO_NAME or plan.speed_mps <= _PAPER_MPS)
            faithful = printed.get(_how(plan), {}).get(method)
            beside = error_rows("", method, [faithful], is_judged=False) if faithful else ()
            rows += beside_faithful(error_rows(name, method, [outcome], is_judged), beside)
    return rows


def _how(plan: Plan) -> tuple[float, float]:
    return plan.speed_mps, plan.rate_hz
