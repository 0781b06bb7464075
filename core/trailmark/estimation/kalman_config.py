"""Config of the Kalman estimator."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from trailmark.config import LocalizerName, PluginConfig

__all__ = ["KalmanConfig", "Loss", "SourceTreatment"]

Loss = Literal["none", "huber", "cauchy"]


class SourceTreatment(PluginConfig):
    """How the estimates of one localizer are taken; what is left out is as for all."""

    gate: float | Literal["off"] | None = None
    """Probability with which a right estimate passes the chi-square test; "off": no test."""
    loss: Loss | None = None
    """How an estimate loses weight with its distance from the belief."""
    sigma_scale: float = Field(default=1.0, gt=0)
    """Factor on the standard deviations that the localizer states."""
    floor_m: float | None = Field(default=None, gt=0)
    """Smallest standard deviation of a position, station or offset that is believed [m]."""
    floor_deg: float | None = Field(default=None, gt=0)
    """Smallest standard deviation of a heading that is believed [deg]."""
    sigmas: tuple[float | None, float | None, float | None] | None = None
    """Standard deviations in place of what the localizer states; null says "not measured" [m, m, deg]."""
    timeout_s: float | None = Field(default=None, gt=0)
    """Silence that is reported in the health of the belief [s]."""
    correlation_s: float | None = Field(default=None, ge=0)
    """Time in which the errors of its absolute poses last, in place of what it says or is learned; 0: no time [s]."""
    errors: Literal["independent", "gyro_bias", "scale"] = "independent"
    """What the errors of its motion have in common, to be estimated: nothing, a constant yaw rate, or a factor of the
    way (wheels that are larger or smaller than believed)."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        _check_gate(self.gate)
        if self.sigmas is not None and not all(sigma is None or sigma > 0 for sigma in self.sigmas):
            raise ValueError(f"sigmas must be positive or null, not {list(self.sigmas)}")
        return self


