"""One step of several that localizers measured over the same piece of time, and which of them cannot be right.

Steps are weighed by their information: independent errors, or covariance intersection with equal weights. A step that
contradicts all others is tested against the velocity before, too. If it contradicts that as well it is left out; if no
step does, nobody knows who is wrong, and all count for as much less as they disagree.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from trailmark.estimation.information import says_something
from trailmark.estimation.kalman.gate import threshold
from trailmark.estimation.kalman.motions import MotionStep
from trailmark.estimation.kalman.state import MotionCheck
from trailmark.estimation.kalman.trust import root_of
from trailmark.estimation.symmetric import NOTHING, ZERO, Sym3, add, diagonal, inverse, scaled, to_matrix
from trailmark.geometry import Pose2, Twist2, wrap_angle
from trailmark.values import quick_dataclass

__all__ = [
    "StepSelection",
    "fuse_steps",
    "information_of",
    "nis_between",
    "replace_impossible_jump",
    "select_steps",
    "without_outliers",
]

SourceStep = tuple[str, MotionStep]

# Between two readings; a robot that is hit by another changes its velocity by less [m/s].
_IMPOSSIBLE_MPS = 15.0


@quick_dataclass(frozen=True, slots=True, eq=False)
class StepSelection:
    """What is left of several steps.

    Attributes
    ----------
    steps : sequence of (str, MotionStep)
        Those that count.
    left_out : tuple of str
        Localizers whose steps do not.
    checks : tuple of MotionCheck
        The test of each step against the others.
    """

    steps: Sequence[SourceStep]
    left_out: tuple[str, ...] = ()
    checks: tuple[MotionCheck, ...] = ()


def select_steps(
    steps: Sequence[SourceStep], dt_s: float, held: Twist2, drift: Sym3, gate_of: Callable[[str], float | None]
) -> StepSelection:
    """Return which steps count.

    Parameters
    ----------
    steps : sequence of (str, MotionStep)
        By localizer, at least two.
    dt_s : float
        Length of the piece [s].
    held : Twist2
        The velocity before.
    drift : Sym3
        Covariance of the step that a held velocity predicts.
    gate_of : callable
        Probability with which a right step of a localizer passes; None: no test.
    """
    kept, left_out, found = list(steps), [], {}
    while len(kept) > 1:
        checks = _checks(kept, dt_s, held, drift)
        found.update({source: (nis, dof) for source, nis, dof in checks})
        failing = [k for k, (source, nis, dof) in enumerate(checks) if _fails(nis, dof, gate_of(source))]
        if not failing:
            break
        before = _held_step(held, dt_s, drift)
        surprise = {k: nis_between(kept[k][1], before) for k in failing}
        worst = max(failing, key=lambda k: surprise[k][0])
        source = kept[worst][0]
        if not _fails(*surprise[worst], gate_of(source)):
            disagreement = max(nis / dof for _, nis, dof in checks if dof)
            kept = [(name, _less_certain(step, disagreement)) for name, step in kept]
            break
        left_out.append(source)
        del kept[worst]
    return StepSelection(
        kept, tuple(left_out), tuple(MotionCheck(source, *found[source]) for source, _ in steps if source in found)
    )


def replace_impossible_jump(steps: Sequence[SourceStep], dt_s: float, held: Twist2) -> StepSelection:
    """Return a lone step as it is; if no push changes a robot's velocity like this, the velocity before in its place.

    Then it is as uncertain as the two differ.
    """
    source, step = steps[0]
    twist = step.twist
    change_mps = math.hypot(twist.forward_mps - held.forward_mps, twist.left_mps - held.left_mps)
    if change_mps <= _IMPOSSIBLE_MPS or step.covariance is None:
        return StepSelection(steps)
    ahead = held.after(dt_s)
    doubt = diagonal((step.x - ahead.x) ** 2, (step.y - ahead.y) ** 2, wrap_angle(step.turn - ahead.theta) ** 2)
    instead = MotionStep(ahead.x, ahead.y, ahead.theta, add(step.covariance, doubt), None, held)
    return StepSelection([(source, instead)], (source,))


def without_outliers(
    steps: Sequence[SourceStep], selection: StepSelection, left_out: Mapping[str, int]
) -> list[SourceStep]:
    """Return steps, with that of others in place of one that is left out for the first time: it has had its effect.

    Parameters
    ----------
    steps : sequence of (str, MotionStep)
        Of all localizers.
    selection : StepSelection
        Which of them count.
    left_out : mapping of str to int
        Localizers whose steps do not, and in how many of its motions in a row.
    """
    instead = selection.steps[0][1]
    return [(source, instead if left_out.get(source) == 1 else step) for source, step in steps]


def _checks(steps: Sequence[SourceStep], dt_s: float, held: Twist2, drift: Sym3) -> list[tuple[str, float, int]]:
    if len(steps) == 2 and steps[0][1].covariance is not None and steps[1][1].covariance is not None:
        nis, dof = nis_between(steps[0][1], steps[1][1])
        return [(source, nis, dof) for source, _ in steps]
    checks = []
    for k, (source, step) in enumerate(steps):
        others = [other for i, (_, other) in enumerate(steps) if i != k]
        checks.append((source, *nis_between(step, fuse_steps(others, dt_s, held, drift, True)[0])))
    return checks


def nis_between(step: MotionStep, other: MotionStep) -> tuple[float, int]:
    """Return NIS and degrees of freedom of a step against another whose covariance is known."""
    assert other.covariance is not None
    dx, dy, turn = step.x - other.x, step.y - other.y, wrap_angle(step.turn - other.turn)
    if step.covariance is not None:
        weight = inverse(add(step.covariance, other.covariance))
        if weight is not None:
            a, b, c = _product(weight, dx, dy, turn)
            return dx * a + dy * b + turn * c, 3
    information = information_of(step)
    axis = _only_axis(information)
    if axis is not None:  # a gyro: the same as below, to the last bit, in a tenth of the time
        root_one = math.sqrt((information[0], information[3], information[5])[axis])
        away_one = root_one * (dx, dy, turn)[axis]
        variance = (other.covariance[0], other.covariance[3], other.covariance[5])[axis]
        return away_one * (away_one / (root_one * variance * root_one + 1.0)), 1
    root = root_of(information)
    away = root @ (dx, dy, turn)
    spread = root @ to_matrix(other.covariance) @ root.T + np.eye(len(root))
    return float(away @ np.linalg.solve(spread, away)), len(root)


def _only_axis(information: Sym3) -> int | None:
    """Return the axis that alone was measured, 0 to 2; None if that is not so."""
    xx, xy, xt, yy, yt, tt = information
    measured = [axis for axis, value in enumerate((xx, yy, tt)) if value > NOTHING]
    return measured[0] if len(measured) == 1 and xy == xt == yt == 0.0 else None


def information_of(step: MotionStep) -> Sym3:
    """Return the information of a step."""
    return step.inverse_covariance()


def _held_step(held: Twist2, dt_s: float, drift: Sym3) -> MotionStep:
    ahead = held.after(dt_s)
    return MotionStep(ahead.x, ahead.y, ahead.theta, drift, None, held)


def _fails(nis: float, dof: int, gate: float | None) -> bool:
    return gate is not None and dof > 0 and nis > threshold(gate, dof)


def _less_certain(step: MotionStep, factor: float) -> MotionStep:
    if step.covariance is not None:
        return replace(step, covariance=scaled(step.covariance, factor))
    return replace(step, information=scaled(step.information or ZERO, 1.0 / factor))


def fuse_steps(
    steps: Sequence[MotionStep], dt_s: float, held: Twist2, drift: Sym3, is_independent: bool
) -> tuple[MotionStep, bool]:
    """Return the step that several localizers measured together, and whether they measured all of it.

    Parameters
    ----------
    steps : sequence of MotionStep
        At least one, over the same interval.
    dt_s : float
        Its length [s].
    held : Twist2
        The velocity before: a direction that nobody measured goes on with it.
    drift : Sym3
        Covariance of a step that nobody measured.
    is_independent : bool
        Whether information adds up; otherwise it is averaged.
    """
    first = steps[0]
    if len(steps) == 1 and first.covariance is not None and says_something(first.covariance, drift):
        return first, True
    share = 1.0 if is_independent else 1.0 / len(steps)
    sum_xx = sum_xy = sum_xt = sum_yy = sum_yt = sum_tt = 0.0  # of the information, and below its moment
    moment_x = moment_y = moment_turn = 0.0
    for step in steps:
        xx, xy, xt, yy, yt, tt = scaled(step.inverse_covariance(), share)
        x, y, turn = step.x, step.y, first.turn + wrap_angle(step.turn - first.turn)
        sum_xx, sum_xy, sum_xt = sum_xx + xx, sum_xy + xy, sum_xt + xt
        sum_yy, sum_yt, sum_tt = sum_yy + yy, sum_yt + yt, sum_tt + tt
        moment_x += xx * x + xy * y + xt * turn
        moment_y += xy * x + yy * y + yt * turn
        moment_turn += xt * x + yt * y + tt * turn
    information, moment = (sum_xx, sum_xy, sum_xt, sum_yy, sum_yt, sum_tt), (moment_x, moment_y, moment_turn)
    covariance = inverse(information)
    is_measured = covariance is not None and says_something(covariance, drift)
    if not is_measured:
        coasted, floor = held.after(dt_s), inverse(drift) or ZERO
        moment = _sum(moment, _product(floor, coasted.x, coasted.y, coasted.theta))
        covariance = inverse(add(information, floor)) or drift
    assert covariance is not None
    x, y, turn = _product(covariance, *moment)
    forward_m, left_m, turn_rad = Pose2(x, y, turn).log()
    return MotionStep(
        x, y, turn, covariance, None, Twist2(forward_m / dt_s, left_m / dt_s, turn_rad / dt_s)
    ), is_measured


def _product(a: Sym3, x: float, y: float, turn: float) -> tuple[float, float, float]:
    xx, xy, xt, yy, yt, tt = a
    return xx * x + xy * y + xt * turn, xy * x + yy * y + yt * turn, xt * x + yt * y + tt * turn


def _sum(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float, float]:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]
