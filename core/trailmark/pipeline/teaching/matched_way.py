"""The taught way as its keyframes tell it, step by step, beside the belief: loops must not contradict it.

Where wheels and laser contradict each other the belief covers both, and allows for loops that are metres off. Each
keyframe laid on those just before it says much more of the way between two rooms that look alike. It only ever
excludes a loop: a wrong match leaves a loop open, and moves nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Fix
from trailmark.geometry import Pose2, rotate_axes
from trailmark.paths import Keyframe
from trailmark.pipeline.teaching.way_graph import carry_covariance, chi_square, odometry_of

__all__ = ["PLAUSIBLE", "SLACK", "MatchedWay", "RelateKeyframe", "sigma_m"]

#: 99.9 % of right relations of three numbers lie within.
PLAUSIBLE = 16.3
#: An error of the poses between two looks that no covariance tells [m, rad].
SLACK = np.diag(np.square([0.03, 0.03, math.radians(0.5)]))
# An error of one match that its information does not tell; those of a chain are independent [m, rad].
_STEP_SLACK = np.diag(np.square([0.01, 0.01, math.radians(0.3)]))
# Longer steps are gaps, whose ends may show different things; a step is laid on the last few so far back [m, m, 1].
_STEP_M, _NEIGHBOURS_M, _N_NEIGHBOURS = 1.5, 2.0, 5
# Standard deviations within which a step is looked for, at least and at most [m, rad].
_LEAST, _MOST = (0.1, math.radians(3.0)), (0.5, math.radians(13.0))

#: Keyframes near a place, the number of another, the guess and its covariance; see `Localizer.relate`.
RelateKeyframe = Callable[[Mapping[int, Pose2], int, Pose2, Floats], Fix | None]


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """From a node to the next: what it was, its covariance in axes of base at the first, whether a match told it."""

    pose: Pose2
    covariance: Floats
    is_told: bool


class MatchedWay:
    """Steps along the way log, each matched when it is first needed.

    Parameters
    ----------
    nodes : sequence of Keyframe
        The way log, at least two.
    sites : mapping of int to (int, Pose2)
        For nodes: the number of a keyframe, and where it lies as seen from the node.
    relate : callable
        Says how a keyframe lies to others; None where it cannot.
    """

    def __init__(
        self, nodes: Sequence[Keyframe], sites: Mapping[int, tuple[int, Pose2]], relate: RelateKeyframe
    ) -> None:
        self._nodes, self._sites, self._relate = nodes, sites, relate
        odometry = odometry_of(nodes)
        self._believed = [
            _Step(Pose2.from_array(measured), np.linalg.inv(information), False)
            for measured, information in zip(odometry.measured, odometry.information, strict=True)
        ]
        self._steps: dict[int, _Step] = {}

    def contradicts(self, first: int, second: int, measured: Pose2, information: Floats) -> bool:
        """Return whether a later node cannot lie so to an earlier one.

        Parameters
        ----------
        first, second : int
            The nodes.
        measured : Pose2
            The second as seen from the first.
        information : (3, 3) float64
            Of its x, y and theta.
        """
        first, second, measured, information = _in_order(first, second, measured, information)
        led_to, covariance = self.between(first, second)
        off = measured.array() - led_to.array()
        return chi_square(off, information, covariance + SLACK) > PLAUSIBLE

    def between(self, first: int, second: int) -> tuple[Pose2, Floats]:
        """Return a later node as seen from an earlier one, and the covariance (3, 3) of its x, y and theta."""
        seen, covariance = Pose2(), np.zeros((3, 3))
        for node in range(first, second):
            step = self._step_from(node)
            covariance = carry_covariance(covariance, step.covariance, seen, step.pose)
            seen = seen @ step.pose
        return seen, covariance

    def _step_from(self, node: int) -> _Step:
        if node not in self._steps:
            self._steps[node] = self._matched(node) or self._believed[node]
        return self._steps[node]

    def _matched(self, node: int) -> _Step | None:
        """Return the step from a node as a match tells it; None where it does not."""
        after, believed = node + 1, self._believed[node]
        if after not in self._sites or not self._is_near(node, after, _STEP_M):
            return None
        before = self._places_before(node)
        if not before:
            return None
        number, offset = self._sites[after]
        fix = self._relate(before, number, believed.pose @ offset, _window(believed.covariance))
        if fix is None:
            return None
        found = fix.pose_map_base @ offset.inverse()
        away = found.array() - believed.pose.array()
        if chi_square(away, fix.information, believed.covariance + SLACK) > PLAUSIBLE:  # one is wrong: none is certain
            return _Step(believed.pose, believed.covariance + np.outer(away, away), False)
        information = np.linalg.solve(np.eye(3) + fix.information @ _STEP_SLACK, fix.information)
        covariance = np.linalg.inv(information + np.linalg.inv(believed.covariance))
        return _Step(found, (covariance + covariance.T) / 2.0, True)

    def _places_before(self, node: int) -> dict[int, Pose2]:
        """Return where the last keyframes up to a node lie, as seen from it."""
        places, place, at = dict[int, Pose2](), Pose2(), node
        while at in self._sites and self._is_near(at, node, _NEIGHBOURS_M) and len(places) < _N_NEIGHBOURS:
            number, offset = self._sites[at]
            places[number] = place @ offset
            step = self._steps.get(at - 1)
            if step is None or not step.is_told:
                break
            place = place @ step.pose.inverse()
            at -= 1
        return places

    def _is_near(self, before: int, now: int, most_m: float) -> bool:
        one, other = self._nodes[before], self._nodes[now]
        return 0.0 <= other.station_m - one.station_m <= most_m and one.stamp_s <= other.stamp_s


def _in_order(first: int, second: int, measured: Pose2, information: Floats) -> tuple[int, int, Pose2, Floats]:
    """Return a relation as seen from the earlier of its nodes."""
    if first <= second:
        return first, second, measured, information
    back = measured.inverse()
    turned = rotate_axes(information, back.theta)
    carry = np.array([[1.0, 0.0, back.y], [0.0, 1.0, -back.x], [0.0, 0.0, 1.0]])
    return second, first, back, carry.T @ turned @ carry


def _window(spread: Floats) -> Floats:
    """Return the covariance to look within: neither too sure of the step nor looking too far."""
    sigmas = np.clip([sigma_m(spread), math.sqrt(spread[2, 2])], _LEAST, _MOST)
    return np.asarray(np.diag(np.square(sigmas[[0, 0, 1]])))


def sigma_m(covariance: Floats) -> float:
    """Return the largest standard deviation of a position [m]."""
    return math.sqrt(max(float(np.linalg.eigvalsh(covariance[:2, :2])[1]), 0.0))
