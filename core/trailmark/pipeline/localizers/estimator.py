"""The estimator at work: timed, guarded, and given every estimate once."""

from __future__ import annotations

import math
from array import array
from collections.abc import Collection
from dataclasses import replace
from numbers import Real
from time import perf_counter_ns
from types import MappingProxyType

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ConfigError, StoreFailedError
from trailmark.estimates import ALL_HEALTHY, Applied, Belief, Estimate, Fix, Motion, PathOffset
from trailmark.failures import raise_failure
from trailmark.frames.payloads import read_only
from trailmark.geometry import Pose2
from trailmark.geometry.trajectory import FARTHEST_M
from trailmark.interfaces import Estimator
from trailmark.pipeline.localizers.runner import LONGEST_REASON, LocalizerFailedError
from trailmark.pipeline.parts import LocalizerPart

__all__ = ["EstimatorRunner"]

# Stamps that went through decimals differ by this from the frame's.
_SLACK_S = 1e-6

_NOT_IN_USE = Applied("unused", "not in the estimator's 'use'")


class EstimatorRunner:
    """Runs the estimator, with the rules that hold for every one.

    An estimate of a localizer that is not in ``use`` is ``unused``; one about an instant after its frame is
    ``refused``; a second localizer that gives `Motion` of the same sensor (or, if the estimator integrates one only,
    any second one) is an error unless ``use`` says that both are meant, or that of one is spare: then it is ``unused``.

    Parameters
    ----------
    estimator : Estimator
        The part.
    use : frozenset of str or None
        The localizers whose estimates it takes; None: all.
    times : array of int
        Takes the duration of every call [ns].

    Attributes
    ----------
    health : dict of str to str
        What a belief says of localizers that were switched off; this stands before what the estimator says.
    """

    def __init__(self, estimator: Estimator, use: frozenset[str] | None, times: array[int]) -> None:
        self.health: dict[str, str] = {}
        self._told_health: dict[str, str] = {}  # by localizers of themselves; the estimator's word goes before
        self._estimator = estimator
        self._use = use
        self._times = times
        self._moving: dict[str, LocalizerPart] = {}
        self._moved_s: dict[str, float] = {}  # until when each of them has told of a way
        self._spared: dict[str, str] = {}  # whose motion is left out, and for whose
        self._last_belief: tuple[float, Belief] | None = None  # and the stamp that was asked for; until more is applied

    def set_pose(self, pose_map_base: Pose2, covariance: Floats | None = None, stamp_s: float | None = None) -> Applied:
        """Tell the estimator where a person says that the robot is; what is no pose is refused.

        Raises
        ------
        RunError
            If the estimator raises.
        """
        if (problem := _problem_of(pose_map_base, covariance, stamp_s)) is not None:
            return Applied("refused", problem)
        self._last_belief = None
        try:
            when = () if stamp_s is None else (stamp_s,)
            outcome = self._estimator.set_pose(pose_map_base, covariance, *when)
            if not isinstance(outcome, Applied):
                raise TypeError(f"it returned {type(outcome).__name__}, not an Applied")
        except BaseException as error:
            raise_failure(error, "the estimator", "set_pose", keeps=())
        return outcome

    def belief(self, stamp_s: float | None = None) -> Belief:
        """Return the belief at a stamp.

        Raises
        ------
        RunError
            If the estimator raises.
        """
        if self._last_belief is not None and self._last_belief[0] == stamp_s:
            return self._last_belief[1]
        began_ns = perf_counter_ns()
        try:
            belief = self._estimator.belief(stamp_s)
            if not isinstance(belief, Belief):
                raise TypeError(f"it returned {type(belief).__name__}, not a Belief")
            pose, covariance = belief.pose_map_base, belief.covariance
            if isinstance(covariance, np.ndarray) and covariance.dtype.kind == "c":
                raise TypeError("it returned a Belief with a covariance of complex numbers")
            if pose is not None and max(abs(pose.x), abs(pose.y)) > FARTHEST_M:
                raise ValueError(f"it believes to be at {pose}")
            if self.health or self._told_health or belief.health is not ALL_HEALTHY or not _is_frozen(covariance):
                belief = _frozen(belief, {**self._told_health, **belief.health, **self.health})
        except BaseException as error:
            raise_failure(error, "the estimator", "belief", keeps=())
        self._times.append(perf_counter_ns() - began_ns)
        if stamp_s is not None:
            self._last_belief = stamp_s, belief
        return belief

    def apply(self, localizer: LocalizerPart, estimate: Estimate, frame_s: float) -> Applied:
        """Apply an estimate of a localizer about a frame, and return what became of it.

        Raises
        ------
        ConfigError
            If its motion would count twice.
        LocalizerFailedError
            If the localizer's `health` raises or returns no text.
        RunError
            If the estimator raises.
        """
        name = localizer.name
        if self._use is not None and name not in self._use:
            return _NOT_IN_USE
        if estimate.stamp_s > frame_s + _SLACK_S:
            return Applied("refused", f"about {estimate.stamp_s:.6f} s, but its frame is of {frame_s:.6f} s")
        if _reaches_m(estimate) > FARTHEST_M:
            return Applied("refused", f"{_reaches_m(estimate):.3g} m away: no robot comes so far")
        if isinstance(estimate, Motion) and name not in self._moving:
            self._admit_motion(localizer)
        if isinstance(estimate, Motion) and (other := self._spared.get(name)) is not None:
            return Applied("unused", f"{other!r} gives motion, and both would count twice")
        if isinstance(estimate, Motion) and estimate.information[0, 0] > 0.0:  # a gyro knows nothing of the way
            self._moved_s[name] = estimate.stamp_s
        self._last_belief = None
        began_ns = perf_counter_ns()
        try:
            outcome = self._estimator.apply(name, estimate)
            if not isinstance(outcome, Applied):
                raise TypeError(f"it returned {type(outcome).__name__}, not an Applied")
        except BaseException as error:
            raise_failure(error, "the estimator", f"apply at the {type(estimate).__name__} of {name!r}", keeps=())
        self._times.append(perf_counter_ns() - began_ns)
        self._take_health(localizer)
        return outcome

    def _take_health(self, localizer: LocalizerPart) -> None:
        """Note what a localizer says of itself."""
        try:
            words = localizer.localizer.health()
            if not isinstance(words, str):
                raise TypeError(f"it returned {type(words).__name__}, not words")
        except BaseException as error:
            part = f"localizer {localizer.name!r}"
            raise_failure(error, part, "health", kind=LocalizerFailedError, keeps=StoreFailedError)
        if words:
            self._told_health[localizer.name] = words[:LONGEST_REASON]
        elif self._told_health:
            self._told_health.pop(localizer.name, None)

    def has_motion_beside(self, sensors: Collection[str], since_s: float) -> bool:
        """Return whether a localizer that looks at none of some sensors has told of a way since an instant."""
        return any(
            moved_s >= since_s and part.localizer.looks_at_frames and part.sensors.isdisjoint(sensors)
            for name, moved_s in self._moved_s.items()
            if (part := self._moving.get(name)) is not None
        )

    def switch_off(self, name: str, why: str) -> None:
        """Expect nothing more of a localizer: what was spare beside its motion counts from now on."""
        self._last_belief = None
        self._told_health.pop(name, None)
        self.health[name] = f"switched off: {why}"
        self._moving.pop(name, None)
        self._spared.pop(name, None)
        for spare in [spare for spare, other in self._spared.items() if other == name]:
            del self._spared[spare]
            self._moving.pop(spare, None)  # another may give motion too

    def _admit_motion(self, localizer: LocalizerPart) -> None:
        for other in list(self._moving.values()) if self._use is None else ():
            shared = other.sensors & localizer.sensors
            if (shared or self._estimator.takes_one_motion) and other.name not in self._spared:
                spare = next((one for one in (localizer, other) if one.localizer.motion_is_spare), None)
                if spare is not None:
                    self._spared[spare.name] = other.name if spare is localizer else localizer.name
                    continue
                why = f"of the sensor {min(shared)!r}" if shared else "and the estimator takes it from one"
                raise ConfigError(
                    f"{other.name!r} and {localizer.name!r} both give motion {why}: 10 m would become 20. Say which"
                    f" counts with estimator: {{use: [{other.name}]}}, or choose an estimator that weighs them"
                )
        self._moving[localizer.name] = localizer


