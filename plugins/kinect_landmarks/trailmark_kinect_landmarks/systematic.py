"""What more landmarks and more pictures do not average out: depth on the wrong pixel, the lens, the stamps.

Noise of pixels and depths is the business of the alignment. What is here is the same for all landmarks of a picture and
for all pictures, so it grows with the way itself, not with its square root.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Pose2
from trailmark.systematic import motions_in_stretch
from trailmark_kinect_landmarks.registration import State

__all__ = ["Rates", "TravelledWay", "depth_share", "motion_systematic", "systematic_covariance"]

#: Share of the way by which depth may be wrong, by what is known of its registration. Unknown: a calibration of another
#: lens is 10 % off. As given: what edges that lie within 3 px leave open.
_DEPTH_SHARE: Mapping[State, float] = {"unknown": 0.06, "as given": 0.004, "measured": 0.01}
#: Share of a turn by which focal length and distortion are wrong, for a camera with a usual calibration.
_LENS_SHARE = 0.007
#: Of what a wrong depth does to the way, a turn shows so much: what is wrong left and right of the axis is opposed.
_OPPOSED = 0.15
#: Colour and depth are shuttered apart, and the stamp is that of one of them [s].
_STAMP_SIGMA_S = 0.007


@dataclass(frozen=True, slots=True)
class TravelledWay:
    """Way and turn since landmarks were remembered, over which systematic errors grow.

    Attributes
    ----------
    way_m, turn_rad : float
        Way and turn from the start, along the poses at which the landmarks in sight were remembered [m, rad].
    depth_m : float
        Mean distance of the landmarks [m].
    """

    way_m: float = 0.0
    turn_rad: float = 0.0
    depth_m: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Rates:
    """How fast the camera moves.

    Attributes
    ----------
    velocity_mps : (2,) float64
        In the axes of the covariance [m/s].
    turn_radps, spin_radps : float
        About the vertical axis, and in all [rad/s].
    """

    velocity_mps: Floats
    turn_radps: float
    spin_radps: float


def depth_share(state: State) -> float:
    """Return the share of the way by which depth may be wrong, by what is known of its registration."""
    return _DEPTH_SHARE[state]


def systematic_covariance(share: float, drift: TravelledWay, rates: Rates | None) -> Floats:
    """Return the covariance (3, 3) of x, y and heading that all landmarks share.

    Parameters
    ----------
    share : float
        Share of the way by which depth may be wrong.
    drift : TravelledWay
        Way and turn on which errors of depth and lens grow.
    rates : Rates, optional
        How fast the camera moves, by which errors of the stamps become errors of the pose.
    """
    of_turn = _LENS_SHARE + _OPPOSED * share
    position_m = share * drift.way_m + of_turn * drift.turn_rad * drift.depth_m
    heading_rad = of_turn * drift.turn_rad
    covariance = np.diag([position_m**2, position_m**2, heading_rad**2])
    if rates is not None:
        covariance[:2, :2] += np.outer(rates.velocity_mps, rates.velocity_mps) * _STAMP_SIGMA_S**2
        covariance[:2, :2] += np.eye(2) * (rates.spin_radps * drift.depth_m * _STAMP_SIGMA_S) ** 2
        covariance[2, 2] += (rates.turn_radps * _STAMP_SIGMA_S) ** 2
    return np.asarray(covariance)


def motion_systematic(share: float, step: Pose2, dt_s: float, depth_m: float) -> Floats:
    """Return the covariance (3, 3) that a single motion needs so that a second and a metre of them are honest.

    It is that of the motion, raised as `trailmark.systematic.motions_in_stretch` says.

    Parameters
    ----------
    share : float
        Systematic error of depth, as a share of it.
    step : Pose2
        The motion.
    dt_s : float
        Its duration [s].
    depth_m : float
        Typical depth of the landmarks [m].

    Returns
    -------
    (3, 3) float64
        Covariance of (x, y, theta) to be added.
    """
    way_m = math.hypot(step.x, step.y)
    return motions_in_stretch(way_m, dt_s) * systematic_covariance(
        share, TravelledWay(way_m, abs(step.theta), depth_m), None
    )