class KalmanConfig(PluginConfig):
    """Weighs the estimates of any number of localizers by what they say of their own certainty."""

    filter: Literal["ekf", "ukf"] = "ekf"
    """Extended (derivatives) or unscented (sigma points, five times the cost)."""
    model: Literal["pose", "velocity"] = "pose"
    """pose: velocity is what motion said last. velocity: velocity and yaw rate are estimated, also from fixes alone;
    in a gap they fade within `coast_s`."""
    history_s: float = Field(default=10.0, gt=0)
    """How late an estimate may come and still correct everything after it [s]."""
    start_sigma_m: float = Field(default=0.01, gt=0)
    """Standard deviation of a known start, along x and along y [m]."""
    start_sigma_deg: float = Field(default=0.5, gt=0)
    """Standard deviation of the heading of a known start [deg]."""
    drift_sigma_mps: float = Field(default=0.5, gt=0)
    """Standard deviation of the velocity while nothing measures it: in a gap, or ahead of the newest motion [m/s]."""
    drift_sigma_deg_per_s: float = Field(default=30.0, gt=0)
    """The same of the yaw rate [deg/s]."""
    coast_s: float = Field(default=1.0, gt=0)
    """How long the last velocity is held in a gap, and how long an unmeasured velocity keeps its direction [s]."""
    motions: Literal["independent", "intersection"] = "independent"
    """Several localizers that give motion of one interval: their errors have nothing in common, or nobody knows
    (covariance intersection with equal weights: two that agree are no more certain than one)."""
    gate: float | Literal["off"] = 0.999
    """Probability with which a right estimate passes the chi-square test of its innovation; "off": no test."""
    loss: Loss = "none"
    """How an estimate loses weight with its distance from the belief."""
    loss_scale: float = Field(default=2.0, gt=0)
    """Distance at which the loss begins, in standard deviations of the innovation."""
    recover_after: int = Field(default=5, ge=1)
    """How many more must be rejected of one localizer than accepted until the belief is doubted, not the localizer."""
    support_s: float = Field(default=3.0, ge=0)
    """It is not doubted while another localizer, accepted within this time, measures the same directions [s]."""
    agree_scale: float = Field(default=0.03, ge=0)
    """By which share of the way and of the turn two honest odometries differ (one standard deviation)."""
    agree_deg_per_s: float = Field(default=0.3, ge=0)
    """By which yaw rate they differ, even at rest (one standard deviation) [deg/s]."""
    agree_late_s: float = Field(default=0.03, ge=0)
    """By how much their stamps are off against each other (one standard deviation) [s]."""
    calibration_sigma: float = Field(default=0.005, ge=0, le=1)
    """By which share of the way and of the turn the calibration of a motion is off, which never averages out (one
    standard deviation): pixels per metre, wheels, track. It is in the covariance of the
    belief alone: what is estimated stays as it is."""
    floor_m: float = Field(default=1e-6, gt=0)
    """Smallest standard deviation of a position that is believed [m]."""
    floor_deg: float = Field(default=1e-4, gt=0)
    """Smallest standard deviation of a heading that is believed [deg]."""
    gyro_bias_sigma_deg_per_s: float = Field(default=1.0, gt=0)
    """Where `errors: gyro_bias` is said: what is known of the bias at first [deg/s]."""
    gyro_bias_walk_deg_per_s: float = Field(default=0.01, gt=0)
    """How far such a bias walks in 1 s, and with the root of the time; a cheap gyro's 0.1 deg/s in some minutes, half a
    degree while it warms up [deg/s per root s]."""
    standstill: Literal["use", "off"] = "off"
    """Where `errors: gyro_bias` is said: base stands while wheels do not turn and the gyro agrees, unless anybody says
    otherwise. Then the heading stands too, and what the gyro shows is its bias: wrong on anything that itself turns."""
    scale_sigma: float = Field(default=0.05, gt=0)
    """Where `errors: scale` is said: what is known of the factor at first, as a share."""
    wander_s: float = Field(default=600.0, gt=0)
    """Time in which a common scale may change by its sigma [s]."""
    timeout_s: float = Field(default=2.0, gt=0)
    """Silence of a localizer that is reported in the health of the belief [s]."""
    max_speed_mps: float = Field(default=100.0, gt=0)
    """A motion that is faster is refused [m/s]."""
    time_jump_s: float = Field(default=60.0, gt=0)
    """A stamp that is further than this from the newest is a jump of the clock [s]."""
    time_jump: Literal["reset", "refuse"] = "reset"
    """Refuse estimates of another time always, or begin anew there when `time_jump_after` in a row agree."""
    time_jump_after: int = Field(default=5, ge=1)
    """How many estimates in a row must agree on the new time."""
    max_per_stamp: int = Field(default=64, ge=1)
    """Absolute estimates of one localizer about one instant; more are refused: its clock stands still."""
    clock_offsets: Literal["use", "tell", "off"] = "use"
    """Stamps of one localizer that are late against another's motion, as turns and ways show: tell it, and correct
    those of fixes by it; or tell it only; or do not look."""
    learn_scales: bool = True
    """Learn while running by which factor the standard deviations of each localizer are too small, from
    what localizers say of the same motion, and use it beyond a factor of 1.4."""
    learn_correlations: bool = True
    """Learn while running how long the errors of absolute poses last, where the localizer does not say it."""
    sources: dict[LocalizerName, SourceTreatment] = Field(default_factory=dict)
    """What is different for single localizers, by name."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        _check_gate(self.gate)
        if self.time_jump_s <= self.history_s:
            raise ValueError(f"time_jump_s ({self.time_jump_s:g}) must be longer than history_s ({self.history_s:g})")
        return self


def _check_gate(gate: float | str | None) -> None:
    if isinstance(gate, float) and not 0.0 < gate < 1.0:
        raise ValueError(f'gate must be a probability between 0 and 1, or "off", not {gate:g}')
