"""A robot that drives a circle twice, and whose heading drifts: its places are seen again."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.estimates import Belief, Fix, Lost, information_from_sigmas
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer
from trailmark.paths import Keyframe
from trailmark.pipeline.teaching.way_log import WayLog
from trailmark.testing import MemoryMap

STEP_M, N, N_A_ROUND = 0.5, 126, 63
GOOD = information_from_sigmas(0.02, 0.02, math.radians(0.3))
DRIFT_RAD_PER_M = math.radians(0.4)


class Relates(Localizer):
    """Tells places that are the same: what `tell` makes of the truth."""

    relates_keyframes = True

    def __init__(self, truth: Sequence[Pose2], nodes: Sequence[Keyframe], tell: Any, *, by_number: bool) -> None:
        super().__init__(None)
        self.nodes, self.tell, self.asked = nodes, tell, 0
        self._truth, self._by_number = truth, by_number

    def observe(self, frame: Any, belief: Belief) -> Sequence[Any]:
        return ()

    def true(self, number: int) -> Pose2:
        return self._truth[number if self._by_number else round(self.nodes[number].stamp_s / 0.2)]

    def relate(self, known: Mapping[int, Pose2], keyframe: int, guess: Pose2, covariance: Floats) -> Fix | Lost:
        self.asked += 1
        first = min(known, key=lambda one: self.true(one).distance_to(self.true(keyframe)))
        seen = self.true(first).between(self.true(keyframe))
        if math.hypot(seen.x, seen.y) > 2.0:
            return Lost(0.0, "nothing like it")
        pose = known[first] @ seen
        return Fix(0.0, pose, GOOD) if self.tell is None else self.tell(pose, self.asked)


class TwoRounds:
    """Where the robot truly is, and what it makes of that."""

    good = GOOD

    def __init__(self) -> None:
        turn = STEP_M / 5.0
        self.truth = [Pose2(5.0 * math.sin(k * turn), 5.0 - 5.0 * math.cos(k * turn), k * turn) for k in range(N)]

    def log(self, n: int = N, fix_age_m: float = math.inf) -> Sequence[Keyframe]:
        """Return the log of its first places: 126 of two rounds."""
        log, pose, covariance = MemoryMap(), self.truth[0], np.diag([1e-8, 1e-8, 1e-8])
        notes = WayLog(log)
        for k, true in enumerate(self.truth[:n]):
            if k:
                step = self.truth[k - 1].between(true)
                before, pose = pose, pose @ Pose2(1.005 * step.x, step.y, step.theta + DRIFT_RAD_PER_M * STEP_M)
                dx, dy = pose.x - before.x, pose.y - before.y
                carry = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
                covariance = carry @ covariance @ carry.T + np.diag([4e-5, 4e-5, math.radians(0.4) ** 2])
            belief = Belief(0.2 * k, pose, covariance, pose_odom_base=pose, fix_age_m=fix_age_m)
            notes.note(belief, 1.0001 * STEP_M * k)
        return log.keyframes()

    def in_two_goes(self, nodes: Sequence[Keyframe]) -> list[Keyframe]:
        """Return the log of the same way taught in two goes, the stamps of the second from zero again."""
        began_s = nodes[N_A_ROUND].stamp_s
        return [
            node if k < N_A_ROUND else replace(node, stamp_s=node.stamp_s - began_s) for k, node in enumerate(nodes)
        ]

    def relating(self, nodes: Sequence[Keyframe], tell: Any = None, *, by_number: bool = False) -> Relates:
        """Return a localizer that knows the places of a log by their stamps, or whatever their stamps."""
        return Relates(self.truth, nodes, tell, by_number=by_number)

    def worst(self, poses: Sequence[Pose2]) -> float:
        """Return the largest distance to where the robot truly was [m]."""
        return max(a.distance_to(b) for a, b in zip(poses, self.truth[: len(poses)], strict=True))


@pytest.fixture(scope="session")
def rounds() -> TwoRounds:
    return TwoRounds()
