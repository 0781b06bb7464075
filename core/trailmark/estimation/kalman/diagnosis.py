"""What the localizers say of each other: faults, rival hypotheses, trials and places that are not decided."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.innovation import Innovation
from trailmark.estimation.kalman.lasting_errors import NO_ERRORS, LastingVariances
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.moving_offset import MovingOffset
from trailmark.estimation.kalman.parting import NOT_COMPARED, Parting
from trailmark.frames.payloads import read_only
from trailmark.geometry import Pose2
from trailmark.values import new_tuple, quick_dataclass

if TYPE_CHECKING:
    from trailmark.estimation.kalman.state import FilterState, RejectedMeasurement
    from trailmark.estimation.kalman.witnesses import Testimony

__all__ = [
    "Alternative",
    "DetectedFault",
    "FaultDiagnosis",
    "FixOffset",
    "LastingDoubt",
    "MotionSum",
    "OverruledMotion",
    "RepeatedPose",
    "Retrial",
    "RivalFilter",
]

_EMPTY: Mapping[str, Any] = MappingProxyType({})

# A delay is told where it explains more than a constant offset does by so much, and is so many sigmas.
_CLEARLY, _SURE = 3.0, 5.0


def _empty() -> Mapping[str, Any]:
    return _EMPTY


class MotionSum(NamedTuple):
    """The steps of one localizer, added up in odom axes, and their variances.

    Attributes
    ----------
    x, y, turn : float
        Sums of the steps [m, m, rad].
    position_m2, turn_rad2 : float
        Sums of the variances, of the worse axis of the position and of the turn, of the steps that measured them.
        Between two instants ``inf`` where a step did not: see `motion_since`.
    covered_s : float
        Time that the steps cover [s].
    open_ways, open_turns : int
        How many steps did not measure the position, and the turn. Their variances are not in the sums: beside one
        that is large without bounds, those of all others are lost in the last digit.
    """

    x: float = 0.0
    y: float = 0.0
    turn: float = 0.0
    position_m2: float = 0.0
    turn_rad2: float = 0.0
    covered_s: float = 0.0
    open_ways: int = 0
    open_turns: int = 0


@quick_dataclass(frozen=True, slots=True)
class DetectedFault:
    """Why the motion of a localizer is not believed.

    Attributes
    ----------
    since_s : float
        When it was found [s].
    reason : str
        In words.
    is_outvoted : bool
        Whether two others at least, which agree, are against it.
    n_agreed : int
        How many of its absolute estimates in a row have agreed with the belief since.
    shows_in_s : float
        Over how short a window its motion was seen to disagree with others: a shorter one acquits nobody [s].
    is_rough : bool
        Whether its motion is still the best there is: by a share of the way and a yaw rate wrong, but no invention.
    is_drawn : bool
        Whether the ways between its absolute estimates are not those of motion; else they are off by a constant.
    agreed_since_s : float
        When the first of `n_agreed` came [s].
    heard : tuple of RejectedMeasurement
        Of the whole poses of one that is drawn away, those of late (`ways_of_fixes`).
    contradicted_by : frozenset of str
        Localizers whose absolute estimates outvote its own.
    late : (float, float) or None
        By how much its absolute estimates are late, and the standard deviation of that, where a delay explains them
        clearly better than a constant offset [s].
    """

    since_s: float
    reason: str
    is_outvoted: bool = True
    n_agreed: int = 0
    shows_in_s: float = 0.0
    is_rough: bool = False
    is_drawn: bool = False
    agreed_since_s: float = math.inf
    heard: tuple[RejectedMeasurement, ...] = ()
    contradicted_by: frozenset[str] = frozenset()
    late: tuple[float, float] | None = None


class FixOffset(NamedTuple):
    """By how much the absolute estimates of one localizer are off: by a constant, late by one, or by ever more.

    Attributes
    ----------
    mean : (k,) float64
        If they are off by a constant, in standard deviations of the estimates.
    n : int
        Of how many this is the mean; no more than the last few count.
    log_constant : float
        Log likelihood of all of them, if they are.
    late_s, variance_s2 : float
        If they are late: by how much, and its variance [s, s^2].
    log_late : float
        Log likelihood of all of them, if they are.
    moving : MovingOffset or None
        If they are drawn away; None where that is no explanation.
    """

    mean: Floats
    n: int = 0
    log_constant: float = 0.0
    late_s: float = 0.0
    variance_s2: float = 0.04
    log_late: float = 0.0
    moving: MovingOffset | None = None

    @property
    def log(self) -> float:
        """Log likelihood by what explains them best."""
        logs = self.log_constant, self.log_late
        return max(logs) if self.moving is None else max(*logs, self.moving.log)

    @property
    def is_drawn(self) -> bool:
        """Whether that they are drawn away explains them best."""
        return self.moving is not None and self.moving.log > max(self.log_constant, self.log_late)

    @property
    def late(self) -> tuple[float, float] | None:
        """By how much they are late, and its standard deviation, where that explains them best; else None [s].

        On an even and straight way a delay and a constant are the same, and nothing is told.
        """
        sigma_s, others = math.sqrt(self.variance_s2), self.log_constant + _CLEARLY
        if self.moving is not None:
            others = max(others, self.moving.log)
        return (self.late_s, sigma_s) if self.log_late > others and self.late_s > _SURE * sigma_s else None


@quick_dataclass(frozen=True, slots=True, eq=False)
class RivalFilter:
    """One hypothesis of who is right: a filter of its own.

    Attributes
    ----------
    state : FilterState
        The filter that uses neither the motion of some localizers, its `faults`, nor the absolute estimates of others,
        its `absolute_faults`.
    log_weight : float
        Log of its probability, to a constant.
    n_measurements : int
        Absolute estimates that have had a say.
    is_implausible : bool
        Whether it says that a moving robot stood still at once, or changed its speed faster than robots do.
    offsets : mapping of str to FixOffset
        Of the absolute estimates that it does not believe, by localizer.
    begun : FilterState or None
        Where the question begins, since which the motions that it believes are compared.
    log_votes : float
        What these comparisons say, to a constant; part of `log_weight`.
    heard : mapping of str to Testimony
        What absolute estimates say, by localizer.
    log_alone : float
        How much of that does not count, as one localizer says it alone (`witnesses`); part of `log_weight`.
    """

    state: FilterState
    log_weight: float
    n_measurements: int = 0
    is_implausible: bool = False
    offsets: Mapping[str, FixOffset] = field(default_factory=_empty)
    begun: FilterState | None = None
    log_votes: float = 0.0
    heard: Mapping[str, Testimony] = field(default_factory=_empty)
    log_alone: float = 0.0


class Retrial(NamedTuple):
    """A filter that believes a motion again which the belief does not.

    Attributes
    ----------
    begun : FilterState
        Where it began.
    state : FilterState
        Where it is.
    nis, dof : float, int
        Of its measurements since, added up.
    log_odds : float
        How much more probable they are with the motion than without.
    """

    begun: FilterState
    state: FilterState
    nis: float = 0.0
    dof: int = 0
    log_odds: float = 0.0


class Alternative(NamedTuple):
    """A place where base may be instead of where it is believed, as seen in the map.

    Attributes
    ----------
    shift : Pose2
        ``pose_map_base`` if this is true, is ``shift @ pose_map_base`` of the belief; the belief itself is one of them.
    log_weight : float
        Log of its probability, to a constant.
    n_measurements : int
        Absolute estimates that have had a say.
    """

    shift: Pose2
    log_weight: float
    n_measurements: int


class LastingDoubt(NamedTuple):
    """How fast a motion parts from others by more than its noise, and less than honest calibrations may.

    Attributes
    ----------
    apart_mps, apart_radps : float
        In way and turn [m/s, rad/s].
    since_s : float
        When that was seen first [s].
    """

    apart_mps: float
    apart_radps: float
    since_s: float

    def __str__(self) -> str:
        apart = f"{self.apart_mps:.3f} m/s, {math.degrees(self.apart_radps):.2f} deg/s"
        return f"its motion parts from that of others by {apart}: it is believed so much less"


class RepeatedPose(NamedTuple):
    """What the last absolute estimate of a localizer said, and the first of those in a row that say the same.

    Attributes
    ----------
    said : tuple of float
        What it measured.
    since_s : float
        When it was first said, or base was last at rest [s].
    pose_odom_base, pose : Pose2
        Where motion had carried base then, and where base was believed to be, in the map.
    sums : mapping of str to MotionSum
        The motions until then, by localizer.
    is_frozen : bool
        Whether base has moved since by more than it and motion can explain.
    """

    said: tuple[float, ...]
    since_s: float
    pose_odom_base: Pose2
    pose: Pose2
    sums: Mapping[str, MotionSum]
    is_frozen: bool = False


class OverruledMotion(NamedTuple):
    """Where a motion leads that the absolute estimates of one localizer have overruled, and nobody else.

    Attributes
    ----------
    source, fixes : str
        Whose motion, and whose absolute estimates.
    since_s : float
        Where the question began that they have decided [s].
    begun : tuple of (Pose2, float64 (3, 3), MotionSum)
        From where it leads, the covariance of that, and the motion until then.
    pose : Pose2
        Where the motion has led base, in the map.
    sums : MotionSum
        The motion until then.
    odom_rad : float
        The heading of odometry then.
    """

    source: str
    fixes: str
    since_s: float
    begun: tuple[Pose2, Floats, MotionSum]
    pose: Pose2
    sums: MotionSum
    odom_rad: float


class FaultDiagnosis(NamedTuple):
    """What the localizers say of each other.

    Attributes
    ----------
    sums : mapping of str to MotionSum
        By localizer, since the beginning.
    corrections : (3,) float64
        Corrections of (x, y, theta) by absolute estimates, added up since the beginning [m, m, rad].
    correction_covariance : (3, 3) float64
        Of `corrections`, were the belief consistent.
    anchors : tuple of FilterState
        The filter at the beginnings of the test windows, oldest first, at most two.
    measurements : tuple of (float, Measurement)
        Absolute estimates since the oldest anchor of all, with their stamps.
    faults : mapping of str to DetectedFault
        Localizers whose motion is not believed.
    absolute_faults : mapping of str to DetectedFault
        Localizers whose absolute estimates are not believed.
    rivals : tuple of RivalFilter
        Hypotheses that are not decided; empty while the localizers agree.
    undecided_since_s : float
        When the rivals came up [s].
    tested_s : float
        When the motions were compared last [s].
    trials : mapping of str to Retrial
        By localizer whose motion is not believed, where no other motion is.
    alternatives : tuple of Alternative
        Where base may be, after a question that nothing has decided; empty if that is known.
    accused : frozenset of str
        Localizers of that question.
    far_anchors : tuple of FilterState
        The filter at the beginnings of the longer test windows, oldest first.
    doubts : mapping of str to LastingDoubt
        By localizer whose motion is believed, but less than it says.
    parting : Parting
        By how much the motions differ from that of the belief, always alike.
    way_errors : LastingVariances
        Of errors of motion that last, as absolute poses have said that were refused.
    innovations : tuple of (float, Innovation)
        Of the absolute estimates that are in `corrections`, as they were used, with their stamps, since the oldest
        anchor of all.
    repeated : mapping of str to RepeatedPose
        By localizer of whole poses or parts of them, what it said last, and since when.
    overruled : OverruledMotion or None
        Where motion leads, if the absolute estimates of one localizer alone are against it.
    """

    sums: Mapping[str, MotionSum] = _EMPTY
    corrections: Floats = read_only(np.zeros(3))
    correction_covariance: Floats = read_only(np.zeros((3, 3)))
    anchors: tuple[FilterState, ...] = ()
    measurements: tuple[tuple[float, Measurement], ...] = ()
    faults: Mapping[str, DetectedFault] = _EMPTY
    absolute_faults: Mapping[str, DetectedFault] = _EMPTY
    rivals: tuple[RivalFilter, ...] = ()
    undecided_since_s: float = math.inf
    tested_s: float = -math.inf
    trials: Mapping[str, Retrial] = _EMPTY
    alternatives: tuple[Alternative, ...] = ()
    accused: frozenset[str] = frozenset()
    far_anchors: tuple[FilterState, ...] = ()
    doubts: Mapping[str, LastingDoubt] = _EMPTY
    parting: Parting = NOT_COMPARED
    way_errors: LastingVariances = NO_ERRORS
    innovations: tuple[tuple[float, Innovation], ...] = ()
    repeated: Mapping[str, RepeatedPose] = _EMPTY
    overruled: OverruledMotion | None = None

    def with_sums(self, sums: Mapping[str, MotionSum]) -> FaultDiagnosis:
        """Return the same with other sums, in a seventh of the time of ``_replace``."""
        return new_tuple(FaultDiagnosis, (sums, *self[1:]))

    def with_repeated(self, repeated: Mapping[str, RepeatedPose]) -> FaultDiagnosis:
        """Return the same with other memories of what was said, as `with_sums`."""
        return new_tuple(FaultDiagnosis, (*self[:-2], repeated, self[-1]))

    def on_another_clock(self, later_s: float) -> FaultDiagnosis:
        """Return the same of what outlasts windows and questions, by a clock that shows so much more [s].

        Ways of absolute estimates that are drawn away begin anew.
        """
        absolute_faults = {
            source: replace(one, since_s=one.since_s + later_s, n_agreed=0, heard=())
            for source, one in self.absolute_faults.items()
        }
        overruled = self.overruled
        return self._replace(
            faults={source: replace(one, since_s=one.since_s + later_s) for source, one in self.faults.items()},
            absolute_faults=absolute_faults,
            doubts={s: one._replace(since_s=one.since_s + later_s) for s, one in self.doubts.items()},
            repeated={s: one._replace(since_s=one.since_s + later_s) for s, one in self.repeated.items()},
            overruled=overruled and overruled._replace(since_s=overruled.since_s + later_s),
        )