def _is_frozen(array: object) -> bool:
    """Return whether nobody can change what is no array, or one whose memory is its own or of bytes."""
    while isinstance(array, np.ndarray):
        if array.flags.writeable:
            return False
        array = array.base
    return True


def _frozen(belief: Belief, health: dict[str, str]) -> Belief:
    """Return a belief with this health that nobody can change: localizers, sinks and the controller share it."""
    covariance = belief.covariance
    if isinstance(covariance, np.ndarray):  # the estimator may go on with it
        covariance = read_only(covariance.copy())
    return replace(belief, covariance=covariance, health=MappingProxyType(health))


def _reaches_m(estimate: Estimate) -> float:
    """Return the largest coordinate of an estimate [m]."""
    if isinstance(estimate, Motion):
        return max(abs(estimate.pose_since_now.x), abs(estimate.pose_since_now.y))
    if isinstance(estimate, Fix):
        return max(abs(estimate.pose_map_base.x), abs(estimate.pose_map_base.y))
    if isinstance(estimate, PathOffset):
        return max(abs(estimate.station_m), abs(estimate.lateral_m))
    return 0.0


def _problem_of(pose: object, covariance: object, stamp_s: object) -> str | None:
    """Return why a pose that somebody tells is none; None: it is one."""
    if not isinstance(pose, Pose2):
        return f"it is {type(pose).__name__}, not a Pose2"
    if stamp_s is not None and not (isinstance(stamp_s, Real) and math.isfinite(stamp_s)):
        return f"its stamp is {stamp_s!r}"
    if covariance is None:
        return None
    try:
        matrix = np.asarray(covariance)
    except (ValueError, TypeError) as error:  # rows of different lengths
        return f"its covariance is no matrix: {error}"
    if matrix.shape != (3, 3) or matrix.dtype.kind not in "fiu":
        return f"its covariance is of shape {matrix.shape} and type {matrix.dtype}, not (3, 3) and real"
    return None
