"""The filter at one instant: an immutable value, so that it is its own snapshot."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from types import MappingProxyType
from typing import Any, Literal

from trailmark.arrays import Floats
from trailmark.deprecation import deprecated_name
from trailmark.estimation.kalman import diagnosis
from trailmark.estimation.kalman.diagnosis import DetectedFault, FaultDiagnosis, RivalFilter
from trailmark.estimation.kalman.innovation import Innovation
from trailmark.estimation.kalman.lasting_errors import UNAFFECTED, Columns
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.unmeasured import NOWHERE, Sym2
from trailmark.geometry import Pose2, Twist2
from trailmark.values import quick_dataclass

__all__ = [
    "NOTHING",
    "CorroboratingFix",
    "FilterState",
    "Gaussian",
    "MotionCheck",
    "MovedBelief",
    "OdometryState",
    "RejectedMeasurement",
    "Rejections",
    "Verdict",
]

#: No localizer.
NOTHING: Mapping[str, Any] = MappingProxyType({})


def _empty() -> Mapping[str, Any]:
    return NOTHING


@quick_dataclass(frozen=True, slots=True)
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
    seen, used : Innovation or None
        The innovation of one that corrected the belief, as it is and as it was weighted.
    """

    status: Literal["accepted", "gated", "unused"]
    nis: float | None
    dof: int
    reason: str = ""
    seen: Innovation | None = None
    used: Innovation | None = None


@quick_dataclass(frozen=True, slots=True)
class MotionCheck:
    """The test of one localizer's step against those of the others.

    Attributes
    ----------
    source : str
        The localizer.
    nis : float
        Normalised innovation squared of its step.
    dof : int
        Degrees of freedom of the test.
    """

    source: str
    nis: float
    dof: int


@quick_dataclass(frozen=True, slots=True, eq=False)
class RejectedMeasurement:
    """A measurement that failed its test, and the odometry at its stamp.

    Attributes
    ----------
    stamp_s : float
        The instant it is about [s].
    pose_odom_base : Pose2
        Where motion had carried base.
    measurement : Measurement
        The measurement.
    lasting : tuple of 18 float
        How the pose that it contradicted changed with the errors of motion that last.
    """

    stamp_s: float
    pose_odom_base: Pose2
    measurement: Measurement
    lasting: Columns = UNAFFECTED


@quick_dataclass(frozen=True, slots=True, eq=False)
class CorroboratingFix:
    """The last absolute estimate of a localizer that was accepted.

    Attributes
    ----------
    stamp_s : float
        The instant it is about [s].
    directions : (k, 3) float64
        Rows of its Jacobian: the directions of the pose that it measured.
    """

    stamp_s: float
    directions: Floats


@quick_dataclass(frozen=True, slots=True, eq=False)
class Gaussian:
    """Mean and covariance of the state.

    Attributes
    ----------
    x : (n,) float64
        Pose in the map, theta wrapped, and what else the model estimates.
    covariance : (n, n) float64
        Of `x`, were there no errors that last.
    lasting : tuple of 18 float
        How the pose changes with each of these (`lasting_errors`).
    """

    x: Floats
    covariance: Floats
    lasting: Columns


@quick_dataclass(frozen=True, slots=True, eq=False)
class OdometryState:
    """What motion alone says.

    Attributes
    ----------
    pose_odom_base : Pose2
        Where motion alone has carried base.
    travelled_m : float
        Length of that way [m].
    twist : Twist2
        The last velocity.
    gap_s : float
        How long nothing has measured motion [s].
    is_measured : bool
        Whether something measured all of the motion just before.
    has_moved : bool
        Whether any motion was measured.
    unmeasured_s : Sym2
        For how long nobody has measured the way, by direction in odom: neither motion nor an absolute estimate [s].
    measured_mps : float
        The last speed that was measured in all directions [m/s].
    offsets : mapping of str to (float, float, float)
        Base where poses on one map have led it, as seen from where the belief has, by localizer [m, m, rad].
    """

    pose_odom_base: Pose2 = Pose2()
    travelled_m: float = 0.0
    twist: Twist2 = Twist2()
    gap_s: float = 0.0
    is_measured: bool = False
    has_moved: bool = False
    unmeasured_s: Sym2 = NOWHERE
    measured_mps: float = 0.0
    offsets: Mapping[str, tuple[float, float, float]] = field(default_factory=_empty)

    def with_unmeasured(self, unmeasured_s: Sym2) -> OdometryState:
        """Return the same with other times for which nobody has measured the way, as `FilterState.with_diagnosis`."""
        return OdometryState(
            self.pose_odom_base,
            self.travelled_m,
            self.twist,
            self.gap_s,
            self.is_measured,
            self.has_moved,
            unmeasured_s,
            self.measured_mps,
            self.offsets,
        )


