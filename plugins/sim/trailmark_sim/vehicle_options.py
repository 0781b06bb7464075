"""Vehicles as a config gives them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, field_validator

from trailmark.config import PluginConfig
from trailmark_sim.vehicles import (
    Ackermann,
    Differential,
    FourWheelSteering,
    Holonomic,
    SkidSteer,
    Vehicle,
    WheelErrors,
)

__all__ = ["VehicleOptions"]

_LARGEST_ERROR = 0.5  # of wheels; what is larger was meant as a factor


class WheelOptions(PluginConfig):
    """Why wheel odometry is wrong."""

    scale: float = Field(default=0.01, gt=-1)
    """Relative error of every distance, and no factor: 0.3 counts 1.3 m for a metre; 0.5 at most."""
    turn_scale: float = Field(default=0.02, gt=-1)
    """Relative error of every turn, as `scale` is of distances; 0.5 at most."""
    slip_m: float = Field(default=0.002, ge=0)
    """Error of the distance after one metre, one standard deviation; grows with the root of the way [m]."""
    slip_deg: float = Field(default=0.3, ge=0)
    """Error of the heading after one metre, one standard deviation [deg]."""

    @field_validator("scale", "turn_scale")
    @classmethod
    def _refuse_factors(cls, value: float) -> float:
        """Refuse ``scale: 1.3``: written as a factor, it would be an error of 130 %."""
        if value > _LARGEST_ERROR:
            raise ValueError(
                f"is a relative error, and {value:g} would be {100.0 * value:+g} %; the factor {value:g} is written"
                f" {value - 1.0:g}. {_LARGEST_ERROR:g} at most"
            )
        return value

    def build(self) -> WheelErrors:
        """Return it as the vehicles take it."""
        return WheelErrors(self.scale, self.turn_scale, self.slip_m, math.radians(self.slip_deg))


class _OptionsOfVehicle(PluginConfig):
    """Options that bear the names of the vehicle's arguments; angles are in degrees here and in radians there."""

    vehicle: ClassVar[Callable[..., Vehicle]]

    def build(self) -> Vehicle:
        """Return the vehicle."""
        arguments: dict[str, Any] = {}
        for name, value in self:
            if isinstance(value, WheelOptions):
                arguments["wheel_errors"] = value.build()
            elif "_deg" in name:
                arguments[name.replace("_deg", "_rad")] = math.radians(value)
            elif name != "kind":
                arguments[name] = value
        return self.vehicle(**arguments)


class FourWheelSteeringOptions(_OptionsOfVehicle):
    """Front and rear wheels steer separately, as the vehicle of Nagai & Watanabe does."""

    vehicle: ClassVar[Callable[..., Vehicle]] = FourWheelSteering

    kind: Literal["four_wheel_steering"]
    """Which vehicle."""
    length_m: float = Field(default=0.60, gt=0)
    """Outline [m]."""
    width_m: float = Field(default=0.39, gt=0)
    """Outline; the paper's [m]."""
    max_speed_mps: float = Field(default=0.5, gt=0)
    """Top speed [m/s]."""
    max_steer_deg: float = Field(default=18.3, gt=0, lt=60)
    """Limit of front and rear angles; the paper's [deg]."""
    min_turning_radius_m: float = Field(default=0.75, gt=0)
    """Radius at opposite full angles; the paper's [m]."""
    steer_lag_s: float = Field(default=0.08, ge=0)
    """Time constant of the servos [s]."""
    speed_lag_s: float = Field(default=0.15, ge=0)
    """Time constant of the drive [s]."""
    asymmetry: float = Field(default=0.0, gt=-1, lt=1)
    """The linkage turns the wheels this share further to the left and less to the right."""
    front_trim_deg: float = 0.0
    """Angle of the front wheels when their servo stands at zero [deg]."""
    rear_trim_deg: float = 0.0
    """The same of the rear wheels [deg]."""
    wheels: WheelOptions = WheelOptions()
    """Why its odometry is wrong."""


