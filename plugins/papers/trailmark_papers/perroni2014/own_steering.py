"""Fig. 5 with the paper's own steering: how often it comes back, and where it goes wrong.

Turn, drive straight until the drift is known again, turn again: after every turn a new stream is collected, and its
first shift is the maximum of one vector (Fig. 1). So the printed steering rests on first shifts, of which the drives
off-line have one each. Here they are counted, beside drives in which one thing is changed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from trailmark.estimates import PathOffset
from trailmark.experiments import ExperimentOptions, Row
from trailmark.geometry import Trajectory
from trailmark.paths import Path
from trailmark.pipeline import Pipeline, Step
from trailmark_papers.kit import Table, group_by, sweep, truth_of
from trailmark_papers.perroni2014.drives import AFTERNOON, FAITHFUL, Deviation, Place, Replay, Taught

__all__ = ["CASES", "FirstShifts", "SteeredDrive", "SteeringCase", "own_steering_rows", "steered_drive"]

_LENGTH_M, _WIDTH_PX = 10.0, 160
_ANGLES_DEG = (5.0, -5.0)
_END_M, _END_DEG, _GROWTH_M = 0.30, 3.0, 0.10
_NAME = "faithful"
#: Sideways way that shifts a picture as a turn of one radian does, the default of `divs` [m].
_DEPTH_M = 6.0
#: A picture that is displaced by less has no side [rad].
_NO_SIDE_RAD = math.radians(1.0)


@dataclass(frozen=True, slots=True)
class SteeringCase:
    """What differs from the method as printed, in an afternoon with three people.

    Attributes
    ----------
    localizer : mapping
        Keys of `divs` beside the preset.
    options : mapping
        Of the world, where they differ from teaching.
    """

    localizer: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=lambda: AFTERNOON)


CASES: Mapping[str, SteeringCase] = {
    "as printed": SteeringCase(),
    "as printed, nobody about and the light of teaching": SteeringCase(options={}),
    "its steering, our choice of the shift": SteeringCase({"shift": "robust", "confidence": 0.8}),
}


class FirstShifts:
    """Keeps the first shift after every silence, as a pipeline's ``on_step``."""

    def __init__(self) -> None:
        self.shifts: list[tuple[float, float]] = []
        self._is_silent = True

    def __call__(self, pipeline: Pipeline, step: Step) -> None:
        """Keep stamp and shift of an answer before which there was none [s, columns]."""
        for one in step.estimates:
            if one.source != _NAME:
                continue
            estimate = one.estimate
            if isinstance(estimate, PathOffset) and self._is_silent:
                self.shifts.append((estimate.stamp_s, float(estimate.details["shift_columns"])))
            self._is_silent = not isinstance(estimate, PathOffset)

    def sides(self, truth: Trajectory, path: Path) -> list[bool]:
        """Return for each first shift whether it is of the side to which the view was truly displaced.

        Where the view is displaced by less than a degree there is no side to be right about: these are left out.
        """
        found = []
        for stamp_s, shift in self.shifts:
            pose = truth.at([min(max(stamp_s, truth.stamps_s[0]), truth.stamps_s[-1])])[0][1]
            where = path.locate(pose)
            displaced_rad = where.heading_rad + math.atan2(where.lateral_m, _DEPTH_M)
            if abs(displaced_rad) >= _NO_SIDE_RAD:
                found.append(shift * displaced_rad > 0.0)
        return found


@dataclass(frozen=True, slots=True, eq=False)
class SteeredDrive:
    """A drive by the printed steering.

    Attributes
    ----------
    way : Deviation
        How it went.
    sides : sequence of bool
        Of its first shifts, in their order; see `FirstShifts.sides`.
    """

    way: Deviation
    sides: Sequence[bool]

    @property
    def came_back(self) -> bool:
        """Whether it arrived near the taught end, along the taught heading, without drifting off again."""
        way = self.way
        return way.arrived and way.end_m <= _END_M and way.end_deg <= _END_DEG and way.growth_m <= _GROWTH_M


def own_steering_rows(options: ExperimentOptions) -> list[Row]:
    """Return how often each case came back and what its first shifts were; the quick version leaves this out."""
    if options.quick:
        return []
    place = Place("street", _LENGTH_M, _WIDTH_PX, world_seed=options.world_seed)
    taught = place.teach(options.out / "runs" / "own-steering", {_NAME: FAITHFUL}, options.seed)
    cells = {(name, angle): (taught, name, angle, options.seed) for name in CASES for angle in _ANGLES_DEG}
    found = group_by(sweep(options, steered_drive, cells), lambda cell: cell[0])
    options.report(", ".join(f"{name}: {sum(one.came_back for one in found[name])} back" for name in CASES))
    return [row for name, drives in found.items() for row in _rows_of(name, drives)]


def steered_drive(taught: Taught, name: str, turned_deg: float, seed: int) -> SteeredDrive:
    """Replay a taught way by the printed steering, from a start turned aside."""
    case, keeper = CASES[name], FirstShifts()
    localizers = {_NAME: {**FAITHFUL, **case.localizer}}
    how = Replay(localizers, seed, case.options, turned_deg, controller={"preset": "paper"})
    result = taught.replay(how, keeper)
    return SteeredDrive(taught.deviation(result), keeper.sides(truth_of(result), taught.path()))


def _rows_of(name: str, drives: Sequence[SteeredDrive]) -> Table:
    table = Table("Fig. 5 street, the paper's steering", len(drives), 1)
    table.add_share(f"{name}: came back to the path", [one.came_back for one in drives])
    table.add(f"{name}: offset at the end, max", "m", max(one.way.end_m for one in drives))
    sides = [side for one in drives for side in one.sides]
    if sides:
        table.add_share(f"{name}: first shift after a silence, of the right side", sides, n=len(sides))
    return table
