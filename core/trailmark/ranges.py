"""Distances to beacons as fixes; `trailmark.estimates` gives `range_fix`, too."""

from __future__ import annotations

import math

import numpy as np

from trailmark.estimates import Belief, Fix, Lost, information_along
from trailmark.geometry import Pose2

__all__ = ["range_fix"]


def range_fix(
    belief: Belief,
    beacon: tuple[float, float],
    range_m: float,
    sigma_m: float,
    *,
    antenna_base: tuple[float, float] = (0.0, 0.0),
) -> Fix | Lost:
    """Return a measured distance to a beacon as a fix: information along the line to the beacon, none across it.

    The circle about the beacon is replaced by its tangent where the belief is. What the tangent misses is of second
    order and is accounted for: across the line the belief spreads with variance v, so the range is expected to be
    ``v / 2r`` longer than that of the believed pose, and its variance ``v^2 / 2r^2`` larger (Bar-Shalom et al. 2001,
    Sec. 10.3, the second-order extended Kalman filter; turns of the antenna about base to first order).

    Parameters
    ----------
    belief : Belief
        At the stamp of the range.
    beacon : (float, float)
        Its place in the map [m].
    range_m, sigma_m : float
        The distance in the plane and its standard deviation [m].
    antenna_base : (float, float)
        Where on base the range is measured from [m].

    Returns
    -------
    Fix or Lost
        A fix from which the range is as expected. `Lost` while no pose is believed, and next to the beacon, where
        its direction is a guess.

    Raises
    ------
    ValueError
        If the range is negative or not finite, or its standard deviation is not positive.
    """
    if not (math.isfinite(range_m) and range_m >= 0.0 and math.isfinite(sigma_m)):
        raise ValueError(f"a range must be finite and not negative, not {range_m} m (sigma {sigma_m} m)")
    pose = belief.pose_map_base
    if pose is None:
        return Lost(belief.stamp_s, "one range says one number of three, and nothing is believed yet")
    antenna = pose @ np.array(antenna_base)
    dx, dy = float(antenna[0]) - beacon[0], float(antenna[1]) - beacon[1]
    expected_m = math.hypot(dx, dy)
    covariance = np.zeros((3, 3)) if belief.covariance is None else belief.covariance
    if expected_m < 1e-9:
        return Lost(belief.stamp_s, "on top of the beacon")
    cos, sin = dx / expected_m, dy / expected_m
    lever_x, lever_y = pose.y - float(antenna[1]), float(antenna[0]) - pose.x  # the antenna's way for a turn of base
    along = np.array([cos, sin, cos * lever_x + sin * lever_y])
    across = np.array([-sin, cos, cos * lever_y - sin * lever_x])
    spread_m2 = float(across @ covariance @ across)
    if 2.0 * math.sqrt(spread_m2) > expected_m:
        return Lost(belief.stamp_s, f"the beacon is {expected_m:.2g} m away, its direction is a guess")
    miss_m = range_m - expected_m - spread_m2 / (2.0 * expected_m)
    sigma_m = math.sqrt(sigma_m * sigma_m + (spread_m2 / expected_m) ** 2 / 2.0) if sigma_m > 0.0 else sigma_m
    there = Pose2(pose.x + miss_m * cos, pose.y + miss_m * sin, pose.theta)
    return Fix(belief.stamp_s, there, information_along(along, sigma_m))
