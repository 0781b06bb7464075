"""Config of the simulator."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, ValidationError, ValidationInfo, field_validator

from trailmark.config import SourceConfig
from trailmark_sim.names import unknown_name, with_hints
from trailmark_sim.vehicle_options import VehicleOptions
from trailmark_sim.worlds import WORLDS, options_model

__all__ = ["SimConfig"]


class SimConfig(SourceConfig):
    """A simulated world, a vehicle in it, and the vehicle's sensors."""

    world: str = "ground_course"
    """Which world; `trailmark sim list` shows them."""
    options: dict[str, Any] = Field(default_factory=dict, validate_default=True)
    """The world's own options."""
    route: str | None = None
    """Which of the world's routes; left out: its first."""
    speed_mps: float | None = Field(default=None, gt=0)
    """Speed to drive the route with; left out: the route's own [m/s]."""
    sway_m: float = Field(default=0.0, ge=0, le=0.05)
    """How far the route weaves to either side, as a hand steers, root mean square; `world_seed` says where [m]."""
    driver: Literal["auto", "route", "commands", "keyboard"] = "auto"
    """Who drives: the route, commands, the keys of the terminal (with `pace: realtime`), or (auto) the route in teach
    and track, commands in replay. For a controller in track: `driver: commands`."""
    start: tuple[float, float, float] | Literal["random"] | None = None
    """Where the vehicle is put down: x, y and heading, or `random`: anywhere free in the world, by the run's seed; left
    out: at the beginning of the route, in replay where the run believes it starts [m, m, deg]."""
    put_off: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """How far off the start it is put down in replay: forward, left, turned [m, m, deg]."""
    sensors: tuple[str, ...] | None = Field(default=None, min_length=1)
    """Which of the world's sensors; left out: its usual ones."""
    rates_hz: dict[str, float] = Field(default_factory=dict)
    """Rates that differ from the world's, by sensor [Hz]."""
    vehicle: VehicleOptions | None = None
    """A vehicle other than the world's: `kind` is four_wheel_steering, ackermann, differential, skid_steer or
    holonomic; its other keys are in the README."""
    world_seed: int = Field(default=1, ge=0)
    """Seeds the place itself. Teaching and replay must have the same; the run's seed changes noise and slip alone."""
    duration_s: float | None = Field(default=None, gt=0)
    """Ends after this time; left out: at the end of the route, or where a command says it is done [s]."""
    patience_s: float = Field(default=20.0, gt=0)
    """Ends when it has been standing for so long [s]."""
    on_collision: Literal["count", "end"] = "end"
    """The vehicle touches something: ends the run, or is counted and goes on. Either way the run is no success."""
    threads: int = Field(default=2, ge=1, le=8)
    """Threads that render; no byte depends on it."""

    @field_validator("world")
    @classmethod
    def _world_exists(cls, name: str) -> str:
        if name not in WORLDS:
            raise ValueError(unknown_name("world", name, WORLDS))
        return name

    @field_validator("options")
    @classmethod
    def _fit_the_world(cls, options: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        """Check the options by the world's model; files in them become absolute."""
        if "world" not in info.data:
            return options
        model = options_model(info.data["world"])
        try:
            return model.model_validate(options, context=info.context).model_dump(mode="json", exclude_unset=True)
        except ValidationError as error:
            raise with_hints(error, model) from None

    @field_validator("rates_hz")
    @classmethod
    def _rates_are_positive(cls, rates: dict[str, float]) -> dict[str, float]:
        for name, rate_hz in rates.items():
            if not rate_hz > 0:
                raise ValueError(f"the rate of {name!r} must be positive, not {rate_hz:g} Hz")
        return rates
