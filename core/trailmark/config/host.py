"""The keys that the host gives to a config: sections, and options beside each plugin's own keys."""

from __future__ import annotations

import math
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, ValidationError, ValidatorFunctionWrapHandler, field_validator, model_validator

from trailmark.arrays import Floats
from trailmark.config.base import Mounting, PluginConfig
from trailmark.config.files import ExistingFile
from trailmark.geometry import Pose2
from trailmark.interfaces import Mode, Pace
from trailmark.plugins.hints import did_you_mean
from trailmark.plugins.spec import Kind

__all__ = [
    "DEFAULT_PLUGINS",
    "HOST_OPTIONS",
    "RESERVED_NAMES",
    "EstimatorOptions",
    "LocalizerOptions",
    "MotionCorrection",
    "NoOptions",
    "PathStoreOptions",
    "PluginsSection",
    "RunSettings",
    "SensorSection",
    "StopWhen",
]

#: Names that a run's files use for something else.
RESERVED_NAMES = ("fused", "groundtruth")

#: What stands where a section names no plugin.
DEFAULT_PLUGINS: dict[Kind, str] = {"estimator": "dead_reckoning", "path_store": "sqlite", "fault": "basic"}


class NoOptions(PluginConfig):
    """The host adds nothing but ``plugin``."""


class MotionCorrection(PluginConfig):
    """What the motions of a localizer are wrong by: ``trailmark calibrate odometry`` measures it."""

    way: float = Field(default=1.0, ge=-1e3, le=1e3)
    """Its ways are multiplied by this; negative: they count backwards."""
    turn: float = Field(default=1.0, ge=-1e3, le=1e3)
    """Its turns are multiplied by this; negative: left and right wheel are swapped."""
    turn_deg_per_m: float = Field(default=0.0, ge=-3600, le=3600)
    """What a straight way turns in truth, as wheels of two sizes do [deg/m]."""
    way_m_per_rad: float = Field(default=0.0, ge=-1e3, le=1e3)
    """What a turn in place drives in truth, as wheels of two sizes do [m/rad]."""

    @model_validator(mode="after")
    def _can_be_undone(self) -> Self:
        if abs(self.way * self.turn - self.way_m_per_rad * math.radians(self.turn_deg_per_m)) < 1e-6:
            raise ValueError(f"nothing would be left of the motion: way {self.way:g}, turn {self.turn:g}")
        return self

    def matrix(self) -> Floats:
        """Return the (3, 3) matrix from twists (forward, left, turn) of the localizer to corrected ones."""
        bend = math.radians(self.turn_deg_per_m)
        return np.array([[self.way, 0.0, self.way_m_per_rad], [0.0, self.way, 0.0], [bend, 0.0, self.turn]])


class LocalizerOptions(PluginConfig):
    """What every localizer takes besides its own keys."""

    is_async: bool = Field(default=False, alias="async")
    """Works beside the run: its estimates arrive late, about the frame that they were made of."""
    latency_ms: float | None = Field(default=None, ge=0)
    """How long an async localizer is busy with a frame at step pace, in which it takes no other; default: its own
    model [ms]."""
    delay_ms: float = Field(default=0.0, ge=0)
    """How much later still every estimate arrives at step pace, async or not: a slow link, on which many are under way
    at once [ms]."""
    keep: Literal["newest", "all"] = "newest"
    """Which frames wait while an async localizer is busy: the newest of each sensor, or all, up to 256."""
    on_error: Literal["fail", "disable"] = "fail"
    """When it raises: end the run, or switch it off, say so and go on."""
    correct: MotionCorrection | None = None
    """What its motions are wrong by."""

    @property
    def latency_s(self) -> float | None:
        """`latency_ms` in seconds."""
        return None if self.latency_ms is None else self.latency_ms / 1e3

    @property
    def answers_later(self) -> bool:
        """Whether estimates may arrive after their frame has passed."""
        return self.is_async or self.delay_ms > 0.0

    @property
    def delay_s(self) -> float:
        """`delay_ms` in seconds."""
        return self.delay_ms / 1e3


class EstimatorOptions(PluginConfig):
    """What every estimator takes besides its own keys."""

    use: tuple[str, ...] | None = None
    """Localizers whose estimates it takes; default: all. The others run and are recorded as unused."""


class PathStoreOptions(PluginConfig):
    """What every path store takes besides its own keys."""

    spacing_m: float = Field(default=0.05, gt=0)
    """Way between two waypoints while teaching [m]."""


