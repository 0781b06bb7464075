"""Constant speed as a localizer: the least that one can assume of a recording without odometry."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from trailmark.estimates import Belief, Estimate, Motion, information_from_covariance
from trailmark.frames import Frame
from trailmark.geometry import Twist2
from trailmark.interfaces import Localizer, Session
from trailmark_baselines.config import ConstantSpeedConfig
from trailmark_baselines.spread import Spread, random_walk, step_covariance

__all__ = ["ConstantSpeed"]


class ConstantSpeed(Localizer):
    """Says that the robot drove on at its speed since the last frame.

    With it, a recording without odometry can be taught and replayed: places then correspond by time, which holds
    where both drives had the same constant speed (Perroni Filho & Ohya 2014, on correspondence by time).
    """

    config: ConstantSpeedConfig
    uses_belief = False
    looks_at_frames = False

    def __init__(self, config: ConstantSpeedConfig) -> None:
        super().__init__(config)
        self._twist = Twist2(config.speed_mps, 0.0, math.radians(config.turn_deg_per_s))
        self._last_s: float | None = None
        self._gaps = 0

    def start(self, session: Session) -> None:
        """Forget the last frame."""
        self._last_s, self._gaps = None, 0

    def counters(self) -> Mapping[str, int]:
        """Return how many gaps were left."""
        return {"gaps": self._gaps}

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return the motion since the last frame, unless that is too long ago."""
        since_s, self._last_s = self._last_s, frame.stamp_s
        if since_s is None:
            return ()
        dt_s = frame.stamp_s - since_s
        if dt_s > self.config.max_gap_s:
            self._gaps += 1
            return ()
        step = self._twist.after(dt_s)
        spread = Spread(
            random_walk((self.config.distance_sigma, dt_s)),
            random_walk((self.config.lateral_sigma, dt_s)),
            random_walk((math.radians(self.config.turn_sigma_deg), dt_s)),
        )
        information = information_from_covariance(step_covariance(step.x, step.y, spread))
        return (Motion(since_s, frame.stamp_s, step, information),)