@quick_dataclass(frozen=True, slots=True, eq=False)
class MovedBelief:
    """A belief that was given up for another pose, on which the absolute estimates of one localizer agreed.

    Attributes
    ----------
    source : str
        The localizer.
    since_s : float
        The instant of the first of them [s].
    agreed_s : float
        The instant of the last of them that fitted [s].
    shift : Pose2
        ``pose_map_base`` where motion had led base is ``shift @ pose_map_base`` of the belief.
    pose : Pose2
        Where motion had led base then.
    covariance : (3, 3) float64
        Of `pose`; it covers the belief that was given up, too, where that had been moved before.
    motion : str or None
        Whose motion had led base, if they have overruled it.
    lasts_s : float
        The place before is as probable as at first for so long after `since_s`, and less from then on; for no longer
        than half a minute [s].
    """

    source: str
    since_s: float
    agreed_s: float
    shift: Pose2
    pose: Pose2
    covariance: Floats
    motion: str | None = None
    lasts_s: float = math.inf


@quick_dataclass(frozen=True, slots=True, eq=False)
class Rejections:
    """Which absolute estimates failed their test of late, and which passed.

    Attributes
    ----------
    counts : mapping of str to int
        By localizer, how many more were rejected than accepted of late.
    measurements : mapping of str to tuple of RejectedMeasurement
        The rejected ones, by localizer: if they agree among themselves, it may be the belief that is wrong.
    corroborations : mapping of str to CorroboratingFix
        The last accepted one, by localizer.
    n_recoveries : int
        How often the belief was given up for them.
    shares : mapping of str to float
        By localizer, the share of the last ten or so that was rejected.
    moved : MovedBelief or None
        Where motion had led base before the last recovery, until another localizer confirms the new place or the same
        one has agreed with it for long.
    was_confirmed : bool
        Whether any was ever accepted, by this clock or another.
    """

    counts: Mapping[str, int] = field(default_factory=_empty)
    measurements: Mapping[str, tuple[RejectedMeasurement, ...]] = field(default_factory=_empty)
    corroborations: Mapping[str, CorroboratingFix] = field(default_factory=_empty)
    n_recoveries: int = 0
    shares: Mapping[str, float] = field(default_factory=_empty)
    moved: MovedBelief | None = None
    was_confirmed: bool = False


@quick_dataclass(frozen=True, slots=True, eq=False)
class FilterState:
    """All that later estimates depend on. Nothing in it is ever changed in place.

    Attributes
    ----------
    stamp_s : float
        The instant it is about; ``-inf`` before the first estimate [s].
    gaussian : Gaussian or None
        The estimated state; None while the pose is unknown.
    odometry : OdometryState
        What motion alone says.
    fixed_at_m : float
        Way travelled at the last accepted absolute estimate; ``-inf`` before the first [m].
    rejections : Rejections
        On absolute estimates of late.
    diagnosis : FaultDiagnosis
        What the localizers say of each other. While it has rivals, `gaussian` is their mixture.
    left_out : mapping of str to int
        Localizers whose motion was left out just before, and in how many of its motions in a row.
    checks : tuple of MotionCheck
        Tests of the motion just before.
    verdicts : tuple of Verdict
        On the absolute estimates of this very instant.
    """

    stamp_s: float
    gaussian: Gaussian | None
    odometry: OdometryState = OdometryState()
    fixed_at_m: float = -math.inf
    rejections: Rejections = Rejections()
    diagnosis: FaultDiagnosis = FaultDiagnosis()
    left_out: Mapping[str, int] = field(default_factory=_empty)
    checks: tuple[MotionCheck, ...] = ()
    verdicts: tuple[Verdict, ...] = ()

    def with_diagnosis(self, diagnosis: FaultDiagnosis) -> FilterState:
        """Return the same with another diagnosis, in a third of the time of `dataclasses.replace`."""
        return FilterState(
            self.stamp_s,
            self.gaussian,
            self.odometry,
            self.fixed_at_m,
            self.rejections,
            diagnosis,
            self.left_out,
            self.checks,
            self.verdicts,
        )

    def with_checks(self, left_out: Mapping[str, int], checks: tuple[MotionCheck, ...]) -> FilterState:
        """Return the same with other tests of the motion just before, as `with_diagnosis`."""
        return FilterState(
            self.stamp_s,
            self.gaussian,
            self.odometry,
            self.fixed_at_m,
            self.rejections,
            self.diagnosis,
            left_out,
            checks,
            self.verdicts,
        )


def __getattr__(name: str) -> Any:
    renamed = {"Consistency": FaultDiagnosis, "Fault": DetectedFault, "Rival": RivalFilter}
    moved = {one: getattr(diagnosis, one) for one in ("Alternative", "FixOffset", "MotionSum", "Retrial")}
    return deprecated_name(__name__, name, renamed | moved)