#: Options of the host by kind of part.
HOST_OPTIONS: dict[Kind, type[PluginConfig]] = {
    "source": NoOptions,
    "fault": NoOptions,
    "localizer": LocalizerOptions,
    "estimator": EstimatorOptions,
    "path_store": PathStoreOptions,
    "controller": NoOptions,
    "sink": NoOptions,
}


class SensorSection(PluginConfig):
    """What a source does not know about a sensor."""

    mounting: Mounting | None = None
    """Where it sits on the robot."""
    calibration: ExistingFile | dict[str, Any] | None = None
    """A file, or the numbers themselves."""


#: How old a motion that once was measured may get before a live robot stands, where nobody says otherwise [s].
_LIVE_MOTION_AGE_S = 0.5


class StopWhen(PluginConfig):
    """When the robot is stopped whatever the controller says."""

    fix_age_m: float | None = Field(default=None, gt=0)
    """Way since the last accepted absolute estimate; null: never [m]."""
    motion_age_s: float | None = Field(default=None, gt=0)
    """Time since the last accepted motion; null: never; left out: never, or 0.5 in a live run that has motion [s]."""
    stall_s: float | None = Field(default=0.5, gt=0)
    """In real time: for how long the run may stand still before another thread stops the robot; null: for ever [s]."""

    @property
    def limits_belief(self) -> bool:
        """Whether a belief can be too old."""
        return self.fix_age_m is not None or self.motion_age_s is not None

    @property
    def live_motion_age_s(self) -> float | None:
        """How old a motion may get in a live run once one was measured; None where the config says it itself [s]."""
        return None if "motion_age_s" in self.model_fields_set else _LIVE_MOTION_AGE_S


class PluginsSection(PluginConfig):
    """Which plugins the run may load; names of entry points or distributions."""

    enable: tuple[str, ...] | None = None
    """Only these and core; default: all that are installed."""
    block: tuple[str, ...] = ()
    """Not these."""
    require: tuple[str, ...] = ()
    """Distributions that must be installed, as pip writes them: ``trailmark-mrclam>=0.1``."""


class RunSettings(PluginConfig):
    """A run: what gives frames, what looks at them, what is believed, what drives."""

    mode: Mode = "track"
    """Localize only, remember a path, or come back to a remembered one; the commands set it."""
    sources: dict[str, Any] = Field(default_factory=dict)
    """Frame sources by name, merged by stamp; the sensor of a one-sensor source bears the source's name."""
    sensors: dict[str, Any] = Field(default_factory=dict)
    """What sources do not know about their sensors, by sensor."""
    localizers: dict[str, Any] = Field(default_factory=dict)
    """Localizers by name, asked in this order."""
    estimator: Any = None
    """Makes one belief of all estimates; default: dead_reckoning."""
    path_store: Any = None
    """Keeps taught paths; default where one is needed: sqlite."""
    controller: Any = None
    """Turns beliefs into commands."""
    sinks: tuple[Any, ...] = ()
    """Are told what happens."""
    start: Literal["first", "last", "unknown"] | tuple[float, float, float] = "first"
    """Where the robot starts: at the first or last pose of the path, nobody knows, or [x m, y m, heading deg]."""
    control_hz: float = Field(default=70.0, gt=0)
    """The controller is asked at most this often; 70 frames a second is what the ground-camera paper ran at [Hz]."""
    stop_when: StopWhen = StopWhen()
    """When the robot is stopped whatever the controller says."""
    patience_s: float = Field(default=120.0, gt=0)
    """A part that has not come back from a frame for so long has failed [s]."""
    pace: Pace | None = None
    """As fast as possible and reproducible, or held to the stamps; default: realtime for live sources only."""
    seed: int = Field(default=0, ge=0)
    """Every part draws its random numbers from this and its own name."""
    plugins: PluginsSection = PluginsSection()
    """Which plugins the run may load."""

    @property
    def start_pose(self) -> Pose2 | None:
        """Base in the map at the start, where `start` gives numbers."""
        if isinstance(self.start, str):
            return None
        x, y, heading_deg = self.start
        return Pose2(x, y, math.radians(heading_deg))

    @field_validator("start", mode="wrap")
    @classmethod
    def _explain_start(cls, value: Any, validate: ValidatorFunctionWrapHandler) -> Any:
        try:
            return validate(value)
        except ValidationError:  # of a union, which speaks of each branch by itself
            hint = did_you_mean(str(value), ("first", "last", "unknown"))
            raise ValueError(f"must be first, last, unknown or [x m, y m, heading deg], not {value!r}{hint}") from None
