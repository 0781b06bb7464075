"""The filter at one instant: a value, so that it is its own snapshot."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from trailmark.estimation.kalman.measurements import Measurement
from trailmark.geometry import Pose2, Twist2

__all__ = ["FilterState", "Suspect", "Verdict"]

Array = npt.NDArray[np.float64]

_NONE: Mapping[str, Any] = MappingProxyType({})


def _none() -> Mapping[str, Any]:
    return _NONE


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of one absolute estimate.

    Attributes
    ----------
    status : {"accepted", "gated", "unused"}
        As in `Applied`.
    nis : float or None
        Normalised innovation squared, before weighting.
    dof : int
        Rank of the measurement.
    reason : str
        Why it was not accepted, or what had to be done to accept it.
    """

    status: Literal["accepted", "gated", "unused"]
    nis: float | None
    dof: int
    reason: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Suspect:
    """A measurement that was rejected, and where odometry stood.

    Attributes
    ----------
    stamp_s : float
        The instant it is about [s].
    odom : Pose2
        Where motion had carried base.
    measurement : Measurement
        What was said.
    """

    stamp_s: float
    odom: Pose2
    measurement: Measurement


@dataclass(frozen=True, slots=True, eq=False)
class FilterState:
    """All that later estimates depend on. Nothing in it is ever changed in place.

    Attributes
    ----------
    stamp_s : float
        The instant it is about; ``-inf`` before the first estimate [s].
    x : (n,) float64 or None
        Pose in the map, theta wrapped, and what else the model estimates; None while the pose is unknown.
    covariance : (n, n) float64 or None
        Of `x`.
    twist : Twist2
        The last velocity.
    gap_s : float
        How long nothing has measured motion [s].
    is_measured : bool
        Whether something measured all of the motion just before.
    has_moved : bool
        Whether any motion was measured.
    odom : Pose2
        Where motion alone has carried base.
    travelled_m : float
        Length of that way [m].
    fixed_at_m : float
        `travelled_m` at the last accepted absolute estimate; ``-inf`` before the first [m].
    rejected : mapping of str to int
        By localizer, how many more were rejected than accepted of late.
    suspects : mapping of str to tuple of Suspect
        What was rejected of late, by localizer: if they agree among themselves, it may be the belief that is wrong.
    supports : mapping of str to (float, ndarray)
        When each localizer was accepted last, and the directions it measured.
    n_recoveries : int
        How often the belief was doubted.
    left_out : mapping of str to int
        Localizers whose motion was left out just before, and in how many pieces in a row.
    checks : tuple of (str, float, int)
        Of the motion just before: localizer, NIS of its step against the others, and degrees of freedom.
    verdicts : tuple of Verdict
        On the absolute estimates of this very instant.
    """

    stamp_s: float
    x: Array | None
    covariance: Array | None
    twist: Twist2 = Twist2()
    gap_s: float = 0.0
    is_measured: bool = False
    has_moved: bool = False
    odom: Pose2 = Pose2()
    travelled_m: float = 0.0
    fixed_at_m: float = -math.inf
    rejected: Mapping[str, int] = field(default_factory=_none)
    supports: Mapping[str, tuple[float, Array]] = field(default_factory=_none)
    suspects: Mapping[str, tuple[Suspect, ...]] = field(default_factory=_none)
    n_recoveries: int = 0
    left_out: Mapping[str, int] = field(default_factory=_none)
    checks: tuple[tuple[str, float, int], ...] = ()
    verdicts: tuple[Verdict, ...] = ()
