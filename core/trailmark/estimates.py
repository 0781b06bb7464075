"""What localizers say, what estimators answer, and what is believed.

Every estimate is about ``base``, at the stamp it is about, and all but `Lost` carry a (3, 3)
information matrix (inverse covariance) of their three numbers, in their order and units.
A direction that was not measured has no information; its rows need not be axes.

Information and covariances are of these numbers themselves, the chart (x, y, theta): an error is the plain difference
"stated minus true", theta wrapped, with x and y along the axes in which the pose is given (the map's for a `Fix` and a
`Belief`, those of base at ``since_s`` for a `Motion`). A perturbation in the moving body's axes (right-invariant,
``pose @ exp(d)``, as manif, GTSAM and ROS's twists have it) is turned by theta first: ``R d``.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, NoReturn

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import ShapeError
from trailmark.frames.payloads import read_only
from trailmark.geometry import Pose2, Twist2

if TYPE_CHECKING:
    from trailmark.ranges import range_fix

__all__ = [
    "Applied",
    "Belief",
    "Estimate",
    "EstimateRecord",
    "Fix",
    "Lost",
    "Motion",
    "PathOffset",
    "information_along",
    "information_from_covariance",
    "information_from_sigmas",
    "range_fix",
]

# What `numpy.linalg` calls, behind checks of microseconds; not numpy's promise, so that both may be missing.
_lapack: Any = getattr(np.linalg, "_umath_linalg", None)
_HAS_LAPACK = hasattr(_lapack, "cholesky_lo") and hasattr(_lapack, "inv")

# Pivots of a covariance that is plainly positive: this part of their diagonal elements, which are no rounding of zero.
_PLAIN = 1e-9
_TINY = 1e-100

_NO_DETAILS: Mapping[str, float] = MappingProxyType({})


class _NothingSaid(dict[str, str]):
    """The health of sources of which nothing is to be said: one for all beliefs, so nothing can be put into it."""

    __slots__ = ()

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError("the health of a belief cannot be written to")

    __setitem__ = __ior__ = update = setdefault = _refuse

    def __reduce__(self) -> str:
        return "ALL_HEALTHY"  # pickled and copied as itself


ALL_HEALTHY: Mapping[str, str] = _NothingSaid()


def _no_details() -> Mapping[str, float]:
    return _NO_DETAILS


def information_from_sigmas(*sigmas: float) -> Floats:
    """Return the information of independent standard deviations; ``inf`` says "not measured".

    Raises
    ------
    ValueError
        If a sigma is not positive.
    """
    values = [float(sigma) for sigma in sigmas]
    if not all(value > 0.0 for value in values):  # also refuses NaN
        raise ValueError(f"standard deviations must be positive, not {sigmas}")
    information = np.zeros((len(values), len(values)))
    for i, value in enumerate(values):
        variance = value * value
        information[i, i] = 1.0 / variance if variance else math.inf
    return information


def information_from_covariance(covariance: npt.ArrayLike) -> Floats:
    """Return the inverse of a covariance matrix, symmetric to the last bit.

    Raises
    ------
    ValueError
        If it is not symmetric and positive definite.
    """
    if type(covariance) is not np.ndarray or covariance.dtype != np.float64:
        if np.iscomplexobj(covariance):
            raise ShapeError("a covariance is of real numbers, not of complex ones")
        covariance = np.asarray(covariance, dtype=np.float64)
    matrix = covariance
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise ShapeError(f"a covariance is square, not {matrix.shape}")
    rows = matrix.tolist()
    if len(rows) == 3 and _HAS_LAPACK and _is_plainly_positive(*rows):  # then there are no errors to ask for
        factor = _lapack.inv(_lapack.cholesky_lo(matrix, signature="d->d"), signature="d->d")
        return np.asarray(factor.T @ factor)
    if rows != matrix.T.tolist():  # to the last bit: the mean of both would be the matrix itself
        if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=1e-12 * max(1e-300, float(np.abs(matrix).max()))):
            raise ValueError("the covariance is not symmetric")
        matrix = (matrix + matrix.T) / 2.0
    try:
        factor = np.linalg.inv(np.linalg.cholesky(matrix))
    except np.linalg.LinAlgError:
        raise ValueError("the covariance is not positive definite") from None
    return np.asarray(factor.T @ factor)


def _is_plainly_positive(x: list[float], y: list[float], t: list[float]) -> bool:
    """Return whether the rows are of a symmetric matrix whose Cholesky factor is far from not being there."""
    (xx, xy, xt), (yx, yy, yt), (tx, ty, tt) = x, y, t
    if not (xy == yx and xt == tx and yt == ty and math.inf > xx > _TINY and yy > _TINY and tt > _TINY):
        return False
    d2 = yy - xy / xx * xy
    if not math.inf > d2 > _PLAIN * yy:
        return False
    rest = yt - xt / xx * xy
    return _PLAIN * tt < tt - xt / xx * xt - rest / d2 * rest < math.inf


def information_along(direction: npt.ArrayLike, sigma: float) -> Floats:
    """Return the rank-one information of a single measured number.

    Parameters
    ----------
    direction : (3,) float
        How the measured number changes with the three numbers of the estimate (its Jacobian row).
    sigma : float
        Standard deviation of the measured number, in its own unit.
    """
    row = np.asarray(direction, dtype=np.float64)
    if not sigma > 0:
        raise ValueError(f"a standard deviation must be positive, not {sigma}")
    return np.outer(row, row) / (sigma * sigma)


def _frozen_information(information: npt.ArrayLike) -> Floats:
    if type(information) is np.ndarray and information.dtype == np.float64 and information.shape == (3, 3):
        return read_only(information) if information.flags.writeable else information
    if np.iscomplexobj(information):
        raise ShapeError("information is of real numbers, not of complex ones")
    matrix = np.asarray(information, dtype=np.float64)
    if matrix.shape != (3, 3):
        raise ShapeError(f"information must have shape (3, 3), not {matrix.shape}")
    return read_only(matrix)


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Relative motion of base between two stamps.

    It begins where the localizer's last motion ended, or leaves a gap that the estimator bridges.

    Attributes
    ----------
    since_s, stamp_s : float
        From when to when [s].
    pose_since_now : Pose2
        Base at `stamp_s` as seen from base at `since_s`.
    information : (3, 3) float64
        Of (x, y, theta) of `pose_since_now`, x and y along the axes of base at `since_s`
        [1/m^2, 1/m^2, 1/rad^2 on the diagonal].
    details : mapping of str to float
        Further numbers of the method, recorded beside the estimate.
    is_matched : bool
        Whether both ends are poses on one map, as of scans matched to the same walls, and the beginning is the end of
        the motion before: the error of that match is in both, with opposite signs, and cancels. Leave it False where
        the ends are matched to different things, as to the keyframes of an ICP. It is not recorded.
    is_guess : bool
        Whether it was not measured, but covers what may have been driven, as behind a gap of which a pose may miss the
        way. An estimator that weighs motions leaves it aside where another one measures the whole way, and believes
        it as it is stated, whatever its config says of this localizer's sigmas. It is not recorded.
    """

    since_s: float
    stamp_s: float
    pose_since_now: Pose2
    information: Floats
    details: Mapping[str, float] = field(default_factory=_no_details, repr=False)
    is_matched: bool = field(default=False, repr=False)
    is_guess: bool = field(default=False, repr=False)

    def __post_init__(self) -> None:
        if not self.stamp_s > self.since_s:
            raise ShapeError(f"a motion must end after it begins: since {self.since_s} s to {self.stamp_s} s")
        object.__setattr__(self, "information", _frozen_information(self.information))


