"""How fast a belief allows a robot to drive: slower while it is doubtful, and not at all beyond the limits."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.estimates import Belief
from trailmark_controllers.tracking_config import TrackingConfig

__all__ = ["Caution", "caution_of"]

#: Slower than this share of its speed a robot does not go before it stops: it has to get somewhere to be found again.
_SLOWEST = 0.2


@dataclass(frozen=True, slots=True)
class Caution:
    """What a belief allows.

    Attributes
    ----------
    share : float
        Of the speed that the path allows, 0 to 1.
    reason : str
        Why the robot must stand; empty while it may drive.
    """

    share: float = 1.0
    reason: str = ""


def caution_of(belief: Belief, way_without_fix_m: float, config: TrackingConfig) -> Caution:
    """Return how fast a robot may drive by a belief.

    Parameters
    ----------
    belief : Belief
        The belief; one without a pose allows nothing.
    way_without_fix_m : float
        Way since the last accepted fix; before the first, since the start [m].
    config : TrackingConfig
        The limits.
    """
    if belief.pose_map_base is None:
        return Caution(0.0, "the pose is not known yet")
    shares = [1.0]
    if config.max_fix_age_m is not None:
        if way_without_fix_m > config.max_fix_age_m:
            return Caution(0.0, f"lost: {way_without_fix_m:.2f} m without a fix")
        shares.append(_rest(way_without_fix_m, config.max_fix_age_m / 2.0, config.max_fix_age_m))
    if config.max_motion_age_s is not None and math.isfinite(belief.motion_age_s):
        if belief.motion_age_s > config.max_motion_age_s:
            return Caution(0.0, f"lost: no motion for {belief.motion_age_s:.2f} s")
        shares.append(_rest(belief.motion_age_s, config.max_motion_age_s / 2.0, config.max_motion_age_s))
    if belief.covariance is not None:
        sigma_m = math.sqrt(max(0.0, float(np.linalg.eigvalsh(belief.covariance[:2, :2])[-1])))
        if sigma_m > config.max_sigma_m:
            return Caution(0.0, f"lost: the position is known to {sigma_m:.2f} m only")
        shares.append(_rest(sigma_m, config.slow_sigma_m, config.max_sigma_m))
    return Caution(max(_SLOWEST, min(shares)))


def _rest(value: float, slow: float, most: float) -> float:
    """Return 1 up to `slow` and evenly less from there, 0 at `most`."""
    return 1.0 if value <= slow else (most - value) / (most - slow)