class AckermannOptions(_OptionsOfVehicle):
    """Front wheels steer, as those of cars; base is the middle of the rear axle."""

    vehicle: ClassVar[Callable[..., Vehicle]] = Ackermann

    kind: Literal["ackermann"]
    """Which vehicle."""
    length_m: float = Field(default=0.60, gt=0)
    """Outline, centred on base [m]."""
    width_m: float = Field(default=0.36, gt=0)
    """Outline [m]."""
    max_speed_mps: float = Field(default=1.0, gt=0)
    """Top speed [m/s]."""
    wheelbase_m: float = Field(default=0.36, gt=0)
    """Distance of the axles [m]."""
    max_steer_deg: float = Field(default=28.0, gt=0, lt=60)
    """Full lock [deg]."""
    steer_lag_s: float = Field(default=0.1, ge=0)
    """Time constant of the servo [s]."""
    speed_lag_s: float = Field(default=0.15, ge=0)
    """Time constant of the drive [s]."""
    wheels: WheelOptions = WheelOptions()
    """Why its odometry is wrong."""


class DifferentialOptions(_OptionsOfVehicle):
    """Two driven wheels and a castor."""

    vehicle: ClassVar[Callable[..., Vehicle]] = Differential

    kind: Literal["differential"]
    """Which vehicle."""
    length_m: float = Field(default=0.45, gt=0)
    """Outline [m]."""
    width_m: float = Field(default=0.40, gt=0)
    """Outline [m]."""
    max_speed_mps: float = Field(default=0.3, gt=0)
    """Top speed of either wheel [m/s]."""
    track_m: float = Field(default=0.34, gt=0)
    """Distance of the wheels [m]."""
    speed_lag_s: float = Field(default=0.1, ge=0)
    """Time constant of the drives [s]."""
    wheels: WheelOptions = WheelOptions()
    """Why its odometry is wrong."""


class SkidSteerOptions(_OptionsOfVehicle):
    """Four wheels or crawlers that skid sideways in a turn."""

    vehicle: ClassVar[Callable[..., Vehicle]] = SkidSteer

    kind: Literal["skid_steer"]
    """Which vehicle."""
    length_m: float = Field(default=0.60, gt=0)
    """Outline [m]."""
    width_m: float = Field(default=0.50, gt=0)
    """Outline [m]."""
    max_speed_mps: float = Field(default=0.3, gt=0)
    """Top speed of either side [m/s]."""
    track_m: float = Field(default=0.42, gt=0)
    """Distance of the sides [m]."""
    speed_lag_s: float = Field(default=0.1, ge=0)
    """Time constant of the drives [s]."""
    turn_share: float = Field(default=0.65, gt=0, le=1)
    """Yaw rate over what the speeds of the sides would give without skidding."""
    icr_forward_m: float = 0.03
    """How far before its middle it turns about [m]."""
    wheels: WheelOptions = WheelOptions()
    """Why its odometry is wrong."""


class HolonomicOptions(_OptionsOfVehicle):
    """Drives in every direction, as the robot of Tasaki et al. does."""

    vehicle: ClassVar[Callable[..., Vehicle]] = Holonomic

    kind: Literal["holonomic"]
    """Which vehicle."""
    length_m: float = Field(default=0.65, gt=0)
    """Outline [m]."""
    width_m: float = Field(default=0.65, gt=0)
    """Outline; the paper's [m]."""
    max_speed_mps: float = Field(default=1.0, gt=0)
    """Top speed; the paper's [m/s]."""
    max_yaw_degps: float = Field(default=86.0, gt=0)
    """Top yaw rate [deg/s]."""
    speed_lag_s: float = Field(default=0.2, ge=0)
    """Time constant of the drives [s]."""
    wheels: WheelOptions = WheelOptions()
    """Why its odometry is wrong."""


VehicleOptions = Annotated[
    FourWheelSteeringOptions | AckermannOptions | DifferentialOptions | SkidSteerOptions | HolonomicOptions,
    Field(discriminator="kind"),
]