@dataclass(frozen=True, slots=True, eq=False)
class Fix:
    """Absolute pose of base in the map.

    Attributes
    ----------
    stamp_s : float
        The instant it is about [s].
    pose_map_base : Pose2
        Base in the map.
    information : (3, 3) float64
        Of (x, y, theta) of `pose_map_base`, in map axes: of the whole error, whatever it has in common with others.
    details : mapping of str to float
        Further numbers of the method, recorded beside the estimate.
    correlation_s : float or None
        Time in which the correlation with the error of the fixes before falls to 1/e, as that of a first-order
        Gauss-Markov process; 0 says that each fix errs anew, None that nobody knows [s].
    """

    stamp_s: float
    pose_map_base: Pose2
    information: Floats
    details: Mapping[str, float] = field(default_factory=_no_details, repr=False)
    correlation_s: float | None = None

    def __post_init__(self) -> None:
        if self.correlation_s is not None and not 0.0 <= self.correlation_s < math.inf:  # also refuses NaN
            raise ShapeError(f"a correlation time is a finite number of seconds, not {self.correlation_s}")
        object.__setattr__(self, "information", _frozen_information(self.information))


@dataclass(frozen=True, slots=True, eq=False)
class PathOffset:
    """A fix in path coordinates; the taught sense also when the path is driven backwards.

    Attributes
    ----------
    stamp_s : float
        The instant it is about [s].
    station_m : float
        Way along the path [m].
    lateral_m : float
        Offset to the left of the path [m].
    heading_rad : float
        Turn from the taught heading, counter-clockwise [rad].
    information : (3, 3) float64
        Of (station, lateral, heading).
    details : mapping of str to float
        Further numbers of the method, recorded beside the estimate.
    """

    stamp_s: float
    station_m: float
    lateral_m: float
    heading_rad: float
    information: Floats
    details: Mapping[str, float] = field(default_factory=_no_details, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "information", _frozen_information(self.information))


