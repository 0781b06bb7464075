"""The contract of estimators."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from trailmark.config import PluginConfig
from trailmark.estimates import Applied, Belief, Estimate, Fix, Lost, Motion, information_from_sigmas
from trailmark.geometry import Pose2
from trailmark.interfaces import Estimator, Session
from trailmark.testing.checks.configs import common_checks
from trailmark.testing.checks.parametrize import Check, parametrize

if TYPE_CHECKING:
    import pytest

__all__ = ["estimator_checks", "parametrize_with_estimator_checks"]

_DT_S = 0.1
_N_STEPS = 40
_STEP = Pose2.exp(0.03, 0.0, 0.02)
_MOTION = information_from_sigmas(1e-3, 1e-3, 1e-3)
_FIX = information_from_sigmas(0.02, 0.02, 0.01)
_STATUSES = frozenset({"accepted", "gated", "late", "refused", "unused"})
_DAY_S = 86400.0


def parametrize_with_estimator_checks(
    estimator: type[Estimator], *, config: PluginConfig, expected_failures: Mapping[str, str] | None = None
) -> pytest.MarkDecorator:
    """Parametrize a test over the contract of estimators; the test takes ``check`` and calls it.

    Parameters
    ----------
    estimator : type
        The class.
    config : PluginConfig
        Its config; the estimates come from sources called ``motion`` and ``fix``.
    expected_failures : mapping of str to str
        Checks that it is known not to pass, by name, and why.
    """
    return parametrize(estimator_checks(estimator, config), expected_failures)


def estimator_checks(estimator: type[Estimator], config: PluginConfig) -> dict[str, Check]:
    """Return the checks by name; arguments as of `parametrize_with_estimator_checks`."""

    def make() -> Estimator:
        return estimator(config)

    malformed = {
        "nan": np.full((3, 3), np.nan),
        "infinite": np.diag([np.inf, 1.0, 1.0]),
        "negative": np.diag([-1.0, 1.0, 1.0]),
        "asymmetric": np.array([[1.0, 5.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        "absurdly_certain": np.diag([1e300, 1e300, 1e300]),
        "zero": np.zeros((3, 3)),
    }
    return common_checks(make, lambda: config) | {
        "begins_at_the_start_pose": lambda: _begins(make),
        "motion_carries_the_belief": lambda: _carries(make),
        "a_fix_is_taken": lambda: _takes_a_fix(make),
        "a_fix_leaves_odometry_smooth": lambda: _is_smooth(make),
        "being_lost_changes_nothing": lambda: _ignores_lost(make),
        "beliefs_are_at_the_stamp_asked_for": lambda: _answers_at(make),
        "a_late_fix_is_taken_or_reported": lambda: _takes_late(make),
        "a_jump_in_time_does_no_harm": lambda: _survives_a_jump(make),
        "a_pose_that_is_told_is_believed_or_refused": lambda: _is_told(make),
        "same_estimates_same_beliefs": lambda: _repeats(make),
        "started_again_is_as_new": lambda: _is_as_new(make),
        **{f"{name}_information_does_no_harm": _harmless(make, matrix) for name, matrix in malformed.items()},
    }


def _start_estimator(make: Callable[[], Estimator]) -> Estimator:
    estimator = make()
    estimator.start(Session("estimator", start_pose=Pose2()))
    return estimator


def _true_pose(step: int) -> Pose2:
    return Pose2.exp(0.03 * step, 0.0, 0.02 * step)


def _motion(step: int) -> Motion:
    return Motion((step - 1) * _DT_S, step * _DT_S, _STEP, _MOTION)


def _apply(estimator: Estimator, source: str, estimate: Estimate) -> Applied:
    applied = estimator.apply(source, estimate)
    assert isinstance(applied, Applied), f"apply returned {applied!r}: every estimate is answered with Applied"
    assert applied.status in _STATUSES, f"{applied.status!r} is no status; statuses: {', '.join(sorted(_STATUSES))}"
    assert applied.status == "accepted" or applied.reason, f"{applied.status} without a reason"
    _is_sane(estimator.belief())
    return applied


def _drive(estimator: Estimator, n_steps: int = _N_STEPS) -> None:
    for step in range(1, n_steps + 1):
        _apply(estimator, "motion", _motion(step))


def _is_sane(belief: Belief) -> None:
    pose, covariance = belief.pose_map_base, belief.covariance
    assert pose is None or np.isfinite(pose.array()).all(), f"the belief is at {pose}"
    assert np.isfinite(belief.pose_odom_base.array()).all(), f"odometry is at {belief.pose_odom_base}"
    if covariance is not None:
        assert np.isfinite(covariance).all(), "the covariance is not finite"
        lowest = float(np.linalg.eigvalsh((covariance + covariance.T) / 2)[0])
        assert lowest >= -1e-12 * float(np.abs(covariance).max()), f"the covariance has the eigenvalue {lowest:.3g}"


def _pose(belief: Belief) -> Pose2:
    assert belief.pose_map_base is not None, "it began at a pose and now knows none"
    return belief.pose_map_base


def _begins(make: Callable[[], Estimator]) -> None:
    belief = _start_estimator(make).belief(0.0)
    _is_sane(belief)
    assert _pose(belief) == Pose2(), f"it starts at the origin and believes {belief.pose_map_base}"


def _carries(make: Callable[[], Estimator]) -> None:
    estimator = _start_estimator(make)
    _drive(estimator)
    off_m = _pose(estimator.belief()).distance_to(_true_pose(_N_STEPS))
    assert off_m <= 1e-6, f"exact motion alone leads {off_m:.2g} m off"
    travelled_m = estimator.belief().travelled_m
    assert abs(travelled_m - 0.03 * _N_STEPS) <= 1e-3, f"it drove {0.03 * _N_STEPS} m and believes {travelled_m} m"


def _takes_a_fix(make: Callable[[], Estimator]) -> None:
    estimator = _start_estimator(make)
    _drive(estimator)
    fixed = _true_pose(_N_STEPS) @ Pose2(0.01, 0.005, 0.002)
    before_m = _pose(estimator.belief()).distance_to(fixed)
    status = _apply(estimator, "fix", Fix(_N_STEPS * _DT_S, fixed, _FIX)).status
    after_m = _pose(estimator.belief()).distance_to(fixed)
    assert status == "accepted", f"a fix a centimetre off was {status}"
    assert after_m < before_m, "a fix does not move the belief towards it"


def _is_smooth(make: Callable[[], Estimator]) -> None:
    estimator = _start_estimator(make)
    _drive(estimator)
    before = estimator.belief().pose_odom_base
    _apply(estimator, "fix", Fix(_N_STEPS * _DT_S, _true_pose(_N_STEPS) @ Pose2(0.02, 0.01, 0.01), _FIX))
    assert estimator.belief().pose_odom_base.distance_to(before) <= 1e-12, "a fix makes pose_odom_base jump"


def _ignores_lost(make: Callable[[], Estimator]) -> None:
    estimator = _start_estimator(make)
    _drive(estimator)
    before = _pose(estimator.belief())
    assert _apply(estimator, "motion", Lost(_N_STEPS * _DT_S, "checked")).status == "unused"
    assert _pose(estimator.belief()) == before, "being lost moves the belief"


def _answers_at(make: Callable[[], Estimator]) -> None:
    estimator = _start_estimator(make)
    _drive(estimator)
    for stamp_s in (_N_STEPS * _DT_S, (_N_STEPS - 5.5) * _DT_S, _N_STEPS * _DT_S + 0.05):
        belief = estimator.belief(stamp_s)
        _is_sane(belief)
        assert math.isclose(belief.stamp_s, stamp_s), f"asked for {stamp_s} s it answers about {belief.stamp_s} s"
        off_m = _pose(belief).distance_to(Pose2.exp(0.3 * stamp_s, 0.0, 0.2 * stamp_s))
        assert off_m <= 0.02, f"at {stamp_s} s it is {off_m:.3f} m off"


def _takes_late(make: Callable[[], Estimator]) -> None:
    estimator = _start_estimator(make)
    _drive(estimator)
    fixed = _true_pose(_N_STEPS // 2) @ Pose2(0.01, 0.005, 0.002)
    before = _pose(estimator.belief())
    status = _apply(estimator, "fix", Fix(_N_STEPS // 2 * _DT_S, fixed, _FIX)).status
    moved_m = _pose(estimator.belief()).distance_to(before)
    assert (moved_m > 1e-6) == (status == "accepted"), (
        f"a late fix was {status} and moved the belief by {moved_m:.2g} m"
    )


def _survives_a_jump(make: Callable[[], Estimator]) -> None:
    estimator = _start_estimator(make)
    _drive(estimator)
    for shift_s in (-_DAY_S, _DAY_S):
        stamp_s = max(0.0, _N_STEPS * _DT_S) + shift_s
        _apply(estimator, "motion", Motion(stamp_s - _DT_S, stamp_s, _STEP, _MOTION))
        _apply(estimator, "fix", Fix(stamp_s, _true_pose(_N_STEPS), _FIX))


def _is_told(make: Callable[[], Estimator]) -> None:
    estimator = _start_estimator(make)
    _drive(estimator)
    before, told = _pose(estimator.belief()), Pose2(5.0, 6.0, 1.0)
    for name, covariance in (("nan", np.full((3, 3), np.nan)), ("negative", -np.eye(3))):
        status = estimator.set_pose(told, covariance).status
        assert status == "refused", f"a pose whose covariance is {name} was {status}"
        assert _pose(estimator.belief()) == before, f"a pose whose covariance is {name} moves the belief"
    status = estimator.set_pose(told).status
    off_m = _pose(estimator.belief()).distance_to(told)
    assert (off_m <= 1e-6) == (status == "accepted"), f"a pose that was told was {status}: it is {off_m:.2g} m from it"


def _beliefs(estimator: Estimator) -> list[tuple[Any, ...]]:
    seen = []
    for step in range(1, _N_STEPS + 1):
        _apply(estimator, "motion", _motion(step))
        if step % 10 == 0:
            _apply(estimator, "fix", Fix((step - 3) * _DT_S, _true_pose(step - 3) @ Pose2(0.01, 0.0, 0.0), _FIX))
        belief = estimator.belief()
        covariance = None if belief.covariance is None else belief.covariance.tobytes()
        seen.append((belief.stamp_s, belief.pose_map_base, covariance, belief.travelled_m))
    return seen


def _repeats(make: Callable[[], Estimator]) -> None:
    assert _beliefs(_start_estimator(make)) == _beliefs(_start_estimator(make)), (
        "the same estimates lead to other beliefs"
    )


def _is_as_new(make: Callable[[], Estimator]) -> None:
    estimator = _start_estimator(make)
    first = _beliefs(estimator)
    estimator.start(Session("estimator", start_pose=Pose2()))
    assert _beliefs(estimator) == first, "started again it believes something else"


def _harmless(make: Callable[[], Estimator], information: Any) -> Check:
    def check() -> None:
        estimator = _start_estimator(make)
        _drive(estimator, 10)
        _apply(estimator, "fix", Fix(10 * _DT_S, _true_pose(10) @ Pose2(0.01, 0.0, 0.0), information))
        _apply(estimator, "motion", Motion(10 * _DT_S, 11 * _DT_S, _STEP, information))
        for step in range(12, 20):
            _apply(estimator, "motion", _motion(step))
        off_m = _pose(estimator.belief()).distance_to(_true_pose(19))
        assert off_m <= 0.1, f"it leaves the belief {off_m:.2f} m off"

    return check