@dataclass(frozen=True, slots=True)
class Lost:
    """The localizer looked and cannot say. (An empty answer means that it did not look.)

    Attributes
    ----------
    stamp_s : float
        The instant it looked at [s].
    reason : str
        Why, in a few words.
    details : mapping of str to float
        Further numbers of the method, recorded beside the estimate.
    """

    stamp_s: float
    reason: str
    details: Mapping[str, float] = field(default_factory=_no_details, repr=False)


Estimate = Motion | Fix | PathOffset | Lost


@dataclass(frozen=True, slots=True)
class Applied:
    """What an estimator did with an estimate; every estimate gets one, and it is recorded.

    Attributes
    ----------
    status : str
        ``accepted``; ``gated`` (contradicts the belief); ``late`` (older than the history); ``refused``
        (malformed: NaN, negative information, a stamp that cannot be); ``unused`` (the estimator does not
        use this localizer, or the estimate is `Lost`).
    reason : str
        Why, when not accepted.
    nis : float or None
        Normalised innovation squared, where the estimator computes one.
    dof : int or None
        Rank of the measurement that `nis` is to be compared with.
    """

    status: Literal["accepted", "gated", "late", "refused", "unused"]
    reason: str = ""
    nis: float | None = None
    dof: int | None = None


@dataclass(frozen=True, slots=True)
class EstimateRecord:
    """An estimate, and what became of it.

    Attributes
    ----------
    arrived_s : float
        When it was applied; later than its frame for a localizer that works beside the run [s].
    source : str
        Name of the localizer.
    estimate : Estimate
        What the localizer said.
    outcome : Applied
        What the estimator answered.
    """

    arrived_s: float
    source: str
    estimate: Estimate
    outcome: Applied

    @property
    def applied(self) -> Applied:
        """The old name of `outcome`; it goes with version 0.3."""
        warnings.warn("EstimateRecord.applied is called outcome now", DeprecationWarning, stacklevel=2)
        return self.outcome


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """The estimator's pose of the robot, with covariance, twist and ages.

    Attributes
    ----------
    stamp_s : float
        The instant it is about [s].
    pose_map_base : Pose2 or None
        Base in the map, None while unknown.
    covariance : (3, 3) float64 or None
        Of (x, y, theta) of `pose_map_base`, in map axes; None where unknown or not estimated.
    pose_odom_base : Pose2
        Base where motion alone has carried it; drifts, never jumps.
    twist : Twist2
        Velocity in base axes.
    travelled_m : float
        Length of the way driven, from motion alone [m].
    on_path : PathOffset or None
        The same belief in path coordinates; None without a path or a pose.
    fix_age_m : float
        Way driven since the last accepted absolute estimate; ``inf`` before the first [m].
    motion_age_s : float
        Time since the last accepted `Motion`; ``inf`` before the first [s].
    health : mapping of str to str
        What is wrong with localizers, by name, as the estimator (``"silent for 1.2 s"``), they themselves
        (`Localizer.health`) or the run say; empty where nothing is.
    """

    stamp_s: float
    pose_map_base: Pose2 | None = None
    covariance: Floats | None = None
    pose_odom_base: Pose2 = Pose2()
    twist: Twist2 = Twist2()
    travelled_m: float = 0.0
    on_path: PathOffset | None = None
    fix_age_m: float = float("inf")
    motion_age_s: float = float("inf")
    health: Mapping[str, str] = field(default_factory=lambda: ALL_HEALTHY, repr=False)


def __getattr__(name: str) -> Any:
    if name != "range_fix":  # every import asks for __path__
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from trailmark.ranges import range_fix  # it stands above: it makes estimates of beliefs

    return range_fix
